"""What the topics, columns and joints of a log are called: a small TOML file."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from data.errors import GaitprefError
from data.features import JOINTS, LEGS
from data.files.files import read_text
from data.files.limits import TEXT_BYTES
from data.files.plain import from_plain

SHIPPED_ROBOT = "go1"
"""What a map calls the robot that ships; any other is the path of a file."""


class LogError(GaitprefError):
    """A log or its map cannot be used; one line says why and what to do."""


FASTEST_HZ = 1000.0
"""No clip is played, and no gait is judged, at a higher rate."""
Names = str | tuple[str, ...]
"""One name, or several."""

DEFAULT_BASE = "/odom"
"""Where a base is looked for unless the map says where."""


@dataclass(frozen=True, kw_only=True)
class JointTopic:
    """`sensor_msgs/JointState` or `unitree_go/LowState`; signs and offsets count for
    columns too."""

    topic: str = "/joint_states"
    names: tuple[str, ...] = tuple(f"{joint}_joint" for joint in JOINTS)
    """The log's names of our twelve joints: FR, FL, RR, RL, each hip, thigh, calf.
    LowState has none: its first twelve motors are in this order."""
    signs: tuple[float, ...] = (1.0,) * len(JOINTS)
    """-1 where the log counts a joint the other way round."""
    offsets_rad: tuple[float, ...] = (0.0,) * len(JOINTS)
    """Added to the log's angle after its sign."""

    def __post_init__(self) -> None:
        for name in ("names", "signs", "offsets_rad"):
            if len(getattr(self, name)) != len(JOINTS):
                raise ValueError(
                    f"[joints] {name} needs {len(JOINTS)} entries in the order "
                    f"{', '.join(JOINTS)}; it has {len(getattr(self, name))}"
                )


@dataclass(frozen=True, kw_only=True)
class BaseTopic:
    """`nav_msgs/Odometry`, `geometry_msgs/PoseStamped`, `tf2_msgs/TFMessage` or
    `unitree_go/SportModeState`."""

    topic: str = DEFAULT_BASE
    frame: str = "odom"
    """TF only: the fixed frame."""
    child: str = "base_link"
    """TF only: the frame of the base."""
    from_legs: bool = False
    """Estimate it from the joints and the attitude of the IMU, whatever this topic
    says."""


@dataclass(frozen=True, kw_only=True)
class ImuTopic:
    """`sensor_msgs/Imu` or `unitree_go/LowState`, in the frame of the base."""

    topic: str = "/imu/data"


@dataclass(frozen=True, kw_only=True)
class ContactTopic:
    """A message with one number or truth value a foot."""

    topic: str
    field: str = "data"
    """Member that holds the four values."""
    order: tuple[str, ...] = LEGS
    """Whose value comes first."""
    above: float = 0.5
    """A larger value is contact; a force in N may need 20."""

    def __post_init__(self) -> None:
        if sorted(self.order) != sorted(LEGS):
            raise ValueError(
                f"[contacts] order names {', '.join(LEGS)} once each, got {self.order}"
            )


