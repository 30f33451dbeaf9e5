"""What moved the reward about the pairs that people answered last."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from rewardmodel.explain.credit import Credit, credit

from .credit_picture import credit_picture
from .crediting import Crediting, load_crediting
from .pictures import svg_of

COUNT = 2
"""Answers in a report."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Credited:
    """An answered pair and what of it moved the reward; A is the clip shown left."""

    pair: Pair
    answer: Answer
    credit: Credit
    dt_s: float

    @property
    def said(self) -> str:
        """The answer in words."""
        if self.answer.choice not in ("a", "b"):
            return "neither is better"
        left = self.answer.choice == self.answer.shown_left
        return f"{'A' if left else 'B'} is better"

    @property
    def agrees(self) -> bool:
        """Whether the reward leads to the clip that was preferred; a tie never does."""
        left = self.answer.choice == self.answer.shown_left
        return self.answer.choice in ("a", "b") and left == (self.credit.lead > 0)

    @property
    def title(self) -> str:
        """Who said what, and whether the reward thinks the same."""
        same = "" if self.agrees else ", the reward does not agree"
        return f"{self.answer.rater_id}: {self.said}{same}"


def newest_credited(
    reward: Crediting,
    dataset: Dataset,
    answered: Sequence[tuple[Pair, Answer]],
    count: int,
) -> list[Credited]:
    """The newest `count` answers that say something about a pair, the newest first."""
    told = [
        (pair, answer)
        for pair, answer in answered
        if answer.target is not None
        and all(dataset.holds(clip.rollout) for clip in (pair.a, pair.b))
    ]
    told.sort(key=lambda row: (row[1].created_utc, row[1].answer_id), reverse=True)
    return [credited(reward, dataset, *row) for row in told[:count]]


def answers_section(
    run: Path, rounds: list[dict[str, Any]], drawn: Callable[[], None] = lambda: None
) -> str:
    """The newest reward on the newest answers of a run; nothing before a fit. `drawn`
    is called after each picture."""
    numbers = [r["round"] for r in rounds if r.get("fit")]
    if not numbers:
        return ""
    try:
        reward = load_crediting(run / "rounds" / f"{max(numbers):02d}" / "reward")
        dataset = Dataset.open(run / "dataset")
        with dataset.answers_copy() as store:
            answered = store.current_answers()
        found = newest_credited(reward, dataset, answered, COUNT)
    except GaitprefError as error:
        return f"<p>No answers are explained: {html.escape(str(error))}</p>"
    figures = ""
    for each in found:
        picture = credit_picture(each.credit, dt_s=each.dt_s)
        figures += (
            f"<figure>{svg_of(picture.axes[0])}"
            f"<figcaption>{html.escape(each.title)}</figcaption></figure>"
        )
        drawn()
    return (
        f"<h2>What moved the reward of round {max(numbers)} in the newest answers</h2>"
        "<p>What the left clip, A, is paid more than the right one, shared out by the "
        "steps of both, by habits, and by gaits or robots where there are several; "
        f"each row adds up to the whole.{_whys_told(answered)}</p>"
        f'<div class="curves">{figures}</div>'
    )


def _whys_told(answered: Sequence[tuple[Pair, Answer]]) -> str:
    """How many answers say what decided them, and what; nothing where none does."""
    preferring = [answer for _, answer in answered if answer.choice in ("a", "b")]
    whys = Counter(answer.why for answer in preferring if answer.why)
    if not whys:
        return ""
    named = ", ".join(f"{why} {times}" for why, times in whys.most_common())
    return (
        f" Of {len(preferring)} answers that prefer a clip {whys.total()} say what "
        f"decided: {named}."
    )


def credited(
    reward: Crediting, dataset: Dataset, pair: Pair, answer: Answer
) -> Credited:
    """What of an answered pair moved the reward, as it was shown."""
    sides = (pair.a, pair.b) if answer.shown_left == "a" else (pair.b, pair.a)
    left, right = (reward.side(dataset, clip) for clip in sides)
    dt_s = dataset.entry(pair.a.rollout).meta.control_dt_s
    found = credit(left, right, fall_price=reward.fall_price, control_dt_s=dt_s)
    return Credited(pair=pair, answer=answer, credit=found, dt_s=dt_s)
