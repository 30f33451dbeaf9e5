"""Hand-written rewards: functions of the feature row, in units per second.

A step's reward is its score times the control step, so that the return of an episode
does not depend on the control rate.

Shapes: F feature columns; a score keeps the leading shape of its rows.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import torch
from torch import Tensor

from data.features import column
from data.files.plain import ADDED_LATER
from policy.robots.robot import Robot

from .known_terms import KnownTermsCfg

_SHIPPED_HEIGHT_M, _SHIPPED_MASS_KG = 0.2945, 12.744


@dataclass(frozen=True, kw_only=True)
class TaskRewardCfg:
    """Weights of the hand-written walking reward, each per second unless said."""

    track_planar: float = 1.0
    """exp(-e^2 / 0.25) of the planar velocity error e, m/s."""
    track_yaw: float = 0.5
    """exp(-e^2 / 0.25) of the turning rate error e, rad/s."""
    vertical: float = -2.0
    """Squared vertical velocity, m^2/s^2."""
    roll_pitch_rate: float = -0.05
    """Squared roll and pitch rates, rad^2/s^2."""
    tilt: float = -2.0
    """Squared horizontal part of gravity in the body frame."""
    height: float = -20.0
    """Squared deviation from `height_m`, m^2."""
    torque: float = -2e-4
    """Sum of squared joint torques, N^2 m^2."""
    action_rate: float = -0.01
    """Sum of squared differences of successive actions."""
    pose: float = -0.1
    """Sum of squared joint offsets from the home pose, rad^2."""
    slip: float = -0.1
    """Sum of squared speeds of feet in contact, m^2/s^2."""
    clearance: float = -2.0
    """Sum over feet of squared deviation from `clearance_m` times foot speed."""
    swing: float = 2.0
    """Air time less `swing_min_s`, s, once for every swing of a foot."""
    fall: float = -1.0
    """Once, when the robot falls."""
    upright: float = field(default=0.0, metadata=ADDED_LATER)
    """Angle by which the base is turned up, of half a turn: 0 on its back, 1 when
    level."""
    rise: float = field(default=0.0, metadata=ADDED_LATER)
    """Share of `height_m` that a base which is turned up has risen to."""
    stand: float = field(default=0.0, metadata=ADDED_LATER)
    """Having risen, with the legs in the home pose and at rest."""
    height_m: float | None = None
    """Height of the base that is asked for; None is 95 % of the robot's home height."""
    clearance_m: float = 0.08
    """Height a swinging foot should reach."""
    swing_min_s: float = 0.2
    """A swing shorter than this costs more than it earns."""

    @property
    def weights(self) -> dict[str, float]:
        """The weight of every term by name; of getting up, only what is paid."""
        targets = ("height_m", "clearance_m", "swing_min_s")
        unpaid = () if self.pays_getting_up else ("upright", "rise", "stand")
        return {
            f.name: getattr(self, f.name)
            for f in fields(self)
            if f.name not in (*targets, *unpaid)
        }

    @property
    def pays_getting_up(self) -> bool:
        """Whether the terms of getting up are worth computing."""
        return any((self.upright, self.rise, self.stand))


GETUP_TASK = TaskRewardCfg(
    track_planar=0.0,
    track_yaw=0.0,
    vertical=0.0,
    roll_pitch_rate=0.0,
    tilt=0.0,
    height=0.0,
    torque=-2e-5,
    action_rate=-0.002,
    pose=0.0,
    slip=0.0,
    clearance=0.0,
    swing=0.0,
    upright=1.0,
    rise=1.0,
    stand=1.0,
)
"""What is paid where robots have to get up."""


def task_reward_for(robot: Robot, cfg: TaskRewardCfg) -> TaskRewardCfg:
    """`cfg` with the figures of a robot of this size, unless it names a height.

    The weights are those of the robot that ships. What a robot needs of torque grows
    with its weight and its height, the lift of its feet with its height.
    """
    if cfg.height_m is not None:
        return cfg
    taller, stronger = size_of(robot)
    return replace(
        cfg,
        # Position servos give way under the weight: home itself is never reached.
        height_m=0.95 * float(robot.home_qpos[2]),
        height=cfg.height / taller**2,
        torque=cfg.torque / stronger**2,
        clearance=cfg.clearance / taller**2,
        clearance_m=cfg.clearance_m * taller,
    )


def known_terms_for(robot: Robot, cfg: KnownTermsCfg) -> KnownTermsCfg:
    """`cfg` with the weight of torque that suits a robot of this size."""
    _, stronger = size_of(robot)
    return replace(cfg, torque=cfg.torque / stronger**2)


