"""Who answers, and what learns from it, by what a data set shows: a robot, teams, or
gaits that follow one another.
"""

from __future__ import annotations

from data.answers.answer_records import MIN_ANSWERS
from data.datasets.dataset import Dataset
from data.episodes.choices import GAITS

_CLIP_S = 8.0
"""A clip in which gaits change is longer, up to this."""


def next_pairs(dataset: Dataset, count: int = 40) -> str:
    """What chooses questions about a data set."""
    longer = ""
    if _gaits(dataset):
        length_s = max(e.num_steps * e.meta.control_dt_s for e in dataset.entries())
        longer = f" --clip-s {min(_CLIP_S, length_s):g}"
    return (
        f"`gaitpref pairs --dataset {dataset.root} --count {count}{longer}` chooses "
        "what to ask"
    )


def next_answers(dataset: Dataset, answers: str | None = None) -> str:
    """Who answers the open pairs; `answers` is where a command said they are."""
    at = f"--dataset {dataset.root}"
    kept = at if answers is None else f"{at} --answers {answers}"
    asks = f"`gaitpref label {kept} --no-auth --open` asks you"
    if _gaits(dataset):
        return asks
    if _shows_teams(dataset):
        return f"{asks}, `gaitpref team answer {at}` a program"
    return f"{asks}, `gaitpref answer {kept} --criterion high_step` a program"


def next_fit(dataset: Dataset) -> str:
    """What learns from the answers about a data set."""
    at = f"--dataset {dataset.root}"
    if gaits := _gaits(dataset):
        files = " ".join(f"--policy {name}=FILE" for name in gaits)
        return (
            f"`gaitpref options {files} {at} --out NEW` fits a reward of choices to "
            "the answers, and trains on it"
        )
    kind = "team fit" if _shows_teams(dataset) else "fit"
    return f"`gaitpref {kind} {at} --out REWARD` fits a reward to the answers"


def next_once_answered(dataset: Dataset, answers: str | None = None) -> str:
    """What learns from the answers, or who gives them while there are too few."""
    with dataset.answers_copy() as store:
        given = store.count()
    if given >= MIN_ANSWERS:
        return next_fit(dataset)
    return (
        f"a fit needs {MIN_ANSWERS} answers, of which there are {given}: "
        f"{next_answers(dataset, answers)}"
    )


def _shows_teams(dataset: Dataset) -> bool:
    return any(entry.meta.is_team for entry in dataset.entries()[:1])


def _gaits(dataset: Dataset) -> list[str]:
    """Names of the gaits that follow one another; none of a policy of one."""
    return [
        name
        for entry in dataset.entries()[:1]
        for name in entry.meta.extra.get(GAITS, "").split(",")
        if name
    ]
