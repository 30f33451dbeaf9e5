"""Who of several raters wants the same, in words, and answers of some of them.

Apart from the other commands about raters, as it needs torch.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from shlex import quote
from typing import Any

import torch

from data.datasets.dataset import Dataset
from gaitpref.console.progress import counted
from gaitpref.method.method import STYLE
from rewardmodel.answers.answered_pairs import MIN_ANSWERS, AnsweredPairs, load_pairs
from rewardmodel.answers.program_agreement import RULE
from rewardmodel.errors import RewardError
from rewardmodel.posterior.group_raters import Group, Grouping, group_raters

GROUP = "group:"
"""Before the name of a rater whose group is meant."""
_ENOUGH_TO_TELL = 12
"""Answers of a rater from which on a report says who wants the same."""


def grouping_of(pairs: AnsweredPairs, where: str = "") -> Grouping:
    """The groups of those who answered `pairs`; `where` is said before what is done."""
    raters = len(set(pairs.raters))
    doing = f"{where}comparing the wishes of {raters} raters"
    if raters == 1:
        doing = f"{where}looking whether the rater's wish has changed"
    with counted(doing) as tell:
        return group_raters(pairs, STYLE.reward, seed=0, tell=tell)


def told_of_groups(dataset: Dataset) -> tuple[dict[str, Any], list[str]]:
    """Groups of a data set's raters as plain values, and in lines.

    Raises:
        GaitprefError: there are too few answers.
    """
    pairs = load_pairs([dataset], unchecked=True)
    found = grouping_of(pairs)
    lines = told(found, dataset.root)
    values = {
        "groups": [
            {
                "raters": list(group.raters),
                "answers": group.answers,
                "wanted": [asdict(wanted) for wanted in group.wanted],
            }
            for group in found.groups
        ],
        "changed": [asdict(each) for each in found.changed],
        "untold": list(found.untold),
    }
    return values, lines


def who_agrees(
    dataset: Dataset, *, unchecked: bool, alone: bool, where: str = ""
) -> list[str]:
    """Who of several raters wants the same, and what, in lines; nothing of those who
    gave too few answers to tell.

    Args:
        dataset: With the answers.
        unchecked: Whether programs count that do not agree with people.
        alone: Whether it is told of a single rater, too, that the wish has changed.
        where: Said before what is done.
    """
    try:
        pairs = load_pairs([dataset], unchecked=unchecked)
    except RewardError:
        return []
    given = Counter(pairs.raters)
    enough = [given[rater] >= _ENOUGH_TO_TELL for rater in pairs.raters]
    raters = len({r for r, kept in zip(pairs.raters, enough, strict=True) if kept})
    if raters == 0 or (raters == 1 and not alone):
        return []
    found = grouping_of(pairs.subset(torch.tensor(enough)), where)
    return list(_changes(found)) if raters == 1 else told(found, dataset.root)


def answers_for(pairs: AnsweredPairs, whom: Sequence[str]) -> AnsweredPairs:
    """The answers of some raters: of their names, or `group:NAME`, of all who want the
    same as NAME.

    Raises:
        RewardError: somebody gave no answer, or too few prefer a clip.
    """
    known = sorted(set(pairs.raters))
    for name in pairs.left_out.raters:
        if name in whom:
            raise RewardError(
                f"--for {name}: the answers of {name} are left out; `gaitpref raters "
                f"--dataset DIR take-in {name}` takes them in again"
            )
    for each in pairs.left_out.programs:
        if each.rater_id in whom:
            raise RewardError(
                f"--for {each.rater_id}: it {each}, {RULE} to teach; --unchecked takes "
                "its word"
            )
    for name in whom:
        if name.removeprefix(GROUP) not in known:
            raise RewardError(
                f"--for {name}: no such rater answered; there are {', '.join(known)}"
            )
    grouping = None
    chosen: set[str] = set()
    for name in whom:
        if not name.startswith(GROUP):
            chosen.add(name)
            continue
        grouping = grouping or grouping_of(pairs)
        group = grouping.group_of(name.removeprefix(GROUP))
        if group is None:
            raise RewardError(
                f"--for {name}: of so many raters only those with most answers are "
                "compared; give the name of one of these, or of raters"
            )
        chosen.update(group.raters)
    part = pairs.subset(torch.tensor([rater in chosen for rater in pairs.raters]))
    # Whoever compares the label set sees that it is another.
    of_whom = "\n".join((pairs.answers_sha256, *sorted(chosen)))
    part = replace(
        part,
        sides=tuple(each for each in pairs.sides if each.rater_id in chosen),
        answers_sha256=hashlib.sha256(of_whom.encode()).hexdigest(),
    )
    if part.too_little:
        raise RewardError(
            f"--for {' '.join(whom)}: {part.num_preferences} answers prefer a clip, a "
            f"fit needs {MIN_ANSWERS}; ask them more, or leave --for out"
        )
    return part


def told(found: Grouping, dataset: Path) -> list[str]:
    """What was found of the raters of `dataset`, in lines."""
    return [*_groups(found, dataset), *_changes(found)]


def _groups(found: Grouping, dataset: Path) -> Iterator[str]:
    if len(found.groups) == 1:
        (group,) = found.groups
        yield f"all want the same: {_names(group)}"
        yield f"  {_wants(group)}"
    else:
        yield f"{len(found.groups)} groups want different things:"
        for group in found.groups:
            yield f"  {_names(group)} ({group.answers} answers)"
            yield f"    {_wants(group)}"
        first = found.groups[0].raters[0]
        yield (
            f"`gaitpref fit --dataset {quote(str(dataset))} --out REWARD --for "
            f"{quote(GROUP + first)}` learns what one group wants, without --for what "
            "most want"
        )
    if found.untold:
        yield f"with too few answers to be compared: {', '.join(found.untold)}"


def _changes(found: Grouping) -> Iterator[str]:
    for each in found.changed:
        yield (
            f"{each.rater} seems to want something else since answer {each.after + 1} "
            f"(odds {_odds(each.log_odds)} to 1), and a fit learns from both: to teach "
            f"what {each.rater} wants now, begin another data set or run"
        )


def _names(group: Group) -> str:
    return ", ".join(group.raters)


def _wants(group: Group) -> str:
    if not group.wanted:
        return "what they want is open: ask them more"
    return "; ".join(
        f"{wanted.how} {wanted.habit} ({wanted.probability:.0%})"
        for wanted in group.wanted
    )


def _odds(log_odds: float) -> str:
    return f"{math.exp(log_odds):.0f}" if log_odds < 10 else "more than 20,000"