def size_of(robot: Robot) -> tuple[float, float]:
    """Height, and weight times height, as multiples of the robot that ships."""
    mass_kg = float(robot.mj_model.body_subtreemass[robot.base_body_id])
    # Rounded, so that the robot that ships is 1 times itself to the last bit.
    taller = round(float(robot.home_qpos[2]) / _SHIPPED_HEIGHT_M, 3)
    return taller, taller * round(mass_kg / _SHIPPED_MASS_KG, 3)


def _square(values: Tensor) -> Tensor:
    return values.square().sum(dim=-1)


def task_terms(
    features: Tensor, cfg: TaskRewardCfg, *, control_dt_s: float
) -> dict[str, Tensor]:
    """The unweighted terms of `features [..., F]` by name, each [...], per second.

    The swing term is the usual bonus for air time at touch-down, paid step by step: a
    swing of `a` seconds earns `a` less `swing_min_s`, the latter at its first step, so
    that the term needs one row only. It pays for 0.5 s at most and only while two feet
    support the robot, or leaping into a fall would earn four swings at once.

    Raises:
        ValueError: the height that is asked for is open.
    """
    if cfg.height_m is None:
        raise ValueError("height_m is not set: `task_reward_for` sets it for a robot")
    velocity = features[..., column("base_lin_vel_b")]
    rates = features[..., column("base_ang_vel_b")]
    command = features[..., column("command")]
    pose, _, torque, _, action_rate = _squares(features).unbind(-1)
    feet = features[..., column("foot_contact").start : column("foot_air_time").stop]
    contact, height, speed, air = feet.unflatten(-1, (4, 4)).unbind(-2)
    lift_off = (air > 0) & (air < 1.5 * control_dt_s)
    supported = contact.sum(dim=-1, keepdim=True) >= 2
    swinging = (air > 0) & (air < 0.5) & supported
    getting_up: dict[str, Tensor] = {}
    if cfg.pays_getting_up:
        getting_up = getup_terms(features, height_m=cfg.height_m)
    return getting_up | {
        "track_planar": torch.exp(
            -_square(command[..., :2] - velocity[..., :2]) / 0.25
        ),
        "track_yaw": torch.exp(-(command[..., 2] - rates[..., 2]).square() / 0.25),
        "vertical": velocity[..., 2].square(),
        "roll_pitch_rate": _square(rates[..., :2]),
        "tilt": _square(features[..., column("gravity_b")][..., :2]),
        "height": (
            features[..., column("base_height")][..., 0] - cfg.height_m
        ).square(),
        "torque": torque,
        "action_rate": action_rate,
        "pose": pose,
        "slip": (contact * speed.square()).sum(dim=-1),
        "clearance": ((height - cfg.clearance_m).square() * speed).sum(dim=-1),
        "swing": (
            swinging.float() * control_dt_s - lift_off.float() * cfg.swing_min_s
        ).sum(dim=-1),
        "fall": features[..., column("fallen")][..., 0] / control_dt_s,
    }


def getup_terms(features: Tensor, *, height_m: float) -> dict[str, Tensor]:
    """Unweighted terms of `features [..., F]` by name, each [...] in [0, 1].

    Each is there only as far as the one before it, so that the way up always pays.
    """
    # By angle and not by its cosine, which is flat where a robot lies on its back.
    down_z = features[..., column("gravity_b")][..., 2].clamp(-1.0, 1.0)
    upright = torch.acos(down_z) / torch.pi
    height = features[..., column("base_height")][..., 0] / height_m
    offset = features[..., column("joint_pos_offset")].square().sum(dim=-1)
    speed = features[..., column("joint_vel")].square().mean(dim=-1)
    risen = upright.square() * height.clamp(0.0, 1.0)
    return {
        "upright": upright,
        "rise": risen,
        "stand": risen * torch.exp(-offset / 2.0) / (1.0 + speed / 4.0),
    }


def _squares(features: Tensor) -> Tensor:
    """Sums of squares [..., 5] over the joints: offsets from the home pose,
    velocities, torques, actions and their rates, neighbours in the row."""
    joints = slice(column("joint_pos_offset").start, column("action_rate").stop)
    return _square(features[..., joints].unflatten(-1, (5, 12)))


def weighted(features: Tensor, cfg: TaskRewardCfg, *, control_dt_s: float) -> Tensor:
    """The terms of `task_terms` times their weights, [K, ...] in the order of
    `cfg.weights`; their sum is the task score."""
    terms = task_terms(features, cfg, control_dt_s=control_dt_s)
    stacked = torch.stack([terms[name] for name in cfg.weights])
    weights = stacked.new_tensor(tuple(cfg.weights.values()))
    return stacked * weights.view(-1, *[1] * (stacked.ndim - 1))


def task_score(features: Tensor, cfg: TaskRewardCfg, *, control_dt_s: float) -> Tensor:
    """Task reward per second of `features [..., F]`, [...]."""
    return weighted(features, cfg, control_dt_s=control_dt_s).sum(dim=0)
