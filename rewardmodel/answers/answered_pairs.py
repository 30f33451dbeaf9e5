"""Answered pairs of one or several data sets, as tensors to fit a reward to.

Shapes: B pairs, T steps, F features. Left is clip `a` of a pair, right is clip `b`.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np
import torch
from torch import Tensor

from data.answers.answer_records import MIN_ANSWERS, Pair
from data.answers.rater_habits import Sides
from data.answers.strategy_names import (
    APPROVAL,
    ARENA,
    ASKED_AGAIN,
    DRIVEN,
    NEEDS_MODEL,
)
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.files.telling import Tell, silent
from rewardmodel.errors import RewardError

from .clip_batch import ClipBatch, fill_clips, with_past
from .recorded import RecordedClips, recorded_clips
from .used import LeftOut, UsedAnswers, answers_used, count_preferences
from .used import count_evidence as count_evidence


@dataclass(frozen=True, eq=False)
class AnsweredPairs:
    """Pairs of clips with what was answered, a row for every answer."""

    left: ClipBatch
    """[B, T, F]."""
    right: ClipBatch
    """[B, T, F], padded to the same T."""
    target: Tensor
    """[B] float32, probability that the left clip is better."""
    episodes: tuple[tuple[str, str], ...]
    """SHA-256 of the episode of the left and of the right clip."""
    raters: tuple[str, ...]
    """Who answered."""
    commands: Tensor
    """[B, 3] forward m/s, left m/s, yaw rad/s asked for."""
    rounds: tuple[int, ...]
    """Round of the loop that asked."""
    strategies: tuple[str, ...]
    """How each pair was chosen."""
    num_without_target: int
    """Answers left out, because they neither prefer a clip nor call both equal."""
    answers_sha256: str
    """Hash of the answers used, whatever their order: the label set."""
    whys: tuple[str, ...] = ()
    """What each answer was said to be about, an aspect or ""; empty: nobody said."""
    times: tuple[str, ...] = ()
    """When each answer was given, ISO 8601; empty: nobody knows."""
    clips: tuple[tuple[str, str], ...] = ()
    """What the left and the right clip are called; empty where nobody knows, and no two
    answers are taken to be about the same clips."""
    num_collected: int = 0
    """Answers there were to choose from."""
    num_gone: int = 0
    """Answers left out because an episode they are about is gone."""
    sides: tuple[Sides, ...] = ()
    """Which side of the screen each rater prefers, in all answers of the data sets."""
    left_out: LeftOut = field(default_factory=LeftOut)
    """Whose answers were left out."""
    recorded: RecordedClips | None = None
    """What else there is of the kind that was judged; None where nobody knows."""

    def __post_init__(self) -> None:
        sizes = {
            "left": len(self.left),
            "right": len(self.right),
            "target": len(self.target),
            "episodes": len(self.episodes),
            "raters": len(self.raters),
            "commands": len(self.commands),
            "rounds": len(self.rounds),
            "strategies": len(self.strategies),
            "clips": len(self.clips or self.target),
            "whys": len(self.whys or self.target),
            "times": len(self.times or self.target),
        }
        if len(set(sizes.values())) != 1 or len(self.target) == 0:
            raise ValueError(f"answered pairs need rows of one number > 0, got {sizes}")
        if self.left.valid.shape != self.right.valid.shape:
            raise ValueError("left and right clips must be padded to one length")
        if not ((self.target >= 0) & (self.target <= 1)).all():
            raise ValueError("targets must lie in [0, 1]")

    def __len__(self) -> int:
        return len(self.target)

    def subset(self, chosen: Tensor) -> AnsweredPairs:
        """The answers marked in `chosen` [B] (bool); at least one."""
        rows = chosen.nonzero()[:, 0].tolist()
        return replace(
            self,
            left=self.left.part(rows),
            right=self.right.part(rows),
            target=self.target[rows],
            episodes=tuple(self.episodes[row] for row in rows),
            raters=tuple(self.raters[row] for row in rows),
            commands=self.commands[rows],
            rounds=tuple(self.rounds[row] for row in rows),
            strategies=tuple(self.strategies[row] for row in rows),
            whys=tuple(self.whys[row] for row in rows) if self.whys else (),
            times=tuple(self.times[row] for row in rows) if self.times else (),
            clips=tuple(self.clips[row] for row in rows) if self.clips else (),
        )

    @property
    def num_preferences(self) -> int:
        """Answers that prefer a clip, without those that others take back."""
        apart = [(f"{row} left", f"{row} right") for row in range(len(self))]
        return count_preferences(self.clips or apart, self.target.tolist())

    @property
    def too_little(self) -> str:
        """That too few answers prefer a clip to make a reward, in words; or nothing."""
        preferences = self.num_preferences
        if preferences >= MIN_ANSWERS:
            return ""
        return (
            f"{preferences} of {len(self)} answers prefer a clip and are not taken "
            f"back by another, a reward needs {MIN_ANSWERS}"
        )

    @property
    def at_random(self) -> Tensor:
        """[B] bool: no reward chose the pair for being hard, no person for what it
        shows, and nobody to compare two policies."""
        chosen = (*NEEDS_MODEL, ASKED_AGAIN, DRIVEN, APPROVAL, ARENA)
        return torch.tensor([name not in chosen for name in self.strategies])

    @property
    def fell(self) -> Tensor:
        """[B, 2] bool: the left, the right clip ends in a fall."""
        return torch.stack([self.left.fell, self.right.fell], dim=-1)


def load_pairs(
    datasets: Sequence[Dataset],
    *,
    at_least: int = MIN_ANSWERS,
    unchecked: bool = False,
    tell: Tell = silent,
) -> AnsweredPairs:
    """Gather the current answers of `datasets`, in an order that depends on them alone.

    An answer found in several data sets counts once; a clip may lie in another data set
    than the answer about it. A rater who was asked about a pair again counts once too,
    with the mean of both answers: a contradiction says that the clips are close. Pairs
    with a known answer measure raters and teach nothing.

    Answers about an episode that no data set lists any more are left out and counted,
    those of programs that do not agree with people are left out too.

    Args:
        datasets: Any number.
        at_least: Answers that must prefer a clip.
        unchecked: Take the answers of all programs.
        tell: Gets the clips that are read.

    Raises:
        RewardError: fewer than `at_least` answers prefer a clip, without those that
            others take back, or none has a target.
        DatasetError, EpisodeError: an episode is missing or damaged.
    """
    used = answers_used(datasets, unchecked=unchecked)
    if used.preferences < at_least or not used.rows:
        raise RewardError(_too_few(datasets, used, max(1, at_least)))
    gathered = gather_pairs(datasets, [row.pair for row in used.rows], tell)
    return replace(
        gathered,
        target=torch.tensor([row.target for row in used.rows]),
        raters=tuple(row.rater_id for row in used.rows),
        whys=tuple(row.why for row in used.rows),
        times=tuple(row.created_utc for row in used.rows),
        num_without_target=used.without_target,
        num_collected=used.collected,
        num_gone=used.gone,
        sides=used.sides,
        left_out=used.left_out,
        answers_sha256=_label_set(row.line for row in used.rows),
        recorded=recorded_clips(datasets),
    )


def gather_pairs(
    datasets: Sequence[Dataset], pairs: Sequence[Pair], tell: Tell = silent
) -> AnsweredPairs:
    """The clips of `pairs`, at least one, as if nobody had answered: a tie by "".
    `tell` gets the clips that are read.

    Raises:
        DatasetError, EpisodeError: an episode is missing or damaged.
    """
    owner = _owners(datasets)
    sides = [pair.a for pair in pairs] + [pair.b for pair in pairs]
    clips = fill_clips([clip.steps for clip in sides], _rows(sides, owner, tell))
    entries = [owner(pair.a.rollout).entry(pair.a.rollout) for pair in pairs]
    return AnsweredPairs(
        left=clips.part(slice(len(pairs))),
        right=clips.part(slice(len(pairs), None)),
        target=torch.full((len(pairs),), 0.5),
        episodes=tuple((pair.a.rollout, pair.b.rollout) for pair in pairs),
        raters=("",) * len(pairs),
        commands=torch.tensor([entry.meta.command for entry in entries]),
        rounds=tuple(pair.round for pair in pairs),
        strategies=tuple(pair.strategy for pair in pairs),
        clips=tuple((pair.a.key, pair.b.key) for pair in pairs),
        num_without_target=0,
        answers_sha256="",
    )


def _owners(datasets: Sequence[Dataset]) -> Callable[[str], Dataset]:
    """Finds the data set of an episode; the first one if none has it, so that it says
    what is missing."""
    if len(datasets) == 1:
        return lambda sha256: datasets[0]
    owners = {e.sha256: dataset for dataset in datasets for e in dataset.entries()}
    return lambda sha256: owners.get(sha256, datasets[0])


def _rows(
    clips: Sequence[Clip], owner: Callable[[str], Dataset], tell: Tell
) -> Iterator[tuple[int, np.ndarray]]:
    """Position of every clip, and feature rows of it and of what came before, so that
    each episode is read once."""
    by_owner: dict[Dataset, list[int]] = defaultdict(list)
    for position, clip in enumerate(clips):
        by_owner[owner(clip.rollout)].append(position)
    done = count(1)
    for dataset, positions in by_owner.items():
        own = [with_past(clips[position]) for position in positions]
        for index, rows in dataset.each_clip_features(own):
            tell(next(done), len(clips))
            yield positions[index], rows


def _label_set(lines: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _too_few(datasets: Sequence[Dataset], used: UsedAnswers, needed: int) -> str:
    roots = [str(dataset.root) for dataset in datasets] or ["DIR"]
    ties = sum(row.target == 0.5 for row in used.rows)
    others = [
        f"{ties} call both clips equal" * bool(ties),
        f"{used.gone} are about episodes that are gone" * bool(used.gone),
        *used.left_out.told,
    ]
    besides = "".join(f", {words}" for words in others if words)
    of_teams = any(e.meta.is_team for dataset in datasets for e in dataset.entries())
    by_command = (
        f"`gaitpref team answer --dataset {roots[0]}`"
        if of_teams
        else f"`gaitpref answer --dataset {roots[0]} --criterion C`"
    )
    return (
        f"{' and '.join(roots)}: {used.preferences} of {used.collected} answers prefer "
        f"a clip and are not taken back by another{besides}; a fit needs at least "
        f"{needed}; collect {needed - used.preferences} more on the labeling page or "
        f"with {by_command}"
    )
