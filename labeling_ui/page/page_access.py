"""What a page asks of the queue and the files; may block, so never in the ticker."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

from data.answers.answer_records import Answer, Pair
from data.answers.question_board import Tally
from data.episodes.visible_habits import FINE, difference_words
from data.errors import GaitprefError
from labeling_ui.questions.judgement import Judgement, Outcome, Past, Question
from labeling_ui.questions.rater_session import RaterSession
from labeling_ui.scene.clip_motion import Motion, MotionCache

logger = logging.getLogger(__name__)

HISTORY_LENGTH = 10
LOAD_AHEAD = 2
MOST_DIFFERENCES = 5


@dataclass(frozen=True)
class Differed:
    """What is told of the pair that was answered last."""

    says: str
    differences: tuple[str, ...] = ()
    """One sentence each, the plainest first."""
    of: tuple[Pair, Answer] | None = None
    """The pair and what was said of it; None where there is none to tell of."""
    picture: str = ""
    """SVG of what moved a reward about it; empty without one."""


@dataclass(frozen=True, eq=False)
class Showing:
    """Everything the page of one rater shows."""

    question: Question | None
    """None: there is nothing to answer."""
    motions: tuple[Motion, Motion] | None
    """Left and right; None if there is no question, or it cannot be shown."""
    progress: Tally
    history: tuple[Past, ...]
    notice: str = ""
    """One sentence for the rater."""
    accepted: Answer | None = None
    """The answer that led to this, if one was just stored."""

    @property
    def question_id(self) -> str | None:
        """Which question is shown."""
        return None if self.question is None else self.question.question_id


class Desk:
    """One browser tab's access to queue and clips; for one thread at a time."""

    def __init__(
        self,
        session: RaterSession,
        motions: MotionCache,
        *,
        may_act: Callable[[], bool] = lambda: True,
    ) -> None:
        """Sit down at a queue.

        Args:
            may_act: Whether the rater still has a token; asked before each action.
        """
        self._session = session
        self._motions = motions
        self._may_act = may_act

    @property
    def rater_id(self) -> str:
        """Whose desk it is."""
        return self._session.rater_id

    def look(self) -> Showing:
        """What is on the desk."""
        return self._showing("", None)

    def changed(self, shown: Showing, *, active: bool) -> Showing | None:
        """What is on the desk if it is no longer `shown`.

        Args:
            active: The rater is there, so that the lease is renewed.
        """
        question = self._session.current(active=active)
        question_id = None if question is None else question.question_id
        if question_id != shown.question_id:
            return self.look()
        return None

    def act(self, act: Act) -> Outcome:
        """Store something, unless the rater was thrown out meanwhile."""
        return act(self) if self._may_act() else Outcome(False, "You are logged out.")

    def answer(self, judgement: Judgement) -> Outcome:
        """Store an answer."""
        return self._session.answer(judgement)

    def undo(self) -> Outcome:
        """Take the last answer back."""
        return self._session.undo()

    def reopen(self, answer_id: str) -> Outcome:
        """Put an earlier question on the desk again."""
        return self._session.reopen(answer_id)

    def keep(self) -> Outcome:
        """Leave a reopened question as it was."""
        return self._session.cancel()

    def after(self, outcome: Outcome) -> Showing:
        """What is on the desk now that `outcome` is on the disk."""
        accepted = outcome.answer if outcome.accepted else None
        return self._showing(outcome.reason, accepted)

    def differed(self) -> Differed:
        """What the clips of the last answer differ in, unless they are asked about
        now: whoever reads it beforehand answers by it."""
        question, past = self._session.current(active=False), self._session.history(1)
        if not past:
            return Differed("You have not answered yet.")
        pair, answer = past[0].pair, past[0].answer
        if question is not None and question.pair.pair_id == pair.pair_id:
            return Differed("You are asked about this pair now: answer first.")
        sides = (pair.a, pair.b) if answer.shown_left == "a" else (pair.b, pair.a)
        try:
            left, right = (self._motions.get(clip).habits for clip in sides)
        except (GaitprefError, OSError) as error:
            return Differed(f"This pair cannot be read any more ({error}).")
        found = difference_words(left, right)[:MOST_DIFFERENCES]
        says = "You had these two before you:"
        if not found and (found := difference_words(left, right, FINE)[:1]):
            says = (
                "They differ in nothing that people usually notice, a little in this:"
            )
        elif not found:
            says = "They differ in nothing that people usually notice."
        return Differed(says, tuple(found), (pair, answer))

    def upcoming(self) -> list[Pair]:
        """The pairs that probably come next."""
        return self._session.upcoming(LOAD_AHEAD)

    def load(self, pairs: list[Pair]) -> None:
        """Have the clips of `pairs` ready; may run beside everything else."""
        for pair in pairs:
            try:
                self._motions.of_pair(pair)
            except (GaitprefError, OSError) as error:
                logger.warning("pair %s cannot be shown: %s", pair.pair_id[:12], error)

    def _showing(self, notice: str, accepted: Answer | None) -> Showing:
        question = self._session.current()
        motions = None
        if question is not None:
            try:
                left = self._motions.get(question.left)
                motions = (left, self._motions.get(question.right))
            except (GaitprefError, OSError) as error:
                logger.warning("%s", error)
                notice = f"This pair cannot be shown ({error}). Call it a bad clip [F]."
        return Showing(
            question=question,
            motions=motions,
            progress=self._session.progress(),
            history=tuple(self._session.history(HISTORY_LENGTH)),
            notice=notice,
            accepted=accepted,
        )


Picture = Callable[[Pair, Answer], str]
"""SVG of what moved a reward about an answered pair; takes its time, and may be called
by any thread."""
Look = Callable[[Desk], Showing | None]
"""Asks what is on the desk; None changes nothing on the page."""
Act = Callable[[Desk], Outcome]
"""Stores something at the desk."""
