"""The walk that ships, exported: short programs drive it, with no code of ours."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gaitpref.cli.main import main
from policy.robots.shipped import WALK

onnxruntime = pytest.importorskip(
    "onnxruntime", reason="the extra export is not installed"
)
COMMAND = np.array([0.5, 0.0, 0.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("walk") / "out"
    assert main(["export", "--policy", str(WALK), "--out", str(out)]) == 0
    return out


def seen(told, mj_data, qpos_adr, qvel_adr, last):
    """What the network sees of a robot, as the file says."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, mj_data.qpos[3:7])
    to_world = rotation.reshape(3, 3)
    parts = {
        "base_lin_vel_b": mj_data.qvel[:3] @ to_world,
        "base_ang_vel_b": mj_data.qvel[3:6],
        "gravity_b": -to_world[2],
        "joint_pos_offset": mj_data.qpos[qpos_adr] - told["home_joint_pos_rad"],
        "joint_vel": mj_data.qvel[qvel_adr],
        "last_action": last,
        "command": COMMAND,
    }
    row = np.concatenate([parts[part["name"]] for part in told["observation"]])
    return row[None].astype(np.float32), parts["base_lin_vel_b"][0], to_world[2, 2]


@pytest.mark.parametrize("motors", ["position servos", "plain PD at 500 Hz"])
def test_the_onnx_file_alone_walks(folder: Path, motors: str) -> None:
    """From rest, 10 s at 0.5 m/s: with the servos of the model, and with motors that do
    nothing but `torque = kp (target - angle) - kd velocity` 500 times a second."""
    session = onnxruntime.InferenceSession(
        str(folder / "policy.onnx"), providers=["CPUExecutionProvider"]
    )
    told = json.loads(session.get_modelmeta().custom_metadata_map["policy.json"])
    spec = mujoco.MjSpec.from_file(str(folder / "robot.xml"))
    plain = motors != "position servos"
    if plain:
        for element in [*spec.actuators, *spec.keys]:
            spec.delete(element)
        for name in told["joint_names"]:
            spec.joint(name).damping = [0.0, 0.0, 0.0]
            motor = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
            motor.set_to_motor()
        spec.option.timestep = 0.002
    mj_model = spec.compile()
    mj_data = mujoco.MjData(mj_model)
    joints = [mj_model.joint(name) for name in told["joint_names"]]
    qpos_adr = [int(joint.qposadr[0]) for joint in joints]
    qvel_adr = [int(joint.dofadr[0]) for joint in joints]
    servos = [mj_model.actuator_trnid[:, 0].tolist().index(j.id) for j in joints]
    mj_data.qpos[:7] = [0, 0, told["home_base_height_m"], 1, 0, 0, 0]
    mj_data.qpos[qpos_adr] = told["home_joint_pos_rad"]
    kp, kd = np.array(told["kp_nm_per_rad"]), np.array(told["kd_nm_s_per_rad"])
    limit, last, speeds = np.array(told["torque_limit_nm"]), np.zeros(12), []
    for _ in range(round(10.0 / told["control_dt_s"])):
        obs, forward, upright = seen(told, mj_data, qpos_adr, qvel_adr, last)
        last, target = (rows[0] for rows in session.run(None, {"obs": obs}))
        for _ in range(round(told["control_dt_s"] / mj_model.opt.timestep)):
            angle, velocity = mj_data.qpos[qpos_adr], mj_data.qvel[qvel_adr]
            torque = np.clip(kp * (target - angle) - kd * velocity, -limit, limit)
            mj_data.ctrl[servos] = torque if plain else target
            mujoco.mj_step(mj_model, mj_data)
        assert upright > 0.9
        speeds.append(forward)
    assert np.mean(speeds[100:]) == pytest.approx(0.5, abs=0.1)


def test_the_file_says_what_a_motor_driver_needs(folder: Path) -> None:
    """Every number with a unit, for every joint, and the frames it is in."""
    told = json.loads((folder / "policy.json").read_text())
    assert told["robot"] == "go1"
    assert told["conventions"]["quaternion"].startswith("w, x, y, z")
    assert told["warnings"] == []
    for name in (
        *("kp_nm_per_rad", "kd_nm_s_per_rad", "torque_limit_nm", "joint_range_rad"),
        *("speed_limit_rad_s", "home_joint_pos_rad", "action_offset_rad"),
    ):
        assert len(told[name]) == 12, name
