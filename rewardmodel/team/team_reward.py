"""The reward of a team: a sum of shares of its robots, and of the pair.

With z the standardised descriptors of each robot and y those of the pair, all clamped,

    reward = (w . z_1 + w . z_2) / 2 + v . y,

so that what is paid to either robot, its own part and half of the pair's, adds up to
the whole, step by step.

Shapes: T steps, E teams, R = 2 robots, F + V columns of a row, D descriptors of a
robot, P of the pair, M members, N = R E robots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from data.episodes.episode_records import EpisodeMeta
from data.features import column
from rewardmodel.cfg import FitCfg
from rewardmodel.descriptors.normaliser import Normaliser, fill_missing
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES, columns_seen, describe
from rewardmodel.errors import RewardError
from rewardmodel.models.fit_report import FitReport

from .pair_habits import PAIR_HABITS, PAIR_NAMES, describe_pair
from .stood_still import StandingCfg, had_stood


def either_fell(rows: Tensor) -> Tensor:
    """[...] bool, the steps of rows [..., R, F + V] at which a robot fell."""
    return (rows[..., column("fallen")][..., 0] > 0.5).any(dim=-1)


@dataclass(frozen=True)
class Walkers:
    """Which robots walk in a team, and how often they act.

    Raises:
        ValueError: no time lies between two actions.
    """

    robot: str
    """What they are called."""
    model_sha256: str
    """Hash of the world with both."""
    control_dt_s: float
    """Time between two actions."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.control_dt_s) and self.control_dt_s > 0):
            raise ValueError(f"a control step of {self.control_dt_s} s")

    @staticmethod
    def of(meta: EpisodeMeta) -> Walkers:
        """Those of an episode."""
        return Walkers(meta.robot, meta.model_sha256, meta.control_dt_s)

    @property
    def words(self) -> str:
        """Robot and rate."""
        return f"{self.robot} at {1 / self.control_dt_s:g} Hz"


@dataclass(frozen=True, eq=False)
class Shares:
    """What a reward is the sum of, step by step."""

    own: Tensor
    """[..., R] of each robot alone."""
    pair: Tensor
    """[...] of both together."""

    @property
    def whole(self) -> Tensor:
        """[...] the reward of the team."""
        return self.own.sum(dim=-1) + self.pair

    @property
    def of_each(self) -> Tensor:
        """[..., R] what each robot is paid: they add up to the whole."""
        return self.own + self.pair[..., None] / 2


@dataclass(frozen=True, eq=False)
class TeamReward:
    """A reward fitted to answers about teams."""

    own: Normaliser
    """Of descriptors [D] of one robot."""
    pair: Normaliser
    """Of descriptors [P] of the pair."""
    weights: Tensor
    """[M, D + P] of all members."""
    scale: float
    """What raw rewards, in logits, are divided by: their deviation over judged steps.
    """
    report: FitReport
    answers_sha256: str
    episodes: frozenset[str]
    """SHA-256 of the episodes in the answers."""
    walkers: Walkers | None = None
    """Whose answers they are about; None in older files, of which nobody can tell."""

    @property
    def names(self) -> tuple[str, ...]:
        """[D + P] of what it sees."""
        return (*DESCRIPTOR_NAMES, *PAIR_NAMES)

    @property
    def fall_price(self) -> float:
        """What a fall costs the team, in units of the reward."""
        return FitCfg().fall_logit / self.scale

    def require(self, walkers: Walkers, where: str) -> None:
        """
        Args:
            walkers: Who is to be paid, or told what it earned.
            where: What shows them, for the message.

        Raises:
            RewardError: it was fitted to other robots, or to another rate.
        """
        own = self.walkers
        if own is None:
            return
        if own.control_dt_s != walkers.control_dt_s or own.robot != walkers.robot:
            fitted, shown = own.words, walkers.words
        elif own.model_sha256 != walkers.model_sha256:
            fitted, shown = own.words, f"another model of {walkers.robot}"
        else:
            return
        raise RewardError(
            f"this reward was fitted to teams of {fitted}, and {where} is of "
            f"{shown}: what a robot earns is counted in steps of one robot at one "
            "rate; give one of `gaitpref team fit` about such teams"
        )

    def described(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Standardised descriptors [..., R, D] and [..., P] of rows [..., R, F + V]."""
        own = fill_missing(self.own(describe(rows)))
        return own, fill_missing(self.pair(describe_pair(rows)))

    def shares(self, rows: Tensor) -> Shares:
        """What is paid of rows [..., R, F + V]: the mean over the members."""
        own, pair = self.described(rows)
        w, v = self.agreed
        return Shares(own @ w / 2, pair @ v)

    @property
    def agreed(self) -> tuple[Tensor, Tensor]:
        """Weights [D] of a robot and [P] of the pair that are paid."""
        mean = self.weights.mean(dim=0) / self.scale
        return mean[: len(self.own.mean)], mean[len(self.own.mean) :]

    def spread(self, rows: Tensor) -> Tensor:
        """Deviation [...] of the whole over the members, for rows [..., R, F + V]."""
        own, pair = self.described(rows)
        seen = torch.cat([own.mean(dim=-2), pair], dim=-1)
        return (seen @ self.weights.mT / self.scale).std(dim=-1)

    def difference(
        self, rows: Tensor, starts: Tensor, cfg: StandingCfg, *, control_dt_s: float
    ) -> Tensor:
        """What each robot is worth to the team, [T, E, R]: the whole, less what it
        would be had this robot stood still for the last moments.

        Args:
            rows: [T, E, R, F + V].
            starts: [T, E] bool, first steps of episodes.
            cfg: How a robot stands.
            control_dt_s: Control step.
        """
        whole = self.shares(rows).whole
        without = [
            self.shares(
                had_stood(rows, starts, robot, cfg, control_dt_s=control_dt_s)
            ).whole
            for robot in (0, 1)
        ]
        return torch.stack([whole - each for each in without], dim=-1)

    def by_group(self, rows: Tensor) -> dict[str, Tensor]:
        """What groups of habits add, each [...], of rows [..., R, F + V]; they add up
        to the whole."""
        own, pair = self.described(rows)
        w, v = self.agreed
        parts = [
            *zip(
                columns_seen("habits"), (own.mean(dim=-2) * w).unbind(-1), strict=True
            ),
            *zip(PAIR_HABITS, (pair * v).unbind(-1), strict=True),
        ]
        found: dict[str, Tensor] = {}
        for habit, part in parts:
            found[habit.group] = (
                found[habit.group] + part if habit.group in found else part
            )
        return found
