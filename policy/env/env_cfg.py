"""Configuration of the environment; every field's docstring is its documentation."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from data.files.plain import ADDED_LATER, NONE_AS_BEFORE
from policy.law.law import Law

from .course import CourseCfg
from .curriculum import CurriculumCfg
from .getup import GetupCfg
from .task_reward import GETUP_TASK, TaskRewardCfg
from .team_cfg import TeamCfg
from .terrain import TerrainCfg

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class CommandCfg:
    """Velocity commands an environment draws uniformly, body frame."""

    forward_m_s: Range = (0.2, 1.1)
    """Forward speed."""
    left_m_s: Range = (-0.2, 0.2)
    """Speed to the left."""
    yaw_rad_s: Range = (-0.4, 0.4)
    """Turning rate, positive to the left."""
    resample_s: float = 5.0
    """Time after which an environment draws a new command; inf keeps the first."""
    evaluated_m_s: Range = (0.3, 1.0)
    """Forward speeds that are recorded and evaluated: a little inside those trained."""

    def __post_init__(self) -> None:
        for name in ("forward_m_s", "left_m_s", "yaw_rad_s", "evaluated_m_s"):
            low, high = getattr(self, name)
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise ValueError(
                    f"{name} must be a finite (low, high), got {low, high}"
                )
        if not self.resample_s > 0:
            raise ValueError(f"resample_s must be positive, got {self.resample_s}")


@dataclass(frozen=True, kw_only=True)
class ResetCfg:
    """Noise of the state an episode starts from; uniform, plus or minus."""

    joint_pos_rad: float = 0.1
    """Around the home pose, cut to the joints' ranges."""
    joint_vel_rad_s: float = 0.1
    """Around rest."""
    base_lin_vel_m_s: float = 0.1
    """Each axis, world frame."""
    base_ang_vel_rad_s: float = 0.1
    """Each axis, body frame."""
    tilt_rad: float = 0.05
    """Roll and pitch."""
    height_m: float = 0.01
    """Upwards only: a foot must not start inside the ground."""


@dataclass(frozen=True, kw_only=True)
class FallCfg:
    """What ends an episode as a fall, beside contact of the base with the ground."""

    tilt_rad: float = math.radians(60.0)
    """Angle between the body's and the world's vertical."""
    height_ratio: float = 0.43
    """Height of the base below this share of its home height."""


@dataclass(frozen=True, kw_only=True)
class NoiseCfg:
    """Noise of what the policy sees; uniform, plus or minus, new in every step."""

    lin_vel_m_s: float = 0.0
    """Velocity of the base."""
    ang_vel_rad_s: float = 0.0
    """Turning rates of the base."""
    gravity: float = 0.0
    """Direction of gravity."""
    joint_pos_rad: float = 0.0
    """Angles of the joints."""
    joint_vel_rad_s: float = 0.0
    """Velocities of the joints."""


@dataclass(frozen=True, kw_only=True)
class RandomiseCfg:
    """How robots differ from episode to episode; the defaults are no difference."""

    friction: Range = (1.0, 1.0)
    """Sliding friction, times that of the model."""
    mass: Range = (1.0, 1.0)
    """Masses and inertias of all bodies, times those of the model."""
    com_m: float = 0.0
    """Shift of the base's centre of mass, each axis."""
    strength: Range = (1.0, 1.0)
    """Gains and torque limits of the servos, times those of the model."""
    delayed_share: float = 0.0
    """Share of the episodes in which targets arrive one control step late."""
    push_m_s: float = 0.0
    """Sudden change of the base's horizontal velocity, each axis."""
    push_every_s: float = 3.0
    """Time between two pushes."""
    encoder_bias_rad: float = 0.0
    """Constant error of every joint's encoder, seen by policy and servo."""
    noise: NoiseCfg = field(default_factory=NoiseCfg)
    """Noise of the observations."""


