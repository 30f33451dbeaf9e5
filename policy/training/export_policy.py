"""A policy as files that need no Python of ours: ONNX, TorchScript, JSON, MJCF.

Shapes: N observations at once.
"""

from __future__ import annotations

import io
import json
import logging
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.features import JOINTS
from data.files.files import write_atomically
from policy.env.feature_row import OBS_DIM, OBSERVATION, obs_column
from policy.robots.robot import Robot

from .checkpoint import Policy, PolicyInfo

FORMAT_VERSION = 2
"""Version of policy.json. In 1, `kd_nm_s_per_rad` lacked the damping of the joints."""

ONNX_NAME, SCRIPT_NAME = "policy.onnx", "policy.pt"
JSON_NAME, MJCF_NAME = "policy.json", "robot.xml"


class _Deployed(nn.Module):
    """The network and what the environment does with its actions."""

    def __init__(self, policy: Policy, robot: Robot) -> None:
        super().__init__()
        env = policy.info.env
        self.network = policy.network
        self.action_limit = env.action_limit
        self.action_scale_rad = env.action_scale_rad
        self.home: Tensor
        self.low: Tensor
        self.high: Tensor
        self.register_buffer("home", _float32(robot.home_joint_pos))
        self.register_buffer("low", _float32(robot.joint_range[:, 0]))
        self.register_buffer("high", _float32(robot.joint_range[:, 1]))

    def forward(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Actions [N, 12] and joint targets [N, 12], rad, of `obs` [N, 48]."""
        action = self.network(obs).clamp(-self.action_limit, self.action_limit)
        target = self.home + self.action_scale_rad * action
        return action, torch.minimum(torch.maximum(target, self.low), self.high)


def export(policy: Policy, out: Path) -> list[Path]:
    """Write `policy` into the directory `out`; gives the files written.

    The network maps `obs` [N, 48] to `action` [N, 12] and `joint_target` [N, 12].
    """
    robot = policy.robot()
    deployed = _Deployed(policy, robot).eval()
    out.mkdir(parents=True, exist_ok=True)
    described = json.dumps(describe(policy.info, robot, policy.sha256), indent=1)
    contents = {
        ONNX_NAME: _onnx(deployed, described),
        SCRIPT_NAME: _torchscript(deployed),
        JSON_NAME: described.encode() + b"\n",
        MJCF_NAME: robot.mjcf.encode(),
    }
    for name, content in contents.items():
        write_atomically(out / name, content)
    return [out / name for name in contents]


def describe(info: PolicyInfo, robot: Robot, sha256: str) -> dict[str, Any]:
    """All that is needed to run the network on a robot, as plain values.

    What is infinite, a joint without limits, is None.
    """
    mj_model = robot.mj_model
    joints = [
        int(np.flatnonzero(mj_model.jnt_qposadr == adr)[0]) for adr in robot.qpos_adr
    ]
    return {
        "format_version": FORMAT_VERSION,
        "policy_sha256": sha256,
        "robot": info.robot_name,
        "control_dt_s": info.env.control_dt_s,
        "physics_dt_s": info.env.physics_dt_s,
        "joints": list(JOINTS),
        "joint_names": [mj_model.joint(joint).name for joint in joints],
        "home_joint_pos_rad": _plain(robot.home_joint_pos),
        "home_base_height_m": float(robot.home_qpos[2]),
        "joint_range_rad": [_plain(row) for row in robot.joint_range],
        "torque_limit_nm": _plain(robot.torque_limit),
        "kp_nm_per_rad": _plain(robot.kp),
        "kd_nm_s_per_rad": _plain(robot.kd),
        "action_scale_rad": info.env.action_scale_rad,
        "action_limit": info.env.action_limit,
        "law": (
            "joint_target = clip(home_joint_pos + action_scale * action, joint_range); "
            "torque = kp * (joint_target - angle) - kd * velocity within torque_limit, "
            "computed anew every physics_dt_s or more often; kp, kd and torque_limit "
            "are those above, nothing has to be added to them"
        ),
        "robot_xml": {
            "joint_damping_nm_s_per_rad": _plain(robot.joint_damping),
            "joint_friction_nm": _plain(mj_model.dof_frictionloss[robot.qvel_adr]),
            "is": (
                "what the joints of robot.xml have of their own. Its damping is in kd "
                "already: set it to 0 in a simulation whose motors follow the law. Its "
                "friction is in no gain: a real joint has its own"
            ),
        },
        "observation": [
            {
                "name": part.name,
                "start": obs_column(part.name).start,
                "width": part.width,
                "unit": part.unit,
                "is": part.meaning,
            }
            for part in OBSERVATION
        ],
        "commands": {
            "forward_m_s": list(info.env.commands.forward_m_s),
            "left_m_s": list(info.env.commands.left_m_s),
            "yaw_rad_s": list(info.env.commands.yaw_rad_s),
        },
    }


def _onnx(deployed: nn.Module, described: str) -> bytes:
    # It would tell of every package it could export for and does not find.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    batch = torch.export.Dim("batch", min=1)
    # Two rows: a batch of one would be taken for a constant.
    example = torch.zeros(2, OBS_DIM)
    with warnings.catch_warnings():
        # The exporter warns of its own future.
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            deployed,
            (example,),
            dynamo=True,
            verbose=False,
            input_names=["obs"],
            output_names=["action", "joint_target"],
            dynamic_shapes={"obs": {0: batch}},
        )
    assert program is not None
    # One file that is copied alone still says what its numbers mean.
    program.model.metadata_props[JSON_NAME] = described
    # Serialised whole, the weights are inside and no second file is needed.
    return program.model_proto.SerializeToString()


def _torchscript(deployed: nn.Module) -> bytes:
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # TorchScript is deprecated, and what robots run.
        warnings.simplefilter("ignore")
        torch.jit.save(torch.jit.script(deployed), stream)
    return stream.getvalue()


def _plain(values: np.ndarray) -> list[float | None]:
    return [float(v) if math.isfinite(v) else None for v in values]


def _float32(values: np.ndarray) -> Tensor:
    return torch.tensor(values.astype(np.float32))
