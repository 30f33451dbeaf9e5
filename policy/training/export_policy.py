"""A policy as files that need no Python of ours: ONNX, TorchScript, JSON, MJCF.

Shapes: N observations at once.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import math
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.files.files import write_atomically
from data.files.plain import to_plain
from policy.env.course import AHEAD, AHEAD_DIM
from policy.env.feature_row import OBSERVATION, obs_column
from policy.env.own_law import own_law
from policy.law.law import MEANINGS, Law
from policy.networks.recipe import RecipeNetwork
from policy.networks.settled import settled
from policy.robots.motor_class import unusual_motors
from policy.robots.robot import Robot

from .checkpoint import Policy, PolicyInfo
from .policy_error import PolicyError

FORMAT_VERSION = 5
"""Version of policy.json. In 1, `kd_nm_s_per_rad` lacked the damping of the joints; in
2, `law_record` was not there, which names everything a policy is brought in by; in 3,
`speed_limit_rad_s` and `conventions` were not; in 4, `memory` was not."""
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
_UNBOUNDED_RAD = 1e6
"""Bound of targets that have none: infinity is in no file of ours."""

MEMORY = {
    "gait": "which of the gaits ran in the step before",
    "steps": "control steps since it was chosen",
}
"""What one that chooses among gaits remembers, and what it is."""
ONNX_NAME, SCRIPT_NAME = "policy.onnx", "policy.pt"
JSON_NAME, MJCF_NAME = "policy.json", "robot.xml"


class _Deployed(nn.Module):
    """The network and what the environment does with its actions."""

    def __init__(self, policy: Policy, law: Law) -> None:
        super().__init__()
        network = policy.network
        if isinstance(network, RecipeNetwork):
            # One that was brought in by an earlier version may compute its shapes.
            network = settled(network)
        self.network = network
        self.action_limit = law.action_limit
        self.order: Tensor
        self.scale_rad: Tensor
        self.offset: Tensor
        self.low: Tensor
        self.high: Tensor
        bounds = law.target_clip_rad or ((-_UNBOUNDED_RAD, _UNBOUNDED_RAD),) * 12
        low, high = np.array(bounds).T
        self.register_buffer("order", torch.from_numpy(law.from_canonical))
        self.register_buffer("scale_rad", _float32(np.array(law.action_scale_rad)))
        self.register_buffer("offset", _float32(np.array(law.action_offset_rad)))
        self.register_buffer("low", _float32(low))
        self.register_buffer("high", _float32(high))

    def forward(self, obs: Tensor) -> tuple[Tensor, ...]:
        """Actions [N, 12] and joint targets [N, 12], rad, of `obs` [N, D]."""
        return self._moved(self.network(obs))

    def _moved(self, acted: Tensor) -> tuple[Tensor, Tensor]:
        """Actions and joint targets of what the network acts."""
        action = acted.index_select(1, self.order)
        action = action.clamp(-self.action_limit, self.action_limit)
        target = self.offset + self.scale_rad * action
        return action, torch.minimum(torch.maximum(target, self.low), self.high)


class _DeployedGaits(_Deployed):
    """One that chooses among gaits, and is told what it remembers."""

    def forward(self, obs: Tensor, gait: Tensor, steps: Tensor) -> tuple[Tensor, ...]:
        """The same of `obs` [N, D], and the memory [N] and [N] of the next step."""
        acted, *memory = self.network(obs, gait, steps)
        return *self._moved(acted), *memory


def export(policy: Policy, out: Path) -> list[Path]:
    """Write `policy` into the directory `out`; gives the files written.

    The network maps `obs` [N, D] to `action` [N, 12] and `joint_target` [N, 12], with
    joints in the order of policy.json. One that chooses among gaits also takes what it
    remembers, `gait` and `steps` [N], and gives it for the next step.
    """
    robot = policy.robot()
    law = law_of(policy.info, robot)
    gaits = policy.info.ppo.gaits
    kind = _Deployed if gaits is None else _DeployedGaits
    # Also says of what no file can hold that it cannot, before anything is written.
    deployed = kind(policy, law).eval()
    described = json.dumps(describe(policy.info, robot, policy.sha256), indent=1)
    dim = law.obs_dim if gaits is None else law.obs_dim + AHEAD_DIM
    remembered = () if gaits is None else tuple(MEMORY)
    contents = {
        ONNX_NAME: _by_torch(
            "ONNX", lambda: _onnx(deployed, dim, remembered, described)
        ),
        SCRIPT_NAME: _by_torch(
            "TorchScript", lambda: _torchscript(deployed, dim, remembered)
        ),
        JSON_NAME: described.encode() + b"\n",
        MJCF_NAME: robot.mjcf.encode(),
    }
    out.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        write_atomically(out / name, content)
    return [out / name for name in contents]


def describe(info: PolicyInfo, robot: Robot, sha256: str) -> dict[str, Any]:
    """All that is needed to run the network on a robot, as plain values.

    What is infinite, a joint without limits, is None; so is what nobody said.
    """
    mj_model = robot.mj_model
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
        "memory": [] if info.ppo.gaits is None else _memory(info.ppo.gaits.names),
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


def _memory(gaits: tuple[str, ...]) -> list[dict[str, Any]]:
    """What goes in beside `obs` and comes out under the same name, as int64 [N]."""
    return [
        {"name": name, "first": 0, "next": f"next_{name}", "is": meaning}
        | ({"gaits": list(gaits)} if name == "gait" else {})
        for name, meaning in MEMORY.items()
    ]


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


def _by_torch(kind: str, write: Callable[[], bytes]) -> bytes:
    """What `write` gives.

    Raises:
        PolicyError: torch cannot, whatever it says of its own inside.
    """
    try:
        # It prints what it was at when it fails.
        with contextlib.redirect_stderr(io.StringIO()):
            return write()
    except Exception as error:
        cause = error.__cause__ or error
        told = " ".join(re.sub(r"\x1b\[\d*m", "", str(cause)).split())[:160]
        raise PolicyError(
            f"torch cannot write this policy as {kind} ({type(cause).__name__}: {told})"
            ": an imported policy goes out as it came in with --like SOURCE; of one "
            "trained here, try the versions of constraints.txt"
        ) from None


def _examples(rows: int, obs_dim: int, remembered: tuple[str, ...]) -> list[Tensor]:
    """Inputs of a network: observations, and what is remembered."""
    obs = torch.linspace(-1, 1, rows * obs_dim).view(rows, obs_dim)
    return [obs, *(torch.zeros(rows, dtype=torch.long) for _ in remembered)]


def _onnx(
    deployed: nn.Module, obs_dim: int, remembered: tuple[str, ...], described: str
) -> bytes:
    # It would tell of every package it could export for and does not find.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    batch = torch.export.Dim("batch", min=1)
    with warnings.catch_warnings():
        # The exporter warns of its own future.
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            deployed,
            # Two rows: a batch of one would be taken for a constant.
            tuple(_examples(2, obs_dim, remembered)),
            dynamo=True,
            verbose=False,
            input_names=["obs", *remembered],
            output_names=[
                *("action", "joint_target"),
                *(f"next_{name}" for name in remembered),
            ],
            dynamic_shapes={name: {0: batch} for name in ("obs", *remembered)},
        )
    assert program is not None
    # One file that is copied alone still says what its numbers mean.
    program.model.metadata_props[JSON_NAME] = described
    # Serialised whole, the weights are inside and no second file is needed.
    return program.model_proto.SerializeToString()


def _torchscript(
    deployed: nn.Module, obs_dim: int, remembered: tuple[str, ...]
) -> bytes:
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # TorchScript is deprecated, and what robots run.
        warnings.simplefilter("ignore")
        # Traced, since a network of others is no code that could be scripted.
        with torch.no_grad():
            example = tuple(_examples(2, obs_dim, remembered))
            traced: Any = torch.jit.trace(deployed, example)
        torch.jit.save(traced, stream)
    # A trace keeps what hung on the example for what always is.
    for rows in (1, 3):
        inputs = _examples(rows, obs_dim, remembered)
        with torch.no_grad():
            pairs = zip(traced(*inputs), deployed(*inputs), strict=True)
        if not all(torch.allclose(a, b, atol=1e-5) for a, b in pairs):
            raise ValueError("its operations hang on how many observations there are")
    return stream.getvalue()


def _plain(values: np.ndarray) -> list[float | None]:
    return [float(v) if math.isfinite(v) else None for v in values]


def _float32(values: np.ndarray) -> Tensor:
    return torch.tensor(values.astype(np.float32))
