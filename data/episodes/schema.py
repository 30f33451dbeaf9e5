"""What one step of an episode file holds: one table gives bytes, text and hash.

A message is CDR with fixed-size fields only: a four-byte header, then a C struct
without padding. So a whole episode is read with one `numpy.frombuffer`, and every MCAP
viewer understands it through the `ros2msg` text.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache

import numpy as np

from data.features import FEATURE_DIM, FEATURES, JOINTS, LEGS

FORMAT_VERSION = 2
"""Version of the file layout around the messages; 1 had all of them in one chunk."""
APART_VERSION = 3
"""The same where the robot's model is not in the file but beside it, under the hash
that the metadata `mjcf_sha256` says."""
TEAM_VERSION = 4
"""Two robots in one world: the file of the other is attached, and the model is in the
file or, where the metadata says its hash, beside it."""
READABLE_VERSIONS = (1, 2, APART_VERSION, TEAM_VERSION)
STEP_SCHEMA = "gaitpref/msg/StepV1"
FINAL_SCHEMA = "gaitpref/msg/FinalV1"
STEP_TOPIC = "/robot/step"
FINAL_TOPIC = "/robot/final"
CDR_HEADER = bytes((0, 1, 0, 0))
"""Plain CDR, little endian."""

_NUMPY_TYPES = {"float64": "<f8", "float32": "<f4", "uint32": "<u4", "uint8": "u1"}


@dataclass(frozen=True)
class Field:
    """One member of a message."""

    name: str
    type: str
    """Name of the element type in ros2msg."""
    width: int
    """Number of elements; 1 is a plain scalar."""
    comment: str
    """Unit, frame and order, as written into the file."""

    @property
    def ros_type(self) -> str:
        """The type as ros2msg spells it."""
        return self.type if self.width == 1 else f"{self.type}[{self.width}]"


# Ordered by alignment (8, 4, 1 bytes): CDR then needs no padding.
_STATE_FIELDS = (
    Field("qpos", "float64", 19, "m, wxyz, rad: base position and attitude, joints"),
    Field("qvel", "float64", 18, "m/s, rad/s: base linear and angular, joints"),
    Field("obs", "float32", 48, "what the policy sees"),
)
STEP_FIELDS = (
    *_STATE_FIELDS,
    Field("action", "float32", 12, "policy output after clipping"),
    Field("ctrl", "float32", 12, "what the actuators were told"),
    Field("features", "float32", FEATURE_DIM, "feature row after the step"),
    Field("reward", "float32", 1, "hand-written task reward of the step"),
    Field("step", "uint32", 1, "control steps since the reset"),
    Field("terminated", "uint8", 1, "1: this step ended the episode by a fall"),
    Field("truncated", "uint8", 1, "1: this step ended the episode by the time limit"),
)
FINAL_FIELDS = _STATE_FIELDS


def message_text(fields: tuple[Field, ...]) -> str:
    """The ros2msg definition of a message."""
    return "".join(f"{f.ros_type} {f.name}  # {f.comment}\n" for f in fields)


def body_dtype(fields: tuple[Field, ...]) -> np.dtype:
    """The packed struct behind the CDR header."""
    return np.dtype(
        [
            (f.name, _NUMPY_TYPES[f.type], () if f.width == 1 else (f.width,))
            for f in fields
        ]
    )


def record_dtype(fields: tuple[Field, ...]) -> np.dtype:
    """A whole MCAP message record: opcode, length, message header, CDR header, body."""
    return np.dtype(
        [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("sequence", "<u4"),
            ("log_time", "<u8"),
            ("publish_time", "<u8"),
            ("cdr", "u1", (len(CDR_HEADER),)),
            ("body", body_dtype(fields)),
        ]
    )


STEP_RECORD = record_dtype(STEP_FIELDS)
FINAL_RECORD = record_dtype(FINAL_FIELDS)


def record_length(dtype: np.dtype) -> int:
    """What the `length` member of a record says: all bytes behind it."""
    return dtype.itemsize - 9


@cache
def schema_sha256() -> str:
    """Hash of names and types of both messages; comments do not count."""
    lines = [
        f"{schema} {f.ros_type} {f.name}"
        for schema, fields in ((STEP_SCHEMA, STEP_FIELDS), (FINAL_SCHEMA, FINAL_FIELDS))
        for f in fields
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@cache
def feature_columns() -> tuple[str, ...]:
    """A name for each column of the feature row, such as `joint_vel.FR_hip`."""
    by_width = {1: ("",), 3: ("x", "y", "z"), len(LEGS): LEGS, len(JOINTS): JOINTS}
    by_name = {"command": ("forward", "left", "yaw")}
    names: list[str] = []
    for feature in FEATURES:
        suffixes = by_name.get(feature.name) or by_width[feature.width]
        names += (f"{feature.name}.{suffix}".rstrip(".") for suffix in suffixes)
    return tuple(names)
