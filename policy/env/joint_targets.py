"""What an action asks the joints for: an offset from a pose, within their ranges.

Shapes: N environments.
"""

from __future__ import annotations

import torch
from torch import Tensor

from policy.robots.robot import Robot

from .env_cfg import EnvCfg


class JointTargets:
    """Joint positions of actions, of this project's policies or under a law."""

    def __init__(self, robot: Robot, cfg: EnvCfg, device: torch.device) -> None:
        def constant(values: object) -> Tensor:
            return torch.tensor(values, dtype=torch.float32, device=device)

        low_high, law = constant(robot.joint_range), cfg.law
        self._rest = constant(robot.home_joint_pos)
        self.scale_rad: float | Tensor = cfg.action_scale_rad
        """Joint offset that an action of 1 asks for; [12] where joints differ."""
        if law is not None:
            self._rest = constant(law.canonical(law.action_offset_rad))
            self.scale_rad = constant(law.canonical(law.action_scale_rad))
            unbounded = ((-float("inf"), float("inf")),) * 12
            low_high = constant(law.canonical(law.target_clip_rad or unbounded))
        self._low, self._high = low_high.unbind(-1)

    def of(self, action: Tensor) -> Tensor:
        """Joint positions [N, 12] that `action` [N, 12] asks for, rad."""
        return (self._rest + self.scale_rad * action).clamp(self._low, self._high)

    def reach(self) -> Tensor:
        """[12] the action that asks for the farther end of each joint's range; infinite
        where there is none."""
        low, high = self._low - self._rest, self._high - self._rest
        return torch.maximum(low.abs(), high.abs()) / self.scale_rad
