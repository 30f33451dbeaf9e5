"""What the numbers of an exported policy mean, as plain values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from data.files.plain import to_plain
from policy.env.course import AHEAD
from policy.env.feature_row import OBSERVATION, obs_column
from policy.env.own_law import own_law
from policy.law.law import MEANINGS, Law
from policy.robots.motor_class import unusual_motors
from policy.robots.robot import Robot
from policy.training.checkpoint import PolicyInfo

FORMAT_VERSION = 5
"""Version of policy.json. In 1, `kd_nm_s_per_rad` lacked the damping of the joints; in
2, `law_record` was not there, which names everything a policy is brought in by; in 3,
`speed_limit_rad_s` and `conventions` were not; in 4, `gaits`
and `memory` were not."""
CONVENTIONS = {
    "units": "SI: m, s, rad, kg, N m; names end in their unit",
    "base_frame": "x forward, y left, z up, in the body of the free joint",
    "world_frame": "z up; gravity is along -z",
    "quaternion": "w, x, y, z, of the base in the world",
    "joint_order": (
        "every list of twelve, and obs, action and joint_target, is in the order of "
        "`joints`: FR is front right, RL rear left"
    ),
    "joint_sign": "as the model's own: positive about the axis of its joint",
    "time": (
        "every control_dt_s: read the sensors, fill obs, run the network, set the "
        "joint targets; a whole number of physics_dt_s"
    ),
    "first_step": (
        "the robot stands in home_joint_pos_rad, and last_action is 0; frames before "
        "are the first one, or zeros where law_record.before says so"
    ),
}
"""What the numbers of policy.json mean."""
MEMORY = {
    "gait": "which of `gaits` ran in the step before, counted from 0",
    "steps": "control steps since it was chosen",
}
"""What one that chooses among gaits remembers, int64 [N], and what it is."""


def describe(info: PolicyInfo, robot: Robot, sha256: str) -> dict[str, Any]:
    """All that is needed to run the network on a robot, as plain values.

    What is infinite, a joint without limits, is None; so is what nobody said.
    """
    mj_model, gaits = robot.mj_model, info.ppo.gaits
    law = law_of(info, robot)
    order = law.from_canonical
    joints = [
        int(np.flatnonzero(mj_model.jnt_qposadr == adr)[0])
        for adr in robot.qpos_adr[order]
    ]
    return {
        "format_version": FORMAT_VERSION,
        "policy_sha256": sha256,
        "robot": info.robot_name,
        "conventions": CONVENTIONS,
        "control_dt_s": info.env.control_dt_s,
        "physics_dt_s": info.env.physics_dt_s,
        "joints": list(law.joints),
        "joint_names": [mj_model.joint(joint).name for joint in joints],
        "home_joint_pos_rad": _plain(robot.home_joint_pos[order]),
        "home_base_height_m": float(robot.home_qpos[2]),
        "joint_range_rad": [_plain(row) for row in robot.joint_range[order]],
        "torque_limit_nm": _plain(robot.torque_limit[order]),
        "speed_limit_rad_s": _plain(robot.speed_limit[order]),
        "kp_nm_per_rad": _plain(robot.kp[order]),
        "kd_nm_s_per_rad": _plain(robot.kd[order]),
        "action_scale_rad": (
            info.env.action_scale_rad
            if info.env.law is None
            else list(law.action_scale_rad)
        ),
        "action_limit": law.action_limit,
        "action_offset_rad": list(law.action_offset_rad),
        "target_clip_rad": law.target_clip_rad,
        "law": (
            "joint_target = clip(action_offset + action_scale * action, target_clip); "
            "torque = kp * (joint_target - angle) - kd * velocity within torque_limit, "
            "computed anew every physics_dt_s or more often; kp, kd and torque_limit "
            "are those above, nothing has to be added to them"
        ),
        "robot_xml": {
            "joint_damping_nm_s_per_rad": _plain(robot.joint_damping[order]),
            "joint_friction_nm": _plain(
                mj_model.dof_frictionloss[robot.qvel_adr[order]]
            ),
            "is": (
                "what the joints of robot.xml have of their own. Its damping is in kd "
                "already: set it to 0 in a simulation whose motors follow the law. Its "
                "friction is in no gain: a real joint has its own"
            ),
        },
        "observation": _observation(info.env.law)
        + ([] if info.env.course is None else _ahead(law.obs_dim)),
        "gaits": [] if gaits is None else list(gaits.names),
        "memory": [
            {"name": name, "first": 0, "next": f"next_{name}", "is": meaning}
            for name, meaning in (MEMORY if gaits else {}).items()
        ],
        "law_record": to_plain(law, whole=True),
        "warnings": unusual_motors(robot),
        "commands": {
            "forward_m_s": list(info.env.commands.forward_m_s),
            "left_m_s": list(info.env.commands.left_m_s),
            "yaw_rad_s": list(info.env.commands.yaw_rad_s),
        },
    }


def law_of(info: PolicyInfo, robot: Robot) -> Law:
    """The law a policy was trained under: its own, or this project's."""
    return info.env.law or own_law(robot, info.env)


def _ahead(start: int) -> list[dict[str, Any]]:
    """What a chooser of gaits sees beside, from the column `start` on."""
    parts = []
    for part in AHEAD:
        of_part = {"name": part.name, "start": start, "width": part.width}
        parts.append({**of_part, "unit": part.unit, "is": part.meaning})
        start += part.width
    return parts


def _observation(law: Law | None) -> list[dict[str, Any]]:
    """The parts of an observation, and where each begins."""
    if law is None:
        return [
            {
                "name": part.name,
                "start": obs_column(part.name).start,
                "width": part.width,
                "unit": part.unit,
                "is": part.meaning,
            }
            for part in OBSERVATION
        ]
    parts, start = [], 0
    for term in law.terms:
        unit, meaning = MEANINGS[term.name]
        parts.append(
            {
                "name": term.name,
                "start": start,
                "width": term.width,
                "frames": term.frames,
                "scale": list(term.scales),
                "clip": term.clip,
                "unit": unit,
                "is": meaning,
            }
        )
        start += term.width * (term.frames if law.by_term else 1)
    return parts


def _plain(values: np.ndarray) -> list[float | None]:
    return [float(v) if math.isfinite(v) else None for v in values]
