"""What of a clip moved a reward, whatever the reward looks at: the habits of a robot,
which gait ran when, or both robots of a team.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np
import torch

from data.datasets.dataset import Dataset
from data.episodes.choices import choices_of
from data.episodes.clips import Clip
from data.episodes.team_rows import team_rows
from data.errors import FileError, GaitprefError
from data.files.files import read_json
from rewardmodel.answers.clip_batch import read_clips
from rewardmodel.explain.attribution import Method
from rewardmodel.explain.credit import Side
from rewardmodel.explain.four_ways import Run
from rewardmodel.models.model import RewardModel
from rewardmodel.models.storage import FACTS_NAME, load_reward
from rewardmodel.team.team_explained import explain_team
from rewardmodel.team.team_reward import TeamReward, Walkers, either_fell
from rewardmodel.team.team_storage import TEAM_FACTS, load_team


class Crediting(Protocol):
    """A reward that says what of a clip moved it."""

    @property
    def fall_price(self) -> float:
        """What a fall costs, in units of the reward."""
        ...

    def side(self, dataset: Dataset, clip: Clip) -> Side:
        """A clip of a data set, as the reward sees it.

        Raises:
            GaitprefError: the data set does not show what the reward looks at.
        """
        ...


@dataclass(frozen=True, eq=False)
class OfHabits:
    """A reward of the habits of one robot."""

    model: RewardModel
    method: Method = "auto"

    @property
    def fall_price(self) -> float:
        """See `Crediting`."""
        return self.model.provenance.cfg.fall_logit / float(self.model.reward_std)

    def side(self, dataset: Dataset, clip: Clip) -> Side:
        """See `Crediting`."""
        if dataset.entry(clip.rollout).meta.is_team:
            raise GaitprefError(
                f"{dataset.root} shows teams of two, of which this reward sees one "
                "robot: give one of `gaitpref team fit`"
            )
        return Side.of(
            self.model,
            read_clips([clip], dataset.clip_features),
            method=self.method,
            runs=runs_of(dataset, clip),
        )


@dataclass(frozen=True, eq=False)
class OfTeams:
    """A reward of teams."""

    model: TeamReward

    @property
    def fall_price(self) -> float:
        """See `Crediting`."""
        return self.model.fall_price

    def side(self, dataset: Dataset, clip: Clip) -> Side:
        """See `Crediting`."""
        meta = dataset.entry(clip.rollout).meta
        if not meta.is_team:
            raise GaitprefError(
                f"{dataset.root} shows one robot alone, and this reward is of teams of "
                "two: give one of `gaitpref fit`"
            )
        self.model.require(Walkers.of(meta), str(dataset.root))
        rows = torch.tensor(_rows(dataset, clip.rollout)[clip.rows])
        fallen = either_fell(rows)
        return Side(
            shown=explain_team(self.model, rows),
            scored=(~fallen).numpy(),
            fell=bool(fallen.any()),
        )


def load_crediting(directory: Path, method: Method = "auto") -> Crediting:
    """The reward in a directory: of `gaitpref fit`, `team fit` or `options`.

    Raises:
        RewardError: it holds none, or a damaged one.
    """
    if (directory / TEAM_FACTS).exists():
        return OfTeams(load_team(directory))
    if _holds_choices(directory):
        # A course is in a simulator, which no other reward needs.
        from gaitpref.options.choice_explained import OfChoices
        from gaitpref.options.choice_storage import load_choices

        return OfChoices(load_choices(directory))
    return OfHabits(load_reward(directory), method)


def _holds_choices(directory: Path) -> bool:
    """Whether its file is that of choices; a reward of habits has one of this name that
    says other things."""
    try:
        values = read_json(directory / FACTS_NAME)
    except (OSError, FileError):
        return False
    return isinstance(values, dict) and "told" in values and "linear" in values


def require_fitting(reward: Crediting, dataset: Dataset) -> None:
    """Make sure that a reward looks at what a data set shows, as far as its first
    episode tells.

    Raises:
        GaitprefError: it does not.
    """
    for entry in dataset.entries()[:1]:
        reward.side(dataset, Clip(entry.sha256, 0, 1))


@lru_cache(maxsize=2)
def _rows(dataset: Dataset, sha256: str) -> np.ndarray:
    """Rows of an episode, of which clips are mostly asked one after the other."""
    return team_rows(dataset.read(sha256))


def runs_of(dataset: Dataset, clip: Clip) -> list[Run]:
    """Which gait ran when in a clip; nothing of a policy of one."""
    entry = dataset.entry(clip.rollout)
    chosen = choices_of(entry.meta.extra, entry.num_steps)
    return chosen.runs(clip.rows) if chosen else []
