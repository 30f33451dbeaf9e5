"""Policies that others published, where their files lie beside the checkout.

What their files of numbers say is put over into the words of a policy.json here, by
hand and with no code of ours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import pytest
import yaml

OTHERS = Path(__file__).resolve().parents[3] / "shared" / "others"
GO2 = OTHERS / "robots" / "unitree_go2" / "scene.xml"
ROBOT_LAB = OTHERS / "rl_sar" / "go2" / "robot_lab" / "policy.pt"
HIMLOCO = OTHERS / "rl_sar" / "go2" / "himloco" / "himloco.pt"
CPP_DEPLOY = OTHERS / "unitree_cpp_deploy" / "kaiwu2025_v6-2_124004"

needs_others = pytest.mark.skipif(
    not OTHERS.is_dir(), reason="policies of others are not here"
)

_NAMES = {
    "ang_vel": "base_ang_vel",
    "gravity_vec": "projected_gravity",
    "commands": "command",
    "velocity_commands": "command",
    "dof_pos": "joint_pos",
    "joint_pos_rel": "joint_pos",
    "dof_vel": "joint_vel",
    "joint_vel_rel": "joint_vel",
    "actions": "last_action",
}


def plainer_go2() -> Any:
    """The Go2 as simulators for training have it: feet that do not resist rolling,
    joints without dry friction."""
    spec = mujoco.MjSpec.from_file(str(GO2))
    for geom in spec.geoms:
        if geom.condim > 3:
            geom.condim, geom.solimp = 3, [0.9, 0.95, 0.001, 0.5, 2.0]
    for joint in spec.joints:
        joint.frictionloss = 0.0
    return spec


def rl_sar_told(network: Path) -> dict[str, Any]:
    """Of `config.yaml` beside it and `base.yaml` above."""
    base = yaml.safe_load((network.parents[1] / "base.yaml").read_text())["go2"]
    (config,) = yaml.safe_load(network.with_name("config.yaml").read_text()).values()
    scales = {"commands": config["commands_scale"]}
    scales |= {n: config[f"{n}_scale"] for n in ("ang_vel", "dof_pos", "dof_vel")}
    part = {"clip": None, "frames": max(1, len(config["observations_history"]))}
    return {
        "observation": [
            {"name": _NAMES[n], "scale": scales.get(n, 1.0), **part}
            for n in config["observations"]
        ],
        # By time, and 0 is the latest.
        "law_record": {"by_term": False, "newest_first": True, "obs_limit": 100.0},
        "joint_names": [base["joint_names"][i] for i in config["joint_mapping"]],
        "physics_dt_s": base["dt"],
        "control_dt_s": base["dt"] * base["decimation"],
        "kp_nm_per_rad": config["rl_kp"],
        "kd_nm_s_per_rad": config["rl_kd"],
        "torque_limit_nm": config["torque_limits"],
        "home_joint_pos_rad": config["default_dof_pos"],
        "home_base_height_m": 0.34,
        "action_offset_rad": config["default_dof_pos"],
        "action_scale_rad": config["action_scale"],
        "action_limit": 100.0,
        "target_clip_rad": None,
    }


def cpp_deploy_told() -> dict[str, Any]:
    """Of `deploy.yaml`; limits of torque are the robot's, of which it says nothing."""
    told = yaml.safe_load((CPP_DEPLOY / "params" / "deploy.yaml").read_text())
    motors = [
        f"{leg}_{part}_joint"
        for leg in ("FR", "FL", "RR", "RL")
        for part in ("hip", "thigh", "calf")
    ]
    joints = [motors[motor] for motor in told["joint_ids_map"]]
    action = told["actions"]["JointPositionAction"]
    return {
        "observation": [
            {
                "name": _NAMES.get(name, name),
                "scale": each["scale"],
                "clip": each["clip"],
                "frames": each["history_length"],
            }
            for name, each in told["observations"].items()
        ],
        "law_record": {"by_term": True, "newest_first": False, "obs_limit": None},
        "joint_names": joints,
        "physics_dt_s": 0.005,
        "control_dt_s": told["step_dt"],
        "kp_nm_per_rad": told["stiffness"],
        "kd_nm_s_per_rad": told["damping"],
        "torque_limit_nm": [45.43 if "calf" in name else 23.7 for name in joints],
        "home_joint_pos_rad": told["default_joint_pos"],
        "home_base_height_m": 0.34,
        "action_offset_rad": action["offset"],
        "action_scale_rad": action["scale"],
        "action_limit": 100.0,
        "target_clip_rad": action["clip"],
    }
