"""A question put to a rater, and what the rater said."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal, get_args

from data.episodes.clips import Clip
from data.files.limits import BIGGEST_INTEGER

QUESTION = "better_overall"
"""What is asked about a pair; part of its identity."""

Choice = Literal["a", "b", "equal", "skip", "bad"]
"""`skip`: can't tell. `bad`: a clip is unusable. Neither of them is a preference."""
Side = Literal["a", "b"]
Role = Literal["first", "repeat", "undo"]
"""`repeat`: the rater was asked again, to see whether the answer holds. `undo`: takes
back the answer it supersedes, and is none itself."""
RaterKind = Literal["human", "scripted", "model"]
"""`scripted`: a criterion, as of a simulated rater. `model`: a program that looks at
the clips, as a vision model does."""
Aspect = Literal["posture", "feet", "rhythm", "steadiness", "effort"]
"""What of a gait an answer is about."""
ASPECTS: tuple[Aspect, ...] = get_args(Aspect)

MIN_ANSWERS = 8
"""Fewer answers than this that prefer a clip say nothing about 25 descriptors."""
HERE = "here_s"
"""Where an answer's `client` has the moments that were marked."""
MOST_HERE = 8
"""Moments that one answer can mark."""
LONGEST_S = 3600.0
"""Farther in a clip nothing is marked."""

_PREFERENCES = {"a": 1.0, "b": 0.0, "equal": 0.5}
_ALLOWED = {
    "choice": get_args(Choice),
    "shown_left": get_args(Side),
    "role": get_args(Role),
    "why": ("", *ASPECTS),
}


