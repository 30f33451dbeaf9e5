"""The queue of a rater: what is on the screen, and what an action does to it.

Everything that lasts is in the store: a reload, a second tab and a restart of the
server go on where the rater was. An answer's id is the id of its question, so that a
question cannot be answered twice, whoever sends it how often.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from data.answers.answer_records import Answer, Pair
from data.answers.question_board import QuestionBoard, Tally
from data.answers.store import AnswerStore
from data.answers.typed_text import plain_text, too_long

from .judgement import Judgement, Outcome, Past, Question, to_choice
from .key_repeat import GuardCfg, GuardState, weigh
from .plan import plan
from .question_stack import Pile, PileCfg, new_id


@dataclass(frozen=True, kw_only=True)
class QueueCfg(PileCfg):
    """How questions are handed out and answers are taken."""

    guard: GuardCfg = field(default_factory=GuardCfg)


def utc_now() -> datetime:
    """The time, as every session takes it."""
    return datetime.now(UTC)


class RaterSession:
    """One rater at one browser tab; for use by one thread at a time.

    Any number of sessions of one rater see the same queue. Every method raises
    AnswerError if the data base fails, and then nothing was stored.
    """

    def __init__(
        self,
        store: AnswerStore,
        rater_id: str,
        *,
        cfg: QueueCfg | None = None,
        board: QuestionBoard | None = None,
        rng: np.random.Generator,
        now: Callable[[], datetime] = utc_now,
    ) -> None:
        """Open the queue of `rater_id`, who becomes known to the store as a human.

        Args:
            store: Where pairs and answers are.
            rater_id: Whose queue it is.
            cfg: How questions are handed out.
            board: What is open in the store by the overlap of `cfg`; sessions that
                share one need no memory and no start of their own.
            rng: Draws the side each clip is shown on.
            now: The time, with an offset.

        Raises:
            AnswerError: the id belongs to a scripted rater or a model.
        """
        store.add_rater(rater_id, "human")
        self.rater_id = rater_id
        self.cfg = QueueCfg() if cfg is None else cfg
        self._store = store
        self._board = board or QuestionBoard(store, self.cfg.plan.overlap)
        self._pile = Pile(store, rater_id, self.cfg, self._board, rng=rng)
        self._now = now
        self._guard = GuardState()

    def current(self, *, active: bool = True) -> Question | None:
        """What is to be on the screen; None if nothing is open for this rater.

        The pair is leased, or its lease renewed. Asks the data base: call it after an
        action and about once a second, not for every frame.

        Args:
            active: The rater is there; without a sign of life the lease is not renewed,
                so that an empty chair keeps nothing from others.
        """
        now = self._now()
        pile = self._pile.rows()
        half_over = now + timedelta(seconds=self.cfg.lease_s / 2)
        if not pile or (
            active and datetime.fromisoformat(pile[-1].expires_utc) < half_over
        ):
            with self._store.transaction():
                pile = self._pile.renewed(now) or self._pile.asked(now)
        question = self._pile.decoded(pile[-1]) if pile else None
        if pile and question is None:
            self._pile.close(pile[-1].question_id)
            return self.current(active=active)
        shown = None if question is None else question.question_id
        self._guard = self._guard.on_screen(shown, now)
        return question

    def answer(self, judgement: Judgement) -> Outcome:
        """Store an answer to the question on the screen, or say why it is ignored.

        An accepted answer is on the disk when this returns.

        Raises:
            ValueError: the judgement holds an impossible confidence or time.
        """
        judgement = replace(
            judgement,
            note=plain_text(judgement.note),
            reason=plain_text(judgement.reason),
        )
        for name, text in (("note", judgement.note), ("reason", judgement.reason)):
            if wrong := too_long(text):
                return Outcome(False, f"The {name} {wrong}: shorten it, then answer.")
        now = self._now()
        guard, reason = weigh(self._guard, judgement, now, self.cfg.guard)
        if reason:
            self._guard = guard
            return Outcome(False, reason)
        with self._store.transaction():
            pile = self._pile.rows()
            if not pile or pile[-1].question_id != judgement.question_id:
                return Outcome(False, "This pair was answered in another window.")
            question = self._pile.decoded(pile[-1])
            if question is None:
                self._pile.close(judgement.question_id)
                return Outcome(False, "This answer was changed in another window.")
            answer = _spelled(question, judgement, self.rater_id, now)
            self._store.add_answer(answer)
            self._pile.close(question.question_id)
            if len(pile) == 1:
                # Here, so that the disk is waited for once and not twice.
                self._pile.asked(now)
        # Only now: an answer that failed to be stored may be sent again at once.
        self._guard = guard.on_screen(None, now)
        return Outcome(True, answer=answer)

    def undo(self) -> Outcome:
        """Take the newest answer back and show its question again, sides as they were.

        Where a reopened question is on the screen, that is closed instead.
        """
        if (outcome := self.cancel()).accepted:
            return outcome
        now = self._now()
        with self._store.transaction():
            newest = self._board.history(self.rater_id, 1)
            if not newest:
                return Outcome(False, "There is nothing to undo.")
            pair, answer = newest[0]
            retraction = Answer(
                answer_id=new_id(),
                pair_id=pair.pair_id,
                rater_id=self.rater_id,
                choice="skip",
                shown_left=answer.shown_left,
                supersedes=answer.answer_id,
                role="undo",
                created_utc=now.isoformat(timespec="milliseconds"),
            )
            self._store.add_answer(retraction)
            self._pile.show(pair, answer.role, answer.shown_left, now)
        return Outcome(True, answer=retraction)

    def reopen(self, answer_id: str) -> Outcome:
        """Show an earlier answer's question again, to be answered anew.

        The old answer counts until the new one is given.
        """
        now = self._now()
        with self._store.transaction():
            found = self._store.current_answer(answer_id)
            if found is None or found[1].rater_id != self.rater_id:
                return Outcome(False, "This answer was changed in another window.")
            self.cancel()
            pair, answer = found
            self._pile.show(
                pair, answer.role, answer.shown_left, now, corrects=answer_id
            )
        return Outcome(True)

    def cancel(self) -> Outcome:
        """Close a reopened question; its answer stays what it was."""
        with self._store.transaction():
            pile = self._pile.rows()
            if not pile or pile[-1].supersedes is None:
                return Outcome(False, "No earlier answer is open.")
            self._pile.close(pile[-1].question_id)
        return Outcome(True)

    def history(self, limit: int = 10) -> list[Past]:
        """The rater's last answers, newest first."""
        rows = self._board.history(self.rater_id, limit)
        return [Past(pair, answer) for pair, answer in rows]

    def progress(self) -> Tally:
        """How far the rater is."""
        return self._pile.tally(self._now())

    def upcoming(self, count: int = 2) -> list[Pair]:
        """Pairs that probably come next, to be loaded ahead; nothing is leased.

        Another rater may be faster, and then has loaded the one behind.
        """
        pile = self._pile.rows()
        waiting = [self._store.pair(row.pair_id) for row in reversed(pile[:-1])]
        planned = plan(
            self._store,
            self._board,
            self.rater_id,
            self._now(),
            self.cfg.plan,
            count=count,
            ahead=sum(row.supersedes is None for row in pile),
            without={row.pair_id for row in pile},
        )
        return [*waiting, *(item.pair for item in planned)][:count]


def _spelled(
    question: Question, judgement: Judgement, rater_id: str, now: datetime
) -> Answer:
    choice, p_a = to_choice(judgement.verdict, question.shown_left)
    shown_s = (now - question.shown_utc).total_seconds()
    corrects = question.corrects
    return Answer(
        answer_id=question.question_id,
        pair_id=question.pair.pair_id,
        rater_id=rater_id,
        choice=choice,
        p_a=p_a,
        shown_left=question.shown_left,
        shown_ms=max(0, round(1000 * shown_s)),
        watched_ms=judgement.watched_ms,
        response_ms=judgement.response_ms,
        confidence=judgement.confidence,
        note=judgement.note,
        reason=judgement.reason,
        why=judgement.why if choice in ("a", "b") else "",
        supersedes=None if corrects is None else corrects.answer_id,
        client=judgement.client | {"kind": question.kind},
        created_utc=now.isoformat(timespec="milliseconds"),
        role=question.role,
    )
