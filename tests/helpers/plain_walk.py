"""Who walks in plain MuJoCo by what is said beside a policy; no code of ours.

Shapes: D numbers of an observation, T control steps.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from .short_program import give_plain_motors, values_of


class Frames:
    """Observations of a policy.json, with the frames that came before."""

    def __init__(self, told: dict[str, Any]) -> None:
        self._parts = told["observation"]
        self._law = told["law_record"]
        most = max(part["frames"] for part in self._parts)
        self._past: deque[list[np.ndarray]] = deque(maxlen=most)

    def row(self, values: dict[str, np.ndarray]) -> np.ndarray:
        """[1, D] of what is seen now."""
        frame = []
        for part in self._parts:
            low, high = part["clip"] or (-np.inf, np.inf)
            frame.append(np.clip(values[part["name"]], low, high) * part["scale"])
        for _ in range(1 if self._past else self._past.maxlen or 1):
            self._past.append(frame)
        newest = list(self._past)[::-1]
        if self._law["by_term"]:
            shown = [
                [seen[index] for seen in newest[: part["frames"]]]
                for index, part in enumerate(self._parts)
            ]
            if not self._law["newest_first"]:
                shown = [frames[::-1] for frames in shown]
        else:
            shown = newest if self._law["newest_first"] else newest[::-1]
        row = np.concatenate([value for frames in shown for value in frames])
        limit = self._law["obs_limit"]
        return (row if limit is None else row.clip(-limit, limit))[None].astype("f4")


def walked(
    spec: Any,
    told: dict[str, Any],
    act: Callable[[np.ndarray], np.ndarray],
    command: Sequence[float],
    steps: int,
) -> np.ndarray:
    """[T, 3] forward and left m/s and yaw rad/s of the base, on plain motors.

    Args:
        spec: The model, whose motors and joints' damping are taken out.
        told: What a policy.json says.
        act: Actions [12] of an observation [1, D].
        command: Forward, left m/s, yaw rad/s.
        steps: T; fewer where the robot lies.
    """
    give_plain_motors(spec, told)
    spec.option.timestep = told["physics_dt_s"]
    mj_model = spec.compile()
    mj_data = mujoco.MjData(mj_model)
    joints = [mj_model.joint(name) for name in told["joint_names"]]
    qpos_adr = [int(joint.qposadr[0]) for joint in joints]
    qvel_adr = [int(joint.dofadr[0]) for joint in joints]
    kp, kd, limit = (
        np.array(told[name])
        for name in ("kp_nm_per_rad", "kd_nm_s_per_rad", "torque_limit_nm")
    )
    scale, offset = (
        np.array(told[f"action_{name}_rad"]) for name in ("scale", "offset")
    )
    mj_data.qpos[:7] = [0, 0, told["home_base_height_m"], 1, 0, 0, 0]
    mj_data.qpos[qpos_adr] = told["home_joint_pos_rad"]
    frames, last, found = Frames(told), np.zeros(12), []
    for _ in range(steps):
        values = values_of(told, mj_data, qpos_adr, qvel_adr, last, command)
        if values["projected_gravity"][2] > -0.5:
            break
        last = act(frames.row(values)).clip(-told["action_limit"], told["action_limit"])
        target = offset + scale * last
        if told["target_clip_rad"]:
            target = target.clip(*np.transpose(told["target_clip_rad"]))
        for _ in range(round(told["control_dt_s"] / told["physics_dt_s"])):
            angle, velocity = mj_data.qpos[qpos_adr], mj_data.qvel[qvel_adr]
            torque = kp * (target - angle) - kd * velocity
            mj_data.ctrl[:] = np.clip(torque, -limit, limit)
            mujoco.mj_step(mj_model, mj_data)
        now = values_of(told, mj_data, qpos_adr, qvel_adr, last, command)
        found.append([*now["base_lin_vel"][:2], now["base_ang_vel"][2]])
    return np.array(found)
