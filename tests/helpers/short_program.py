"""What a program of a few lines needs beside an exported policy; no code of ours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np


def seen(
    told: dict[str, Any],
    mj_data: Any,
    qpos_adr: Sequence[int],
    qvel_adr: Sequence[int],
    last: np.ndarray,
    command: Sequence[float],
) -> dict[str, np.ndarray]:
    """What the network sees of a robot, by the names that the file says."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, mj_data.qpos[3:7])
    to_world = rotation.reshape(3, 3)
    return {
        "base_lin_vel_b": mj_data.qvel[:3] @ to_world,
        "base_ang_vel_b": mj_data.qvel[3:6],
        "gravity_b": -to_world[2],
        "joint_pos_offset": mj_data.qpos[qpos_adr] - told["home_joint_pos_rad"],
        "joint_vel": mj_data.qvel[qvel_adr],
        "last_action": last,
        "command": np.array(command),
    }


def values_of(told: dict[str, Any], *state: Any) -> dict[str, np.ndarray]:
    """The same by the names of the terms of a law."""
    parts = seen(told, *state)
    renamed = {"gravity_b": "projected_gravity", "joint_pos_offset": "joint_pos"}
    return {renamed.get(n, n.removesuffix("_b")): part for n, part in parts.items()}


def in_a_row(told: dict[str, Any], parts: dict[str, np.ndarray]) -> np.ndarray:
    """[1, D] of these, in the order that the file says."""
    row = np.concatenate([parts[part["name"]] for part in told["observation"]])
    return row[None].astype(np.float32)


def give_plain_motors(spec: Any, told: dict[str, Any]) -> None:
    """In place of servos and of the joints' damping."""
    for element in [*spec.actuators, *spec.keys]:
        spec.delete(element)
    for name in told["joint_names"]:
        spec.joint(name).damping = [0.0, 0.0, 0.0]
        motor = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        motor.set_to_motor()
