"""Which moment, habit and robot the reward of a team likes.

Shapes: K steps, R = 2 robots, F + V columns of a row, G groups.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from rewardmodel.explain.attribution import Explanation

from .team_reward import TeamReward


def explain_team(model: TeamReward, rows: Tensor) -> Explanation:
    """Share the reward of the steps of a clip with rows [K, R, F + V].

    Shares are exact: a reward of a team is linear in what it sees.
    """
    with torch.inference_mode():
        shares, groups = model.shares(rows), model.by_group(rows)
        spread = model.spread(rows)
    by_group = torch.stack(tuple(groups.values()), dim=-1)
    return Explanation(
        reward=shares.whole.numpy(),
        spread=spread.numpy(),
        groups=tuple(groups),
        shares=by_group.numpy(),
        descriptors=np.full((len(rows), len(model.names)), np.nan),
        names=model.names,
        average=0.0,
        method="exact",
        robots=shares.of_each.numpy(),
    )