@dataclass(frozen=True, kw_only=True)
class TwistTopic:
    """`geometry_msgs/Twist` or `TwistStamped`: what the robot was asked for."""

    topic: str = "/cmd_vel"


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Columns of a table: a name, or several. `NAME[3]` and `NAME[0:12]` are parts of a
    column that holds lists."""

    time: str = ""
    """When a row was taken; empty where rows come at `rate_hz`."""
    time_unit_s: float = 1.0
    """Seconds in its unit: 1e-9 for nanoseconds."""
    rate_hz: float | None = None
    """Rows a second, where no column tells the time."""
    episode: str = ""
    """Number or name of the episode; each is one of its own."""
    qpos: Names = ()
    """19 as MuJoCo has them: position, attitude wxyz, joints in the order of the model.
    In place of base_pos, base_quat and joint_pos."""
    qvel: Names = ()
    """18 as MuJoCo has them: velocity in the world, turning rates of the body, then
    the joints."""
    base_pos: Names = ()
    """3, m in the world."""
    base_quat: Names = ()
    """4, attitude of the base."""
    quat_order: Literal["wxyz", "xyzw"] = "wxyz"
    """Which of the four comes first."""
    gravity: Names = ()
    """3, world down in the frame of the base, where no attitude is told."""
    base_lin_vel: Names = ()
    """3, m/s in the frame of the base."""
    base_ang_vel: Names = ()
    """3, rad/s in the frame of the base: the gyroscope."""
    joint_pos: Names = ()
    """12, rad: FR, FL, RR, RL, each hip, thigh, calf."""
    joint_vel: Names = ()
    """12, rad/s."""
    joint_torque: Names = ()
    """12, N m."""
    contact: Names = ()
    """4, FR, FL, RR, RL."""
    contact_above: float = 0.5
    """A larger value is contact; a force in N may need 20."""
    command: Names = ()
    """3: forward m/s, left m/s, yaw rad/s."""

    def __post_init__(self) -> None:
        if self.rate_hz is not None and not 0 < self.rate_hz < math.inf:
            raise ValueError(f"[columns] rate_hz must be positive, got {self.rate_hz}")
        if not 0 < self.time_unit_s < math.inf:
            raise ValueError(
                f"[columns] time_unit_s must be positive, got {self.time_unit_s}"
            )
        if self.quat_order not in ("wxyz", "xyzw"):
            raise ValueError(
                f"[columns] quat_order is wxyz or xyzw, got {self.quat_order}"
            )


@dataclass(frozen=True, kw_only=True)
class LogMap:
    """Everything that has to be known of a log."""

    robot: str
    """MJCF of the robot, from the directory of this file, or `go1` for the Go1 that
    ships. Clips are drawn with it, feet are found with it."""
    task: str = "hardware"
    """Name of the task, for the overview of a data set."""
    control_hz: float = 50.0
    """Rate the log is resampled to; that of the clips it is compared with."""
    time: Literal["header", "log"] = "header"
    """Whose clock: that of the sensors, or that of the recorder."""
    ground: Literal["feet", "zero"] = "feet"
    """Where the ground is: below the lowest feet, or at height 0 of the base."""
    command: tuple[float, float, float] | None = None
    """Forward m/s, left m/s, yaw rad/s asked for, where no topic tells."""
    max_gap_s: float = 0.3
    """A longer silence of joints or base ends an episode."""
    min_episode_s: float = 1.0
    """Shorter stretches are left out."""
    episode_s: float = 20.0
    """Longer stretches become several episodes."""
    contact_height_m: float = 0.01
    """A foot below this touches the ground, where no topic tells."""
    joints: JointTopic = field(default_factory=JointTopic)
    base: BaseTopic | None = None
    imu: ImuTopic | None = None
    contacts: ContactTopic | None = None
    twist: TwistTopic | None = None
    columns: Columns | None = None

    def __post_init__(self) -> None:
        for name in ("control_hz", "max_gap_s", "episode_s", "contact_height_m"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if self.control_hz > FASTEST_HZ:
            raise ValueError(
                f"control_hz must be {FASTEST_HZ:g} at most, got {self.control_hz}"
            )
        if self.joints.topic == self.base_topic:
            raise ValueError(f"joints and base cannot both be {self.base_topic}")
        if self.time not in ("header", "log") or self.ground not in ("feet", "zero"):
            raise ValueError("time is header or log, ground is feet or zero")

    @property
    def base_topic(self) -> str:
        """Where the base is looked for; empty where it is to be estimated."""
        base = self.base or BaseTopic()
        return "" if base.from_legs else base.topic

    @property
    def may_lack_base(self) -> bool:
        """Whether the legs tell of the base where no message does."""
        return self.base is None or self.base.from_legs

    @property
    def control_dt_s(self) -> float:
        """Time between two states of an episode."""
        return 1.0 / self.control_hz


def load_map(path: Path) -> LogMap:
    """Read the map of a log.

    Raises:
        LogError: the file is missing, no TOML, or says something that cannot be.
    """
    try:
        told = tomllib.loads(read_text(path, TEXT_BYTES))
        if "robot" not in told:
            raise LogError(
                f"{path} does not say which robot the log is of; write robot = "
                f'"ROBOT.xml", its MJCF, or robot = "{SHIPPED_ROBOT}" for the Go1 that '
                "ships, above the first [table]"
            )
        return from_plain(LogMap, told)
    except FileNotFoundError:
        raise LogError(
            f"{path} is missing; docs/how-to/robot-log.md shows the map of a log"
        ) from None
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        found = " ".join(f"{error}".split())
        raise LogError(
            f"{path}: {found}; docs/reference/log-map.md lists the fields"
        ) from None
