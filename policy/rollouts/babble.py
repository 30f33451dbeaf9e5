"""Clips before anything was learned: legs swung in rhythms drawn at random.

Noise around the home pose shakes a robot on the spot, so that answers about it say
nothing of walking. A random rhythm hops, shuffles, turns and now and then walks.

Shapes: N environments.
"""

from __future__ import annotations

import hashlib
import math

import torch
from torch import Tensor

BABBLE_SHA256 = hashlib.sha256(b"gaitpref babble 1").hexdigest()
"""Stands for the policy in what is recorded of it."""

_GAITS = torch.tensor(
    [
        [0.0, 0.5, 0.5, 0.0],  # trot
        [0.0, 0.5, 0.0, 0.5],  # pace
        [0.0, 0.0, 0.5, 0.5],  # bound
        [0.0, 0.5, 0.75, 0.25],  # walk
    ]
)
"""Phase of each leg, FR FL RR RL, in cycles."""


class Babble:
    """An actor of open-loop rhythms, one for each environment, deaf to observations."""

    def __init__(
        self,
        num_envs: int,
        *,
        control_dt_s: float,
        action_scale_rad: float | Tensor,
        rng: torch.Generator,
    ) -> None:
        """Draw the rhythms: 1.5 to 3.5 Hz, strides of up to 0.3 rad at the thigh.

        `action_scale_rad` may be [12], where joints differ.
        """

        def uniform(low: float, high: float) -> Tensor:
            return low + (high - low) * torch.rand(num_envs, 1, generator=rng)

        gait = torch.randint(len(_GAITS), (num_envs,), generator=rng)
        self._phase = _GAITS[gait]  # [N, 4]
        self._cycle_per_step = uniform(1.5, 3.5) * control_dt_s
        hip_rad = thigh_rad = calf_rad = action_scale_rad
        if isinstance(action_scale_rad, Tensor):
            hip_rad, thigh_rad, calf_rad = action_scale_rad.view(4, 3).unbind(-1)
        self._thigh = uniform(0.05, 0.3) / thigh_rad
        self._calf = uniform(0.1, 0.3) / calf_rad
        self._hip = uniform(-0.1, 0.1) / hip_rad
        # How far a soft leg lags behind decides whether a rhythm goes forward, so the
        # stride is out of step with the lift by any part of a cycle.
        self._lag = 2 * math.pi * uniform(0.0, 1.0)
        # Longer strides on one side turn the robot.
        turn = uniform(-0.4, 0.4)
        self._side = torch.cat((1 - turn, 1 + turn, 1 - turn, 1 + turn), dim=1)
        self._step = 0

    def __call__(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        """Actions [N, 12]; joints hip, thigh, calf of each leg."""
        angle = 2 * math.pi * (self._phase + self._step * self._cycle_per_step)
        self._step += 1
        swing, lift = torch.cos(angle + self._lag), torch.sin(angle).clamp(min=0.0)
        hip = self._hip * swing
        thigh = self._thigh * self._side * swing + 0.5 * self._calf * lift
        calf = -self._calf * lift
        return torch.stack((hip, thigh, calf), dim=-1).flatten(1)
