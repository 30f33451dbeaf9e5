"""The pile of questions of one rater: leased, renewed, taken over, asked anew.

The last one is on the screen. All of it lies in the store, beside the answers.
"""

from __future__ import annotations

import uuid
from dataclasses import dataclass, field
from datetime import datetime, timedelta

import numpy as np

from data.answers.answer_records import Answer, Pair, Role, Side
from data.answers.question_board import QuestionBoard, Shown, Tally
from data.answers.store import AnswerStore

from .judgement import Kind, Question
from .plan import PlanCfg, plan


@dataclass(frozen=True, kw_only=True)
class PileCfg:
    """What is asked, and for how long a pair is kept from others."""

    lease_s: float = 600.0
    """A shown pair is kept from others this long after the last sign of life."""
    plan: PlanCfg = field(default_factory=PlanCfg)


class Pile:
    """The questions of one rater; call what changes them inside a transaction."""

    def __init__(
        self,
        store: AnswerStore,
        rater_id: str,
        cfg: PileCfg,
        board: QuestionBoard,
        *,
        rng: np.random.Generator,
    ) -> None:
        self._store, self._rater_id, self._cfg, self._rng = store, rater_id, cfg, rng
        self._board = board
        self._known: Question | None = None

    def rows(self) -> list[Shown]:
        """The questions, the one on the screen last."""
        return self._board.shown(self._rater_id)

    def close(self, question_id: str) -> None:
        """Take a question away, if it is there."""
        self._board.close(question_id)

    def tally(self, now: datetime) -> Tally:
        """How far the rater is."""
        return self._board.tally(self._rater_id, now.isoformat())

    def renewed(self, now: datetime) -> list[Shown]:
        """The pile with new leases, without what somebody else has taken over."""
        pile = self.rows()
        for row in pile:
            if datetime.fromisoformat(row.expires_utc) <= now and not self._still_open(
                row, now
            ):
                self._board.close(row.question_id)
        self._board.renew(self._rater_id, self._expiry(now))
        return self.rows()

    def _still_open(self, row: Shown, now: datetime) -> bool:
        """Whether a question whose lease ran out may be asked all the same."""
        if row.supersedes is not None:
            return self._store.current_answer(row.supersedes) is not None
        if row.role == "repeat":
            again = self._board.repeatable(self._rater_id, 0)
            return row.pair_id in {pair_id for pair_id, _ in again}
        if self._store.pair(row.pair_id).gold is not None:
            return row.pair_id in self._board.gold_pairs(self._rater_id)
        return self._board.is_open(row.pair_id, self._rater_id, now.isoformat())

    def asked(self, now: datetime) -> list[Shown]:
        """The pile with a new question, if there is one to ask."""
        cfg = self._cfg.plan
        for item in plan(self._store, self._board, self._rater_id, now, cfg):
            drawn: Side = "a" if self._rng.random() < 0.5 else "b"
            self.show(item.pair, item.role, item.shown_left or drawn, now)
        return self.rows()

    def show(
        self,
        pair: Pair,
        role: Role,
        shown_left: Side,
        now: datetime,
        *,
        corrects: str | None = None,
    ) -> None:
        """Put a question on top."""
        question = Shown(
            question_id=new_id(),
            rater_id=self._rater_id,
            pair_id=pair.pair_id,
            role=role,
            shown_left=shown_left,
            supersedes=corrects,
            shown_utc=now.isoformat(),
            expires_utc=self._expiry(now),
        )
        self._board.show(question)

    def _expiry(self, now: datetime) -> str:
        return (now + timedelta(seconds=self._cfg.lease_s)).isoformat()

    def decoded(self, row: Shown) -> Question | None:
        """The question of a row; None if the answer it corrects is not current."""
        known = self._known
        if known and known.question_id == row.question_id and not row.supersedes:
            return known
        corrects = None
        if row.supersedes is not None:
            found = self._store.current_answer(row.supersedes)
            if found is None:
                return None
            corrects = found[1]
        pair = self._store.pair(row.pair_id)
        self._known = Question(
            question_id=row.question_id,
            pair=pair,
            shown_left=row.shown_left,
            kind=self._kind(pair, row.role),
            role=row.role,
            shown_utc=datetime.fromisoformat(row.shown_utc),
            corrects=corrects,
            undone=None if corrects else self._undone(row),
        )
        return self._known

    def _undone(self, row: Shown) -> Answer | None:
        """The answer to this very question, sides as they are, that was taken back."""
        for answer in self._board.undone(self._rater_id, row.pair_id):
            if (answer.role, answer.shown_left) == (row.role, row.shown_left):
                return answer
        return None

    def _kind(self, pair: Pair, role: Role) -> Kind:
        if role == "repeat":
            return "repeat"
        if pair.gold is not None:
            return "gold"
        overlaps = self._cfg.plan.overlap.takes(pair.pair_id)
        return "overlap" if overlaps else "new"


def new_id() -> str:
    """An id nobody else has."""
    # Not from the session's generator: ids must differ even where seeds are equal.
    return uuid.uuid4().hex
