"""Whether a policy may learn in the mirror: what it is for must not tell sides apart.

Shapes: T steps, N episodes, F feature columns.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from policy.robots.robot import Robot
from policy.training.mirror import has_mirror, mirror_of
from policy.training.ppo import PpoCfg, ScoreFn

_APART = 0.05
"""Mean difference of the rewards of a step and of its mirror image, in deviations of
the reward, from which on a reward tells left from right."""


def tells_sides_apart(reward: ScoreFn, robot: Robot, features: Tensor) -> bool:
    """Whether `reward` pays episodes [T, N, F] of a robot whose sides are alike
    otherwise than their mirror images."""
    starts = torch.zeros(features.shape[:2], dtype=torch.bool)
    starts[0] = True
    with torch.inference_mode():
        paid = reward(features, starts)
        mirrored = reward(mirror_of(robot).rows(features), starts)
    return bool((mirrored - paid).abs().mean() > _APART * paid.std())


def in_mirror(
    ppo: PpoCfg,
    robot: Robot,
    reward: ScoreFn | None = None,
    features: Tensor | None = None,
) -> PpoCfg:
    """`ppo` learning from every step in the mirror too, where that is no other task.

    Args:
        ppo: The algorithm; one whose critic sees the truth, or with a KL penalty, stays
            as it is.
        robot: Nothing is mirrored where its sides differ.
        reward: What is learned; None is the task, to which left and right are alike.
        features: Episodes [T, N, F] on which to see whether `reward` is like that.
    """
    if ppo.privileged_critic or ppo.kl_penalty is not None or not has_mirror(robot):
        return ppo
    alike = (
        reward is None
        or features is None
        or not tells_sides_apart(reward, robot, features)
    )
    return replace(ppo, mirror=alike)
