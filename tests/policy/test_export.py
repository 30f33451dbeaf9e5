"""An exported policy walks in plain MuJoCo, without any code of ours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from gaitpref.cli.main import main
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot, load_robot_xml
from policy.training.checkpoint import Policy, load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.foreign_robots import Drawing, mjcf
from tests.helpers.short_program import give_plain_motors, in_a_row, seen

onnxruntime = pytest.importorskip(
    "onnxruntime", reason="the extra export is not installed"
)

STEPS = 50


@pytest.fixture(scope="module", params=["go1", "stranger", "damped"])
def exported(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Policy]:
    """A policy of a few iterations and the directory it was exported to."""
    folder = tmp_path_factory.mktemp(request.param)
    dt_s = EnvCfg().physics_dt_s
    robot = load_robot(physics_dt_s=dt_s)
    if request.param == "stranger":
        drawing = Drawing(order=("rr", "fr", "rl", "fl"), sign=-1.0)
        robot = load_robot_xml(mjcf(drawing), name="stranger", physics_dt_s=dt_s)
    if request.param == "damped":
        # As Menagerie draws the Go2: its servos get no kd, the joints have it all.
        drawing = Drawing(damping=3.0)
        robot = load_robot_xml(mjcf(drawing), name="damped", physics_dt_s=dt_s)
        assert robot.kd.tolist() == robot.joint_damping.tolist() == [3.0] * 12
    ppo = PpoCfg(num_envs=32, hidden_sizes=(16,))
    cfg = TrainCfg(steps=5 * ppo.steps_per_iteration, env=EnvCfg(), ppo=ppo)
    file = train(folder / "run", robot, cfg).policy
    assert main(["export", "--policy", str(file), "--out", str(folder / "out")]) == 0
    return folder / "out", load_policy(file)


def _session(folder: Path):
    return onnxruntime.InferenceSession(
        str(folder / "policy.onnx"), providers=["CPUExecutionProvider"]
    )


@pytest.mark.filterwarnings("ignore:.torch.jit:DeprecationWarning")
def test_onnx_torchscript_and_policy_give_the_same_actions(
    exported: tuple[Path, Policy],
) -> None:
    """For any number of observations, to 1e-5; weights are in the one file."""
    folder, policy = exported
    script = torch.jit.load(folder / "policy.pt")
    for count in (1, 7):
        obs = torch.randn(count, 48, generator=torch.Generator().manual_seed(count))
        limit = policy.info.env.action_limit
        wanted = policy(obs).clamp(-limit, limit).numpy()
        action, target = _session(folder).run(None, {"obs": obs.numpy()})
        assert action == pytest.approx(wanted, abs=1e-5)
        scripted, scripted_target = script(obs)
        assert scripted.detach().numpy() == pytest.approx(wanted, abs=1e-5)
        assert scripted_target.detach().numpy() == pytest.approx(target, abs=1e-5)
    names = {path.name for path in folder.iterdir()}
    assert names == {"policy.onnx", "policy.pt", "policy.json", "robot.xml"}


def test_the_exported_policy_walks_the_same_in_plain_mujoco(
    exported: tuple[Path, Policy],
) -> None:
    """MuJoCo, onnxruntime and the JSON alone repeat what the environment did."""
    folder, policy = exported
    robot, cfg = policy.robot(), policy.info.env
    command = (0.5, 0.0, 0.1)
    env = QuadrupedEnv(robot, cfg, 1, seed=4)
    env.fix_commands(torch.tensor([command]))
    start_qpos, start_qvel = env.sim.raw_state()
    actions, heights, places = [], [], []
    for _ in range(STEPS):
        obs = env.get_observations()["policy"]
        actions.append(policy(obs)[0].numpy())
        env.step(policy(obs))
        places.append(env.sim.raw_state()[0][0, :7])

    # From here on: no code of the project.
    told = json.loads((folder / "policy.json").read_text())
    session = _session(folder)
    mj_model = mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:], mj_data.qvel[:] = start_qpos[0], start_qvel[0]
    joints = [mj_model.joint(name) for name in told["joint_names"]]
    qpos_adr = [int(joint.qposadr[0]) for joint in joints]
    qvel_adr = [int(joint.dofadr[0]) for joint in joints]
    servos = [
        int(np.flatnonzero(mj_model.actuator_trnid[:, 0] == joint.id)[0])
        for joint in joints
    ]
    assert mj_model.actuator_gainprm[servos, 0].tolist() == told["kp_nm_per_rad"]
    assert mj_model.opt.timestep == told["physics_dt_s"]
    substeps = round(told["control_dt_s"] / told["physics_dt_s"])
    last = np.zeros(12)
    for step in range(STEPS):
        parts = seen(told, mj_data, qpos_adr, qvel_adr, last, command)
        row = np.zeros((1, 48), np.float32)
        for part in told["observation"]:
            row[0, part["start"] : part["start"] + part["width"]] = parts[part["name"]]
        action, target = session.run(None, {"obs": row})
        if step == 0:
            assert action[0] == pytest.approx(actions[0], abs=1e-5)
        last = action[0]
        mj_data.ctrl[servos] = target[0]
        mujoco.mj_step(mj_model, mj_data, nstep=substeps)
        assert mj_data.qpos[:7] == pytest.approx(places[step], abs=2e-3), step
        heights.append(mj_data.qpos[2])
    assert min(heights) > 0.5 * told["home_base_height_m"]


def _on_plain_motors(
    folder: Path, told: dict[str, Any], kd: np.ndarray
) -> tuple[float, float]:
    """How upright it stays at least, 1 at best, and how fast its joints turn, rad/s
    (root mean square); dropped from 5 cm, with no damping in any joint."""
    spec = mujoco.MjSpec.from_file(str(folder / "robot.xml"))
    give_plain_motors(spec, told)
    mj_model = spec.compile()
    mj_data = mujoco.MjData(mj_model)
    joints = [mj_model.joint(name) for name in told["joint_names"]]
    qpos_adr = [int(joint.qposadr[0]) for joint in joints]
    qvel_adr = [int(joint.dofadr[0]) for joint in joints]
    assert not mj_model.dof_damping.any()
    home = np.array(told["home_joint_pos_rad"])
    kp, limit = np.array(told["kp_nm_per_rad"]), np.array(told["torque_limit_nm"])
    mj_data.qpos[:7] = [0, 0, told["home_base_height_m"] + 0.05, 1, 0, 0, 0]
    mj_data.qpos[qpos_adr] = home
    session, last, upright, speeds = _session(folder), np.zeros(12), [], []
    for _ in range(150):
        parts = seen(told, mj_data, qpos_adr, qvel_adr, last, (0.5, 0.0, 0.0))
        obs = in_a_row(told, parts)
        last, target = (rows[0] for rows in session.run(None, {"obs": obs}))
        for _ in range(round(told["control_dt_s"] / told["physics_dt_s"])):
            angle, velocity = mj_data.qpos[qpos_adr], mj_data.qvel[qvel_adr]
            torque = kp * (target - angle) - kd * velocity
            mj_data.ctrl[:] = np.clip(torque, -limit, limit)
            mujoco.mj_step(mj_model, mj_data)
        upright.append(-parts["gravity_b"][2])
        speeds.append(mj_data.qvel[qvel_adr])
    return min(upright), float(np.sqrt(np.mean(np.square(speeds))))


def test_the_law_of_the_json_holds_on_plain_motors(
    exported: tuple[Path, Policy],
) -> None:
    """One kp and one kd a joint are enough; without the joints' damping legs ring."""
    folder, _ = exported
    told = json.loads((folder / "policy.json").read_text())
    kd = np.array(told["kd_nm_s_per_rad"])
    upright, speed = _on_plain_motors(folder, told, kd)
    assert upright > 0.97
    in_joints = np.array(told["robot_xml"]["joint_damping_nm_s_per_rad"])
    if np.array_equal(in_joints, kd):
        rings = _on_plain_motors(folder, told, kd - in_joints)[1]
        assert rings > 2 * speed


def test_the_onnx_file_alone_says_what_its_numbers_mean(
    exported: tuple[Path, Policy],
) -> None:
    folder, _ = exported
    told = _session(folder).get_modelmeta().custom_metadata_map["policy.json"]
    assert told == (folder / "policy.json").read_text().strip()


def test_the_json_tells_gains_home_and_rates(exported: tuple[Path, Policy]) -> None:
    """What a robot's own program has to know, in the order of the outputs."""
    folder, policy = exported
    told = json.loads((folder / "policy.json").read_text())
    robot = policy.robot()
    assert told["robot"] == robot.name
    assert told["control_dt_s"] == pytest.approx(0.02)
    assert told["action_scale_rad"] == policy.info.env.action_scale_rad
    assert told["home_joint_pos_rad"] == robot.home_joint_pos.tolist()
    assert told["torque_limit_nm"] == robot.torque_limit.tolist()
    assert sum(part["width"] for part in told["observation"]) == 48
    assert all(kp > 0 for kp in told["kp_nm_per_rad"])
    assert told["kd_nm_s_per_rad"] == robot.kd.tolist()
    friction = robot.mj_model.dof_frictionloss[robot.qvel_adr]
    assert told["robot_xml"]["joint_friction_nm"] == friction.tolist()
