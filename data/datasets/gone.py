"""Episodes that answers are about and a data set lists no more, as after `recover`.

Whoever fits, asks or answers leaves such pairs out, says how many, and goes on. An
episode that is listed and whose file is missing is damage, and refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from data.answers.answer_records import Pair

from .dataset import Dataset


def listed_in(datasets: Sequence[Dataset]) -> Callable[[Pair], bool]:
    """Whether both episodes of a pair are listed in one of the data sets."""
    known: dict[str, bool] = {}

    def holds(sha256: str) -> bool:
        if sha256 not in known:
            known[sha256] = any(dataset.holds(sha256) for dataset in datasets)
        return known[sha256]

    return lambda pair: holds(pair.a.rollout) and holds(pair.b.rollout)


def pairs_gone(dataset: Dataset) -> str:
    """That pairs and answers are left out as their episodes are gone; or nothing."""
    listed = listed_in([dataset])
    with dataset.answers_copy() as store:
        pairs, answered = store.pairs(), store.current_answers()
    gone = sum(not listed(pair) for pair in pairs)
    if not gone:
        return ""
    answers = sum(not listed(pair) for pair, _ in answered)
    found = told_gone(answers, len(answered), dataset.root)
    return found or told_gone(gone, len(pairs), dataset.root, what="pairs")


def told_gone(gone: int, of: int, root: Path, *, what: str = "answers") -> str:
    """That so many are left out as their episodes are gone, in words; or nothing."""
    if not gone:
        return ""
    return (
        f"{gone} of {of} {what} are about episodes that are gone and are left out; "
        f"`gaitpref data subset --dataset {root} --out NEW` makes a clean copy"
    )
