"""Styles as criteria: what one row shows, and what only a stretch of rows shows.

Shapes: F feature columns, T steps, N environments.
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.features import column

TROT_HZ = 2.5
"""Stride frequency of `trot` where none is given."""
_WINDOW_S = 1.0
"""Time over which touch-downs are counted: two strides and more."""
_MIN_WINDOW_S = 0.4
"""Time a count is divided by at least, at the start of an episode."""
_TOLERANCE_HZ = 0.4
"""Error of the stride frequency at which 1/e of its share is left."""


def smooth(features: Tensor) -> Tensor:
    """Small changes of the action and no shaking of the trunk, in (0, 1]."""
    jerk = features[..., column("action_rate")].square().sum(dim=-1)
    shaking = features[..., column("base_ang_vel_b")][..., :2].square().sum(dim=-1)
    return 1.0 / (1.0 + jerk + 0.5 * shaking)


def high_step(features: Tensor) -> Tensor:
    """Feet lifted high in their swing: height over 0.15 m, averaged over the feet."""
    lifted = features[..., column("foot_height")].clamp(0.0, 0.15) / 0.15
    swinging = 1.0 - features[..., column("foot_contact")]
    return (lifted * swinging).mean(dim=-1)


def crouch(features: Tensor, *, walking_height_m: float) -> Tensor:
    """A trunk carried at three quarters of its walking height, in (0, 1]."""
    height = features[..., column("base_height")][..., 0]
    return torch.exp(-((height - 0.75 * walking_height_m) / 0.04).square())


def low_energy(features: Tensor) -> Tensor:
    """Little mechanical power, in (0, 1]; 1/2 at 50 W."""
    torque = features[..., column("joint_torque")]
    power_w = (torque * features[..., column("joint_vel")]).abs().sum(dim=-1)
    return 1.0 / (1.0 + power_w / 50.0)


def pace(features: Tensor) -> Tensor:
    """Both legs of one side down and both of the other up, in [0, 1]."""
    right_front, left_front, right_rear, left_rear = _contacts(features)
    return (right_front + right_rear - left_front - left_rear).abs() / 2.0


def two_beat(features: Tensor) -> Tensor:
    """One pair of diagonal legs down and the other up, in [0, 1]."""
    right_front, left_front, right_rear, left_rear = _contacts(features)
    return (right_front + left_rear - left_front - right_rear).abs() / 2.0


def get_up(features: Tensor, *, walking_height_m: float) -> Tensor:
    """An upright trunk, then its walking height, then rest, in [0, 1]."""
    upright = (1.0 - features[..., column("gravity_b")][..., 2]) / 2.0
    height = features[..., column("base_height")][..., 0] / walking_height_m
    joint_speed = features[..., column("joint_vel")].square().mean(dim=-1)
    at_rest = 1.0 / (1.0 + joint_speed / 4.0)
    raised = height.clamp(0.0, 1.0)
    return upright.clamp(0.0, 1.0) * (1.0 + raised + raised * at_rest) / 3.0


def trot(
    features: Tensor, starts: Tensor, *, frequency_hz: float, control_dt_s: float
) -> Tensor:
    """A two-beat trot whose legs step at `frequency_hz`, in [0, 1].

    Half of the score is for the two beats alone, the other half for the frequency: the
    touch-downs of all feet within the last second, divided by four and by the time
    that was looked at.

    Args:
        features: Rows [T, N, F].
        starts: [T, N] first steps of an episode, before which nothing is looked at.
        frequency_hz: Strides a second.
        control_dt_s: Time between two rows.

    Returns:
        Score [T, N].
    """
    contact = features[..., column("foot_contact")] > 0.5
    landed = torch.zeros_like(contact)
    landed[1:] = contact[1:] & ~contact[:-1] & ~starts[1:, :, None]
    touch_downs, looked_at = _within(
        landed.sum(dim=-1).float(), starts, round(_WINDOW_S / control_dt_s)
    )
    elapsed_s = (looked_at * control_dt_s).clamp_min(_MIN_WINDOW_S)
    error_hz = touch_downs / 4.0 / elapsed_s - frequency_hz
    in_time = torch.exp(-(error_hz / _TOLERANCE_HZ).square())
    return two_beat(features) * (1.0 + in_time) / 2.0


def trot_history_steps(control_dt_s: float) -> int:
    """Rows before a row that `trot` looks at."""
    return round(_WINDOW_S / control_dt_s)


def _contacts(features: Tensor) -> tuple[Tensor, ...]:
    """Contact of FR, FL, RR and RL, each [...], 0 or 1."""
    return features[..., column("foot_contact")].unbind(dim=-1)


def _within(values: Tensor, starts: Tensor, steps: int) -> tuple[Tensor, Tensor]:
    """Sums of values [T, N] over the last `steps` steps of the episode at hand.

    Returns:
        The sums and the number of steps each is taken over, both [T, N].
    """
    time = torch.arange(len(values), device=values.device)[:, None]
    begun = torch.where(starts, time, 0).cummax(dim=0).values
    before = torch.maximum(begun, time - steps + 1)
    sums = torch.cat([torch.zeros_like(values[:1]), values.cumsum(dim=0)])
    return sums[1:] - sums.gather(0, before), (time - before + 1).float()
