"""What a rater is asked next, as a function of the answers so far.

Nothing is drawn by chance: a restart, a second tab and another server come to the same
plan, and the next pair can be loaded before it is needed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

from data.answers import AnswerStore, Pair, Role, Side
from data.questions import Overlap, QuestionBoard

Slot = Literal["ordinary", "repeat", "gold"]
_HISTORY = 400
"""Answers among which one to repeat is looked for."""


@dataclass(frozen=True, kw_only=True)
class PlanCfg:
    """How much of a rater's work measures the rater."""

    repeat_share: float = 0.05
    """Share of a rater's questions that are own pairs with the sides swapped."""
    repeat_gap: int = 10
    """Answers in between, at least, so that the first one is forgotten."""
    gold_share: float = 0.05
    """Share of a rater's questions whose answer is known."""
    overlap: Overlap = field(default_factory=Overlap)
    """Pairs that several people answer."""

    def __post_init__(self) -> None:
        for name in ("repeat_share", "gold_share"):
            if not 0.0 <= getattr(self, name) <= 0.5:
                raise ValueError(
                    f"{name} must lie in [0, 0.5], got {getattr(self, name)}"
                )


@dataclass(frozen=True)
class Next:
    """A question that is planned."""

    pair: Pair
    role: Role = "first"
    shown_left: Side | None = None
    """None: left to chance."""


def slot(rater_id: str, number: int, cfg: PlanCfg) -> Slot:
    """Kind of a rater's question `number`, counted from 0.

    Of every 1/share questions exactly one is a repeat; which one cannot be foreseen.
    """
    for kind, share in (("repeat", cfg.repeat_share), ("gold", cfg.gold_share)):
        if share > 0.0:
            block, position = divmod(number, round(1.0 / share))
            if position == _hash(rater_id, kind, block) % round(1.0 / share):
                return "repeat" if kind == "repeat" else "gold"
    return "ordinary"


def plan(
    store: AnswerStore,
    rater_id: str,
    now: datetime,
    cfg: PlanCfg,
    *,
    count: int = 1,
    ahead: int = 0,
    without: Collection[str] = (),
) -> list[Next]:
    """The next `count` questions of a rater, fewer if there are not so many.

    Args:
        ahead: Questions that are shown already and will be answered before.
        without: Ids of pairs that are shown already.
    """
    board = QuestionBoard(store)
    limit = count + len(without)
    pairs = board.open_pairs(rater_id, now.isoformat(), cfg.overlap, limit=limit)
    ordinary = [Next(pair) for pair in pairs if pair.pair_id not in without]
    first = store.count(rater_id=rater_id) + ahead
    chosen: list[Next] = []
    while len(chosen) < count and ordinary:
        number = first + len(chosen)
        taken = {*without, *(item.pair.pair_id for item in chosen)}
        special: Sequence[Next] = ()
        match slot(rater_id, number, cfg):
            case "repeat":
                special = repeats(store, rater_id, cfg.repeat_gap - ahead - len(chosen))
            case "gold":
                special = [Next(pair) for pair in board.gold_pairs(rater_id)]
        left = [item for item in special if item.pair.pair_id not in taken]
        if left:
            chosen.append(min(left, key=lambda item: _rank(rater_id, item.pair)))
        else:
            chosen.append(ordinary.pop(0))
    return chosen


def repeats(store: AnswerStore, rater_id: str, gap: int) -> list[Next]:
    """Own pairs that can be asked again: judged, not recent, not asked twice yet."""
    history = store.history(rater_id, _HISTORY)
    again = {pair.pair_id for pair, answer in history if answer.role == "repeat"}
    return [
        Next(pair, "repeat", "b" if answer.shown_left == "a" else "a")
        for pair, answer in history[max(gap, 0) :]
        if answer.target is not None
        and pair.gold is None
        and pair.pair_id not in again
        and answer.role == "first"
    ]


def _rank(rater_id: str, pair: Pair) -> int:
    return _hash(rater_id, pair.pair_id, 0)


def _hash(rater_id: str, text: str, number: int) -> int:
    digest = hashlib.sha256(f"{rater_id}\n{text}\n{number}".encode()).digest()
    return int.from_bytes(digest[:8], "big")