def now_utc() -> str:
    """The time, as `Answer.created_utc` has it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


@dataclass(frozen=True, slots=True)
class Pair:
    """Two clips to be compared; make one with `Pair.make`.

    Raises:
        ValueError: both clips are the same, or `info` is not JSON.
    """

    pair_id: str
    a: Clip
    b: Clip
    strategy: str
    """How the pair was chosen."""
    round: int
    """Round of the loop that asked first."""
    info: dict[str, Any] = field(default_factory=dict, hash=False)
    """Anything JSON that explains the choice."""

    def __post_init__(self) -> None:
        if self.a == self.b:
            raise ValueError(
                f"a pair needs two different clips, got {self.a.key} twice"
            )
        if self.round < 0:
            raise ValueError(f"round must not be negative, got {self.round}")
        if self.info:
            self._require_info()

    def _require_info(self) -> None:
        if self.gold not in (None, *_PREFERENCES):
            known = ", ".join(_PREFERENCES)
            raise ValueError(f"info['gold'] is one of {known}, got {self.gold!r}")
        to_json("info", self.info)

    @property
    def gold(self) -> Choice | None:
        """The known answer, from `info["gold"]`; None if it is an ordinary pair.

        Pairs with a known answer measure raters: they are asked now and then, and the
        queue is empty without them.
        """
        return self.info.get("gold")

    @property
    def meanwhile(self) -> int | None:
        """The round before which the pair was asked, on top of what rounds ask
        themselves; None if a round asked it."""
        found = self.info.get("meanwhile")
        return found.get("for_round") if isinstance(found, dict) else None

    @staticmethod
    def make(
        a: Clip,
        b: Clip,
        *,
        strategy: str,
        round: int,
        info: dict[str, Any] | None = None,
    ) -> Pair:
        """The pair of `a` and `b`; the same two in the same order have the same id."""
        text = "\n".join((QUESTION, a.key, b.key))
        pair_id = hashlib.sha256(text.encode()).hexdigest()
        return Pair(pair_id, a, b, strategy, round, {} if info is None else dict(info))


@dataclass(frozen=True, kw_only=True, slots=True)
class Answer:
    """What one rater said about one pair.

    Raises:
        ValueError: the answer contradicts itself; the message names the field.
    """

    answer_id: str
    """Made by the client, so that sending it twice does no harm."""
    pair_id: str
    rater_id: str
    choice: Choice
    p_a: float | None = None
    """Graded strength: probability that clip a is better; None where not asked."""
    shown_left: Side
    """Which clip was shown on the left."""
    shown_ms: int | None = None
    """How long the pair was on the screen."""
    watched_ms: int | None = None
    """How long the clips were playing."""
    response_ms: int | None = None
    """From the first frame to the answer."""
    confidence: float | None = None
    """How sure the rater says to be, in [0, 1]."""
    note: str = ""
    reason: str = ""
    """Why a clip is unusable, or both are equally bad."""
    supersedes: str | None = None
    """The answer this one corrects."""
    role: Role = "first"
    client: dict[str, Any] = field(default_factory=dict, hash=False)
    """Anything JSON about how it was shown."""
    created_utc: str
    """ISO 8601 with an offset."""
    why: Aspect | Literal[""] = ""
    """What of the gait decided it; empty where that was not said."""

    def __post_init__(self) -> None:
        for name in ("answer_id", "pair_id", "rater_id"):
            if not getattr(self, name):
                raise ValueError(f"{name} must not be empty")
        for name, allowed in _ALLOWED.items():
            if getattr(self, name) not in allowed:
                known = ", ".join(allowed)
                raise ValueError(f"{name} is one of {known}: {getattr(self, name)!r}")
        for name in ("p_a", "confidence"):
            value = getattr(self, name)
            if value is None:
                continue
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} must lie in [0, 1], got {value}")
            object.__setattr__(self, name, float(value))
        for name in ("shown_ms", "watched_ms", "response_ms"):
            value = getattr(self, name)
            if value is not None and not (
                type(value) is int and 0 <= value <= BIGGEST_INTEGER
            ):
                raise ValueError(f"{name} must be whole milliseconds, got {value!r}")
        if self.p_a is not None and not _agrees(self.choice, self.p_a):
            raise ValueError(f"choice {self.choice!r} contradicts p_a {self.p_a}")
        if self.why and self.choice not in ("a", "b"):
            raise ValueError(f"why {self.why!r} without a preference: {self.choice!r}")
        if self.supersedes == self.answer_id:
            raise ValueError(f"answer {self.answer_id} cannot correct itself")
        if self.role == "undo" and (self.supersedes is None or self.choice != "skip"):
            raise ValueError("an undo supersedes an answer and has the choice 'skip'")
        _parsed_utc(self.created_utc)
        to_json("client", self.client)

    @property
    def here_s(self) -> tuple[float, ...]:
        """Moments of both clips that the rater marked, since their beginning."""
        marked = self.client.get(HERE)
        if not isinstance(marked, list):
            return ()
        # Whoever wrote the data set may have written anything there.
        found = [m for m in marked if type(m) in (int, float) and 0 <= m <= LONGEST_S]
        return tuple(map(float, found[:MOST_HERE]))

    @property
    def target(self) -> float | None:
        """Probability that clip a is better; None if the answer is no preference."""
        if self.choice not in _PREFERENCES:
            return None
        return _PREFERENCES[self.choice] if self.p_a is None else self.p_a


def _agrees(choice: Choice, p_a: float) -> bool:
    if choice == "a":
        return p_a >= 0.5
    if choice == "b":
        return p_a <= 0.5
    return choice == "equal" and p_a == 0.5


def to_json(name: str, value: dict[str, Any]) -> str:
    """The one JSON text of `value`.

    Raises:
        ValueError: it holds something JSON has no word for.
    """
    if not value:
        return "{}"
    try:
        return json.dumps(value, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be JSON: {error}") from None


def utc_text(text: str) -> str:
    """Spell a time so that later times sort behind earlier ones.

    Raises:
        ValueError: it is not ISO 8601, or has no offset.
    """
    return _parsed_utc(text).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _parsed_utc(text: str) -> datetime:
    time = datetime.fromisoformat(text)
    if time.tzinfo is None:
        raise ValueError(f"{text!r} has no offset; write it as 2030-01-31T12:00:00Z")
    return time
