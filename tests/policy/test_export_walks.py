"""The walk that ships, exported: short programs drive it, with no code of ours.

It walks on a Go2 too, whose gains, as Menagerie draws it, no such robot runs.
"""

from __future__ import annotations

import io
import json
import shutil
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gaitpref.cli.main import main
from policy.env.env_cfg import EnvCfg
from policy.robots import shipped
from policy.robots.robot import Robot, load_robot
from policy.robots.shipped import WALK
from policy.training.checkpoint import load_policy, read_plain, save_policy
from tests.helpers.others import GO2
from tests.helpers.short_program import give_plain_motors, in_a_row, seen

onnxruntime = pytest.importorskip(
    "onnxruntime", reason="the extra export is not installed"
)
COMMAND = (0.5, 0.0, 0.0)


@pytest.fixture(scope="module", params=["go1", "go2"])
def folder(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Where the walk was exported, and what was printed is `printed.txt`."""
    path = tmp_path_factory.mktemp(request.param)
    file, out, printed = WALK, path / "out", io.StringIO()
    if request.param == "go2":
        robot, walk, file = _go2(path), load_policy(WALK), path / "go2.pt"
        info = replace(walk.info, robot_name="go2", robot_mjcf=robot.mjcf)
        states = {k: v for k, v in read_plain(WALK).items() if "state_dict" in k}
        save_policy(file, states, info)
    with redirect_stdout(printed):
        assert main(["export", "--policy", str(file), "--out", str(out)]) == 0
    (out / "printed.txt").write_text(printed.getvalue())
    return out


def _go2(path: Path) -> Robot:
    """A Go2 as Menagerie draws it: damping of 2 in its joints, kd of 0 in its servos,
    which get a kp of 62; where it is not here, the Go1 made such a one."""
    model = GO2
    if not GO2.exists():
        model = path / "go2.xml"
        shutil.copy(Path(shipped.__file__).with_name("go1.xml"), model)
        model.with_suffix(".toml").write_text(
            "[servo]\nkp = 62\nkd = 2\n[joints]\ndamping = 2\n"
        )
    robot = load_robot(model, physics_dt_s=EnvCfg().physics_dt_s)
    assert robot.joint_damping.tolist() == robot.kd.tolist() == [2.0] * 12
    return robot


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
        give_plain_motors(spec, told)
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
        parts = seen(told, mj_data, qpos_adr, qvel_adr, last, COMMAND)
        obs = in_a_row(told, parts)
        last, target = (rows[0] for rows in session.run(None, {"obs": obs}))
        for _ in range(round(told["control_dt_s"] / mj_model.opt.timestep)):
            angle, velocity = mj_data.qpos[qpos_adr], mj_data.qvel[qvel_adr]
            torque = np.clip(kp * (target - angle) - kd * velocity, -limit, limit)
            mj_data.ctrl[servos] = torque if plain else target
            mujoco.mj_step(mj_model, mj_data)
        assert -parts["gravity_b"][2] > 0.9
        speeds.append(parts["base_lin_vel_b"][0])
    assert np.mean(speeds[100:]) == pytest.approx(0.5, abs=0.1)


def test_the_file_says_what_a_motor_driver_needs(folder: Path) -> None:
    """Every number with a unit, for every joint, and the frames it is in."""
    told = json.loads((folder / "policy.json").read_text())
    printed = (folder / "printed.txt").read_text()
    if told["robot"] == "go1":
        assert told["warnings"] == []
        assert "warning" not in printed
    else:
        assert told["robot"] == "go2"
        (warning,) = told["warnings"]
        assert warning.startswith("kp is up to 62 N m/rad")
        assert f"warning: {warning}" in printed
    assert told["conventions"]["quaternion"].startswith("w, x, y, z")
    for name in (
        *("kp_nm_per_rad", "kd_nm_s_per_rad", "torque_limit_nm", "joint_range_rad"),
        *("speed_limit_rad_s", "home_joint_pos_rad", "action_offset_rad"),
    ):
        assert len(told[name]) == 12, name
