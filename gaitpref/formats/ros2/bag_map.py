"""What the topics and joints of a bag are called: a small TOML file."""

from __future__ import annotations

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


class BagError(GaitprefError):
    """A bag or its map cannot be used; one line says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class JointTopic:
    """`sensor_msgs/JointState`."""

    topic: str = "/joint_states"
    names: tuple[str, ...] = tuple(f"{joint}_joint" for joint in JOINTS)
    """The bag's names of our twelve joints: FR, FL, RR, RL, each hip, thigh, calf."""
    signs: tuple[float, ...] = (1.0,) * len(JOINTS)
    """-1 where the bag counts a joint the other way round."""
    offsets_rad: tuple[float, ...] = (0.0,) * len(JOINTS)
    """Added to the bag's angle after its sign."""

    def __post_init__(self) -> None:
        for name in ("names", "signs", "offsets_rad"):
            if len(getattr(self, name)) != len(JOINTS):
                raise ValueError(
                    f"[joints] {name} needs {len(JOINTS)} entries in the order "
                    f"{', '.join(JOINTS)}; it has {len(getattr(self, name))}"
                )


@dataclass(frozen=True, kw_only=True)
class BaseTopic:
    """`nav_msgs/Odometry`, `geometry_msgs/PoseStamped` or `tf2_msgs/TFMessage`."""

    topic: str = "/odom"
    frame: str = "odom"
    """TF only: the fixed frame."""
    child: str = "base_link"
    """TF only: the frame of the base."""


@dataclass(frozen=True, kw_only=True)
class ImuTopic:
    """`sensor_msgs/Imu`, in the frame of the base."""

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
class BagMap:
    """Everything that has to be known of a bag."""

    robot: str
    """MJCF of the robot, from the directory of this file, or `go1` for the Go1 that
    ships. Clips are drawn with it, feet are found with it."""
    task: str = "hardware"
    """Name of the task, for the overview of a data set."""
    control_hz: float = 50.0
    """Rate the bag is resampled to; that of the clips it is compared with."""
    time: Literal["header", "log"] = "header"
    """Whose clock: that of the sensors, or that of the recorder."""
    ground: Literal["feet", "zero"] = "feet"
    """Where the ground is: below the lowest feet, or at height 0 of the base topic."""
    command: tuple[float, float, float] | None = None
    """Forward m/s, left m/s, yaw rad/s asked for, where no topic tells."""
    max_gap_s: float = 0.3
    """A longer silence of joints or base ends an episode."""
    min_episode_s: float = 1.0
    """Shorter stretches are left out."""
    episode_s: float = 20.0
    """Longer stretches become several episodes."""
    contact_height_m: float = 0.015
    """A foot below this touches the ground, where no topic tells."""
    joints: JointTopic = field(default_factory=JointTopic)
    base: BaseTopic = field(default_factory=BaseTopic)
    imu: ImuTopic | None = None
    contacts: ContactTopic | None = None
    twist: TwistTopic | None = None

    def __post_init__(self) -> None:
        for name in ("control_hz", "max_gap_s", "episode_s", "contact_height_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if self.joints.topic == self.base.topic:
            raise ValueError(f"joints and base cannot both be {self.base.topic}")
        if self.time not in ("header", "log") or self.ground not in ("feet", "zero"):
            raise ValueError("time is header or log, ground is feet or zero")

    @property
    def control_dt_s(self) -> float:
        """Time between two states of an episode."""
        return 1.0 / self.control_hz


def load_map(path: Path) -> BagMap:
    """Read the map of a bag.

    Raises:
        BagError: the file is missing, no TOML, or says something that cannot be.
    """
    try:
        told = tomllib.loads(read_text(path, TEXT_BYTES))
        if "robot" not in told:
            raise BagError(
                f"{path} does not say which robot the bag is of; write robot = "
                f'"ROBOT.xml", its MJCF, or robot = "{SHIPPED_ROBOT}" for the Go1 that '
                "ships, above the first [table]"
            )
        return from_plain(BagMap, told)
    except FileNotFoundError:
        raise BagError(
            f"{path} is missing; docs/how-to/ros2-bag.md shows the map of a bag"
        ) from None
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        found = " ".join(f"{error}".split())
        raise BagError(
            f"{path}: {found}; docs/reference/bag-map.md lists the fields"
        ) from None