RANDOMISE = {
    "off": RandomiseCfg(),
    "light": RandomiseCfg(
        friction=(0.7, 1.2),
        mass=(0.95, 1.05),
        com_m=0.01,
        strength=(0.95, 1.05),
        push_m_s=0.2,
        encoder_bias_rad=0.01,
        noise=NoiseCfg(
            lin_vel_m_s=0.05,
            ang_vel_rad_s=0.1,
            gravity=0.02,
            joint_pos_rad=0.01,
            joint_vel_rad_s=0.5,
        ),
    ),
    "full": RandomiseCfg(
        friction=(0.4, 1.3),
        mass=(0.9, 1.1),
        com_m=0.03,
        strength=(0.85, 1.15),
        delayed_share=0.5,
        push_m_s=0.5,
        encoder_bias_rad=0.03,
        noise=NoiseCfg(
            lin_vel_m_s=0.1,
            ang_vel_rad_s=0.2,
            gravity=0.05,
            joint_pos_rad=0.03,
            joint_vel_rad_s=1.5,
        ),
    ),
}
"""What `gaitpref train --randomize` offers."""


@dataclass(frozen=True, kw_only=True)
class EnvCfg:
    """A batch of quadrupeds that follow velocity commands."""

    physics_dt_s: float = 0.005
    """MuJoCo's time step."""
    substeps: int = 4
    """Physics steps per control step."""
    episode_s: float = 10.0
    """Length after which an episode is cut by a time-out."""
    action_scale_rad: float = 0.3
    """Joint offset from the home pose that an action of 1 asks for."""
    action_limit: float = 3.0
    """Actions are clipped to plus or minus this."""
    commands: CommandCfg = field(default_factory=CommandCfg)
    """Which commands are asked for."""
    reset: ResetCfg = field(default_factory=ResetCfg)
    """How an episode starts."""
    fall: FallCfg = field(default_factory=FallCfg)
    """How it ends early."""
    randomise: RandomiseCfg = field(default_factory=RandomiseCfg)
    """How the robots of a training run differ; recordings and evaluations show the
    model itself."""
    task: TaskRewardCfg = field(default_factory=TaskRewardCfg)
    """The hand-written reward."""
    terrain: TerrainCfg = field(default_factory=TerrainCfg, metadata=ADDED_LATER)
    """What is walked on."""
    getup: GetupCfg | None = field(default=None, metadata=ADDED_LATER)
    """Begin episodes lying, and end none by a fall."""
    curriculum: CurriculumCfg | None = field(default=None, metadata=ADDED_LATER)
    """Ask for more as commands are followed better; None asks for all at once."""
    team: TeamCfg | None = field(default=None, metadata=NONE_AS_BEFORE)
    """Two robots in every world, which see each other; None leaves each alone."""
    law: Law | None = field(default=None, metadata=NONE_AS_BEFORE)
    """What the policy sees and what its actions ask for, where that is not this
    project's own: of a policy from elsewhere, or without the velocity of the base."""

    course: CourseCfg | None = field(default=None, metadata=NONE_AS_BEFORE)
    """Walk along a course of obstacles, and see what is ahead, instead of `terrain`."""

    def __post_init__(self) -> None:
        if self.law is not None and (
            self.law.physics_dt_s != self.physics_dt_s
            or self.law.substeps != self.substeps
            or self.law.action_limit != self.action_limit
        ):
            raise ValueError("the environment must have the time steps of its law")
        if self.substeps < 1:
            raise ValueError(f"substeps must be at least 1, got {self.substeps}")
        if not (self.physics_dt_s > 0 and self.episode_s >= self.control_dt_s):
            raise ValueError(
                f"physics_dt_s must be positive and episode_s at least one control "
                f"step, got {self.physics_dt_s} and {self.episode_s}"
            )

    def under(self, law: Law) -> EnvCfg:
        """This environment for a policy of `law`."""
        return replace(
            self,
            law=law,
            physics_dt_s=law.physics_dt_s,
            substeps=law.substeps,
            action_limit=law.action_limit,
        )

    @property
    def control_dt_s(self) -> float:
        """Time between two actions."""
        return self.physics_dt_s * self.substeps

    @property
    def episode_steps(self) -> int:
        """Control steps until the time-out."""
        return round(self.episode_s / self.control_dt_s)


def getup_env(cfg: EnvCfg) -> EnvCfg:
    """`cfg` with robots that lie and are paid for getting up, and for nothing else."""
    nowhere = (0.0, 0.0)
    return replace(
        cfg,
        episode_s=6.0,
        # To turn over, legs move farther than in any walk.
        action_scale_rad=0.6,
        commands=CommandCfg(
            forward_m_s=nowhere,
            left_m_s=nowhere,
            yaw_rad_s=nowhere,
            evaluated_m_s=nowhere,
        ),
        getup=GetupCfg(),
        task=GETUP_TASK,
    )
