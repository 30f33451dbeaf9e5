"""What a rater is asked next, as a function of the answers so far.

Nothing is drawn by chance: a restart, a second tab and another server come to the same
plan, and the next pair can be loaded before it is needed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from typing import Literal

from data.answers.answer_records import Pair, Role, Side
from data.answers.overlap import Overlap
from data.answers.question_board import QuestionBoard
from data.answers.store import AnswerStore

Slot = Literal["ordinary", "repeat", "gold"]


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
    board: QuestionBoard,
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
        store: Where pairs and answers are.
        board: What is open there.
        rater_id: Who is asked.
        now: The time, with an offset.
        cfg: How much of it measures the rater.
        count: How many.
        ahead: Questions that are shown already and will be answered before.
        without: Ids of pairs that are shown already.
    """
    limit = count + len(without)
    pairs = board.open_pairs(rater_id, now.isoformat(), limit=limit)
    ordinary = [Next(pair) for pair in pairs if pair.pair_id not in without]
    first = board.count_answers(rater_id) + ahead
    chosen: list[Next] = []
    while len(chosen) < count and ordinary:
        number = first + len(chosen)
        taken = {*without, *(item.pair.pair_id for item in chosen)}
        special: Next | None = None
        match slot(rater_id, number, cfg):
            case "repeat":
                gap = cfg.repeat_gap - ahead - len(chosen)
                special = _repeat(store, board, rater_id, gap, without=taken)
            case "gold":
                special = _gold(store, board, rater_id, without=taken)
        chosen.append(special or ordinary.pop(0))
    return chosen


def _repeat(
    store: AnswerStore,
    board: QuestionBoard,
    rater_id: str,
    gap: int,
    *,
    without: Collection[str],
) -> Next | None:
    """An own pair that is asked again, its sides swapped."""
    found = board.repeatable(rater_id, gap)
    left = {pair_id: side for pair_id, side in found if pair_id not in without}
    if not left:
        return None
    pair_id = min(left, key=partial(_rank, rater_id))
    return Next(store.pair(pair_id), "repeat", "b" if left[pair_id] == "a" else "a")


def _gold(
    store: AnswerStore, board: QuestionBoard, rater_id: str, *, without: Collection[str]
) -> Next | None:
    """A pair whose answer is known."""
    left = [id for id in board.gold_pairs(rater_id) if id not in without]
    return Next(store.pair(min(left, key=partial(_rank, rater_id)))) if left else None


def _rank(rater_id: str, pair_id: str) -> int:
    return _hash(rater_id, pair_id, 0)


def _hash(rater_id: str, text: str, number: int) -> int:
    digest = hashlib.sha256(f"{rater_id}\n{text}\n{number}".encode()).digest()
    return int.from_bytes(digest[:8], "big")
