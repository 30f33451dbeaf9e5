"""The ROS 2 messages of a file for viewers: their definitions and their values.

Standard messages for what is drawn, so that every viewer knows them; one message of our
own for the numbers, in which each column of the feature row has its name.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from data.episodes.schema import feature_columns

TF_TYPE = "tf2_msgs/msg/TFMessage"
SCENE_TYPE = "visualization_msgs/msg/MarkerArray"
SCALARS_TYPE = "gaitpref/msg/ScalarsV1"
Message = dict[str, Any]

_HEADER = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
}
_POINTS = {
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
}
_MARKER = """std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials
"""


def scalar_names() -> tuple[str, ...]:
    """Fields of the message of numbers: columns of the feature row, then the reward."""
    names = (name.replace(".", "_").lower() for name in feature_columns())
    return (*names, "task_reward")


def definitions() -> dict[str, str]:
    """The text of every message in the form bags carry it, parts behind the whole."""
    transform = {
        "geometry_msgs/TransformStamped": "std_msgs/Header header\n"
        "string child_frame_id\ngeometry_msgs/Transform transform\n",
        "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\n"
        "geometry_msgs/Quaternion rotation\n",
    }
    marker = {
        "visualization_msgs/Marker": _MARKER,
        "geometry_msgs/Pose": "geometry_msgs/Point position\n"
        "geometry_msgs/Quaternion orientation\n",
        "std_msgs/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n",
        "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec\n",
        "sensor_msgs/CompressedImage": "std_msgs/Header header\n"
        "string format\nuint8[] data\n",
        "visualization_msgs/UVCoordinate": "float32 u\nfloat32 v\n",
        "visualization_msgs/MeshFile": "string filename\nuint8[] data\n",
    }
    scalars = "".join(f"float32 {name}\n" for name in scalar_names())
    return {
        TF_TYPE: _text(
            "geometry_msgs/TransformStamped[] transforms\n",
            transform | _HEADER | _POINTS,
        ),
        SCENE_TYPE: _text(
            "visualization_msgs/Marker[] markers\n", marker | _HEADER | _POINTS
        ),
        SCALARS_TYPE: _text(f"std_msgs/Header header\n{scalars}", _HEADER),
    }


def _text(main: str, parts: dict[str, str]) -> str:
    line = "=" * 80
    return main + "".join(f"{line}\nMSG: {n}\n{text}" for n, text in parts.items())


def header(time_ns: int, frame: str) -> Message:
    """A stamp of simulated time and the frame the message is in."""
    sec, nanosec = divmod(time_ns, 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def vector(values: np.ndarray) -> Message:
    """x, y, z of `values` [3]."""
    return dict(zip("xyz", map(float, values), strict=True))


def quaternion(wxyz: np.ndarray) -> Message:
    """x, y, z, w of `wxyz` [4]."""
    return dict(zip("wxyz", map(float, wxyz), strict=True))


def transforms(
    time_ns: int,
    frames: list[str],
    positions: np.ndarray,
    wxyzs: np.ndarray,
) -> Message:
    """Where the bodies called `frames` are: [K, 3] m and [K, 4], in the world."""
    stamp = header(time_ns, "world")
    return {
        "transforms": [
            {
                "header": stamp,
                "child_frame_id": frame,
                "transform": {
                    "translation": vector(position),
                    "rotation": quaternion(wxyz),
                },
            }
            for frame, position, wxyz in zip(frames, positions, wxyzs, strict=True)
        ]
    }


def scalars(time_ns: int, row: np.ndarray, reward: float) -> Message:
    """The feature row [F] of a step and its hand-written reward, by name."""
    values = map(float, (*row, reward))
    named = dict(zip(scalar_names(), values, strict=True))
    return {"header": header(time_ns, "world")} | named
