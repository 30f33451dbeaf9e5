"""What a rater is asked, what the rater says, and how that is spelled as an answer.

Sides are relative to what is shown; an `Answer` is relative to clip a of the pair.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Literal

from data.answers.answer_records import Answer, Aspect, Choice, Pair, Role, Side
from data.episodes.clips import Clip

Verdict = Literal["left_much", "left", "equal", "right", "right_much", "skip", "bad"]
"""`skip`: can't tell. `bad`: a clip is unusable."""
Kind = Literal["new", "overlap", "repeat", "gold"]
"""Why a question is asked; raters are not told."""

_P_LEFT: dict[Verdict, float] = {
    "left_much": 1.0,
    "left": 0.75,
    "equal": 0.5,
    "right": 0.25,
    "right_much": 0.0,
}


@dataclass(frozen=True, kw_only=True)
class Question:
    """A pair as it is shown to one rater."""

    question_id: str
    """Goes into every action on this question; a stale one is ignored."""
    pair: Pair
    shown_left: Side
    """Which clip of the pair is on the left."""
    kind: Kind
    role: Role
    """How the answer will be stored."""
    shown_utc: datetime
    """When it was first shown."""
    corrects: Answer | None = None
    """The answer that was reopened; None for a question that has no answer."""
    undone: Answer | None = None
    """The answer that was taken back, so that the question is asked again."""

    @property
    def left(self) -> Clip:
        """The clip shown on the left."""
        return self.pair.a if self.shown_left == "a" else self.pair.b

    @property
    def right(self) -> Clip:
        """The clip shown on the right."""
        return self.pair.b if self.shown_left == "a" else self.pair.a

    @property
    def remarked(self) -> Answer | None:
        """The answer whose note, confidence and reason come back with the question."""
        return self.corrects or self.undone

    @property
    def earlier(self) -> Verdict | None:
        """What was said before it was reopened."""
        return None if self.corrects is None else verdict_of(self.corrects)


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """One answer as it comes from the page."""

    question_id: str
    """The question that was on the screen when the key was pressed."""
    verdict: Verdict
    reason: str = ""
    """Why a clip is unusable, or both are equally bad."""
    why: Aspect | Literal[""] = ""
    """What of the gait decided it."""
    note: str = ""
    confidence: float | None = None
    """How sure the rater says to be, in [0, 1]."""
    watched_ms: int | None = None
    """How long the clips were playing."""
    response_ms: int | None = None
    """From the first frame to the key press."""
    client: dict[str, Any] = field(default_factory=dict)
    """Anything JSON about how it was shown."""
    dialog_open: bool = False
    """A dialog was in front: hotkeys fire all the same, and must not answer."""


@dataclass(frozen=True)
class Outcome:
    """What became of an action."""

    accepted: bool
    reason: str = ""
    """One sentence for the rater; empty where it was accepted."""
    answer: Answer | None = None
    """The row that was stored: the answer, the correction, or the retraction."""


@dataclass(frozen=True)
class Past:
    """An answer in the rater's history."""

    pair: Pair
    answer: Answer

    @property
    def verdict(self) -> Verdict:
        """What the rater said, relative to the sides as they were shown."""
        return verdict_of(self.answer)


def to_choice(verdict: Verdict, shown_left: Side) -> tuple[Choice, float | None]:
    """Choice and probability that clip a is better; None where it is no preference."""
    p_left = _P_LEFT.get(verdict)
    if p_left is None:
        return ("bad" if verdict == "bad" else "skip"), None
    p_a = p_left if shown_left == "a" else 1.0 - p_left
    return ("equal" if p_a == 0.5 else "a" if p_a > 0.5 else "b"), p_a


def verdict_of(answer: Answer) -> Verdict:
    """The verdict nearest to an answer, relative to the sides it was shown on."""
    if answer.target is None:
        return "bad" if answer.choice == "bad" else "skip"
    p_left = answer.target if answer.shown_left == "a" else 1.0 - answer.target
    return min(_P_LEFT, key=lambda verdict: abs(_P_LEFT[verdict] - p_left))
