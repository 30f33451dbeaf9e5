"""What each robot of a team is paid of a reward that the team got.

Shapes: T steps, N robots of N / 2 teams, R = 2 robots, F + V columns of a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from torch import Tensor

from rewardmodel.team.stood_still import StandingCfg
from rewardmodel.team.team_reward import TeamReward

from .team_criteria import TeamCriterion

Pay = Literal["shares", "same", "counterfactual"]


@dataclass(frozen=True, eq=False)
class SharedPay:
    """A score of rollouts [T, N, F + V], robots 2i and 2i + 1 being a team."""

    model: TeamReward
    how: Pay
    """`shares`: its own part and half of the pair's. `same`: half of the whole.
    `counterfactual`: what the team would lose had it stood still."""
    standing: StandingCfg
    control_dt_s: float

    @property
    def history_steps(self) -> int:
        """Rows before a row that matter: for how long a robot would have stood."""
        if self.how != "counterfactual":
            return 0
        return self.standing.steps(self.control_dt_s)

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] per second of `features` [T, N, F + V]."""
        rows = features.unflatten(1, (-1, 2))
        if self.how == "counterfactual":
            worth = self.model.difference(
                rows, starts[:, ::2], self.standing, control_dt_s=self.control_dt_s
            )
            return worth.flatten(1)
        shares = self.model.shares(rows)
        if self.how == "shares":
            return shares.of_each.flatten(1)
        return (shares.whole / 2).repeat_interleave(2, dim=1)


@dataclass(frozen=True, eq=False)
class CriterionPay:
    """A criterion of a team as a score of rollouts: nobody knows whose it was, so each
    is paid half."""

    criterion: TeamCriterion
    history_steps: int = 0

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] per second of `features` [T, N, F + V]."""
        whole = self.criterion(features.unflatten(1, (-1, 2)))
        return (whole / 2).repeat_interleave(2, dim=1)
