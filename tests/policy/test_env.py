"""The environment on the real simulator."""

from __future__ import annotations

import math
import os
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from data.features import FEATURE_DIM, column
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import CommandCfg, EnvCfg
from policy.env.feature_row import OBS_DIM
from policy.env.task_reward import TaskRewardCfg, task_reward_for, task_score, weighted
from policy.parallel.cores import CORES
from policy.parallel.ranks import Ranks
from policy.robots.bare import bare_model
from policy.robots.robot import Robot, load_robot
from policy.sim.batch_sim import BatchSim
from policy.sim.chosen import Listed

CFG = EnvCfg(commands=CommandCfg(resample_s=math.inf))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=CFG.physics_dt_s)


def _env(robot: Robot, num_envs: int = 4, cfg: EnvCfg = CFG, seed: int = 0):
    return QuadrupedEnv(robot, cfg, num_envs, seed=seed)


def test_a_standing_robot_has_the_feature_row_of_one(robot: Robot) -> None:
    """After a second of holding the home pose: level, still, four feet down."""
    env = _env(robot)
    extras = {}
    for _ in range(50):
        _, _, dones, extras = env.step(torch.zeros(4, 12))
        assert not dones.any()
    row = extras["features"]
    assert row.shape == (4, FEATURE_DIM)
    assert row[:, column("foot_contact")].eq(1).all()
    assert row[:, column("foot_air_time")].eq(0).all()
    assert row[:, column("foot_height")].abs().max() < 2e-3
    assert row[:, column("foot_speed")].max() < 0.05
    assert row[:, column("gravity_b")][:, 2].max() < -0.99
    assert row[:, column("base_lin_vel_b")].abs().max() < 0.05
    height = row[:, column("base_height")]
    assert 0.85 * robot.home_qpos[2] < height.min() < height.max() < robot.home_qpos[2]
    assert row[:, column("command")].equal(env.command)
    assert row[:, column("fallen")].eq(0).all()
    # The servos carry 12.7 kg: torques are applied, and below their limits.
    torque = row[:, column("joint_torque")].abs()
    assert 2.0 < torque.max() < float(robot.torque_limit.max())


def test_velocities_are_in_the_body_frame(robot: Robot) -> None:
    """A robot facing left (yaw 90 degrees) and drifting along world y moves forward."""
    env = _env(robot, 1)
    qpos = torch.from_numpy(robot.home_qpos.copy())[None]
    qpos[0, 2] += 0.3
    qpos[0, 3:7] = torch.tensor([math.cos(math.pi / 4), 0, 0, math.sin(math.pi / 4)])
    qvel = torch.zeros(1, robot.mj_model.nv, dtype=torch.float64)
    qvel[0, 1] = 0.7
    env.sim.reset(Listed(torch.tensor([0])), qpos, qvel)
    _, _, _, extras = env.step(torch.zeros(1, 12))
    velocity = extras["features"][0, column("base_lin_vel_b")]
    assert velocity[0] == pytest.approx(0.7, abs=0.03)
    assert velocity[1] == pytest.approx(0.0, abs=0.03)


def test_observations_have_48_columns_and_no_nan(robot: Robot) -> None:
    """Random actions never give an observation that is not finite."""
    env, rng = _env(robot, 16), torch.Generator().manual_seed(0)
    for _ in range(100):
        obs, reward, _, extras = env.step(torch.randn(16, 12, generator=rng))
        assert obs["policy"].shape == (16, OBS_DIM)
        assert obs["policy"].isfinite().all()
        assert reward.isfinite().all()
        assert not extras["aborted"].any()


def test_actions_are_clipped_and_their_rate_is_their_difference(robot: Robot) -> None:
    """The row holds the action after clipping, and what it changed by."""
    env = _env(robot, 1)
    _, _, _, first = env.step(torch.full((1, 12), 0.1))
    _, _, _, second = env.step(torch.full((1, 12), 9.0))
    assert first["features"][0, column("action_rate")].eq(0.1).all()
    assert second["features"][0, column("action")].eq(CFG.action_limit).all()
    assert second["features"][0, column("action_rate")].allclose(
        torch.tensor(CFG.action_limit - 0.1)
    )


def test_a_robot_on_its_back_has_fallen(robot: Robot) -> None:
    """Upside down ends the episode, is no time-out, and the next one starts fresh."""
    env = _env(robot, 2)
    qpos = torch.from_numpy(robot.home_qpos.copy())[None]
    qpos[0, 3:7] = torch.tensor([0.0, 1.0, 0.0, 0.0])
    qvel = torch.zeros(1, robot.mj_model.nv, dtype=torch.float64)
    env.sim.reset(Listed(torch.tensor([1])), qpos, qvel)
    obs, reward, dones, extras = env.step(torch.zeros(2, 12))
    assert dones.tolist() == [False, True]
    assert extras["time_outs"].tolist() == [False, False]
    assert extras["features"][1, column("fallen")] == 1
    assert reward[1] < -0.9
    assert obs["policy"][1, 8] < -0.9
    _, _, _, extras = env.step(torch.zeros(2, 12))
    assert extras["starts"].tolist() == [False, True]


def test_visual_geoms_change_no_bit_of_the_motion(robot: Robot) -> None:
    """What is simulated has few geoms and moves like the model as it is drawn."""
    bare = bare_model(robot.mjcf, robot.mj_model)
    assert bare.ngeom < 10 < robot.mj_model.ngeom
    states = []
    for mj_model in (bare, robot.mj_model):
        mj_data, rng = mujoco.MjData(mj_model), np.random.default_rng(0)
        mj_data.qpos[:] = robot.home_qpos
        for _ in range(50):
            mj_data.ctrl[:] = robot.home_joint_pos + 0.3 * rng.standard_normal(12)
            mujoco.mj_step(mj_model, mj_data, nstep=4)
        states.append(np.concatenate([mj_data.qpos, mj_data.qvel, mj_data.sensordata]))
    assert (states[0] == states[1]).all()


def test_a_reset_leaves_nothing_of_what_was_before(robot: Robot) -> None:
    """A simulation that was reset is a new one, to the last number of its state."""
    used, new = BatchSim(robot, 2), BatchSim(robot, 2)
    used.set_targets(torch.full((2, 12), 0.5))
    used.advance(100)
    qpos = torch.from_numpy(robot.home_qpos.copy())[None]
    qvel = torch.full((1, robot.mj_model.nv), 0.1, dtype=torch.float64)
    for sim in (used, new):
        sim.reset(Listed(torch.tensor([1])), qpos, qvel)
        sim.advance(4)
    assert used.snapshot()[1].equal(new.snapshot()[1])
    assert not used.snapshot()[0].equal(new.snapshot()[0])


def test_a_simulation_that_diverges_again_is_noticed_again(robot: Robot) -> None:
    """The count of MuJoCo's warnings starts anew with an episode."""
    env = _env(robot, 2)
    for _ in range(2):
        env.sim._batch.bind("qpos")[1, 2] = np.nan  # type: ignore[attr-defined]
        _, _, _, extras = env.step(torch.zeros(2, 12))
        assert extras["aborted"].tolist() == [False, True]


def test_a_rollout_is_scored_as_its_steps_were(robot: Robot) -> None:
    """Who goes without the reward of steps gets the same from the rows of all."""
    env, rng = _env(robot, 4), torch.Generator().manual_seed(0)
    rows, rewards = [], []
    for _ in range(30):
        _, reward, _, extras = env.step(torch.randn(4, 12, generator=rng))
        rows.append(extras["features"])
        rewards.append(reward)
    at_once, log = env.score(torch.stack(rows))
    assert at_once.allclose(torch.stack(rewards))
    assert log["task/torque"] < 0
    _, nothing, _, extras = env.step(torch.zeros(4, 12), score=False)
    assert nothing.eq(0).all()
    assert extras["log"] == {}


def test_a_time_out_is_no_fall(robot: Robot) -> None:
    """An episode of ten steps is cut at the tenth and bootstrapped."""
    env = _env(robot, 1, replace(CFG, episode_s=0.2))
    for step in range(1, 11):
        _, _, dones, extras = env.step(torch.zeros(1, 12))
        assert bool(dones[0]) == bool(extras["time_outs"][0]) == (step == 10)
        assert extras["features"][0, column("fallen")] == 0


@pytest.mark.parametrize("field", ["qpos", "qvel", "ctrl"])
def test_a_nan_aborts_its_episode_and_no_other(robot: Robot, field: str) -> None:
    """A diverged simulation ends as aborted, with a row of zeros and no reward."""
    env = _env(robot, 3)
    if field == "ctrl":
        actions = torch.zeros(3, 12)
        actions[1, 0] = torch.nan
    else:
        actions = torch.zeros(3, 12)
        env.sim._batch.bind(field)[1, 2] = np.nan  # type: ignore[attr-defined]
    obs, reward, dones, extras = env.step(actions)
    assert extras["aborted"].tolist() == [False, True, False]
    assert dones.tolist() == [False, True, False]
    assert extras["fallen"].tolist() == [False, False, False]
    assert extras["features"][1].eq(0).all()
    assert obs["policy"].isfinite().all()
    assert reward.isfinite().all()
    _, _, dones, extras = env.step(torch.zeros(3, 12))
    assert not dones.any()
    assert not extras["aborted"].any()


def test_commands_are_drawn_within_their_ranges_and_resampled(robot: Robot) -> None:
    """A command lasts its time, and no longer."""
    commands = CommandCfg(
        forward_m_s=(0.5, 0.6),
        left_m_s=(-0.1, 0.0),
        yaw_rad_s=(0.2, 0.3),
        resample_s=0.1,
    )
    env = _env(robot, 64, replace(CFG, commands=commands))
    seen = [env.command.clone()]
    for _ in range(5):
        env.step(torch.zeros(64, 12))
        seen.append(env.command.clone())
    assert all(seen[0].equal(command) for command in seen[:5])
    assert (seen[5] != seen[0]).all()
    low, high = torch.tensor([0.5, -0.1, 0.2]), torch.tensor([0.6, 0.0, 0.3])
    assert ((seen[5] >= low) & (seen[5] <= high)).all()
    assert (seen[5].std(dim=0) > 0.01).all()


def test_a_snapshot_goes_on_bit_for_bit(robot: Robot) -> None:
    """What follows a restore is what followed the snapshot, resets included."""
    actions = torch.randn(80, 8, 12, generator=torch.Generator().manual_seed(3))
    cfg = replace(CFG, episode_s=0.5)
    env = _env(robot, 8, cfg)
    for action in actions[:30]:
        env.step(action)
    snapshot = env.snapshot()
    first = [env.step(action)[3]["features"] for action in actions[30:]]
    other = _env(robot, 8, cfg, seed=9)
    other.restore(snapshot)
    second = [other.step(action)[3]["features"] for action in actions[30:]]
    assert torch.stack(first).equal(torch.stack(second))


def test_the_task_reward_is_a_function_of_the_row(robot: Robot) -> None:
    """What `step` pays equals the score of the logged rows, and each term is logged."""
    env = _env(robot, 8)
    _, reward, _, extras = env.step(torch.zeros(8, 12))
    cfg = task_reward_for(robot, CFG.task)
    score = task_score(extras["features"], cfg, control_dt_s=env.step_dt)
    assert reward.allclose(score * env.step_dt)
    terms = weighted(extras["features"], cfg, control_dt_s=env.step_dt)
    for name, term in zip(cfg.weights, terms, strict=True):
        assert extras["log"][f"task/{name}"] == pytest.approx(
            float(term.mean()), abs=1e-6
        )


def test_task_terms_by_hand() -> None:
    """One row whose terms are worked out on paper."""
    row = torch.zeros(FEATURE_DIM)
    row[column("command")] = torch.tensor([0.5, 0.0, 0.2])
    row[column("base_lin_vel_b")] = torch.tensor([0.2, 0.4, 0.1])
    row[column("base_height")] = 0.25
    row[column("foot_contact")] = torch.tensor([1.0, 1.0, 0.0, 0.0])
    row[column("foot_speed")] = torch.tensor([0.5, 0.0, 1.0, 0.0])
    row[column("foot_height")] = torch.tensor([0.0, 0.0, 0.06, 0.08])
    row[column("foot_air_time")] = torch.tensor([0.0, 0.0, 0.02, 0.3])
    cfg = TaskRewardCfg(height_m=0.28)
    weights = weighted(row, cfg, control_dt_s=0.02)
    terms = dict(zip(cfg.weights, weights, strict=True))
    assert float(terms["track_planar"]) == pytest.approx(
        math.exp(-(0.09 + 0.16) / 0.25)
    )
    assert float(terms["track_yaw"]) == pytest.approx(0.5 * math.exp(-0.04 / 0.25))
    assert float(terms["vertical"]) == pytest.approx(-2 * 0.01)
    assert float(terms["height"]) == pytest.approx(-20 * 0.03**2)
    assert float(terms["slip"]) == pytest.approx(-0.1 * 0.25)
    assert float(terms["clearance"]) == pytest.approx(
        -2 * (0.08**2 * 0.5 + 0.02**2 * 1.0)
    )
    # Two feet swing (+0.02 s each); one of them has just left the ground (-0.2 s).
    assert float(terms["swing"]) == pytest.approx(2.0 * (0.04 - 0.2))


def test_it_has_a_thread_for_each_core_it_was_given_and_tells_no_difference(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or, where nobody gave any, for each it may run on; ranks share them."""
    monkeypatch.delenv(CORES, raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(5)))
    actions = torch.randn(10, 8, 12, generator=torch.Generator().manual_seed(0))
    rows = []
    for given, threads in ((None, 5), ("1", 1), ("3", 3)):
        if given is not None:
            monkeypatch.setenv(CORES, given)
        env = _env(robot, 8)
        assert env.sim._batch.nthread == threads  # type: ignore[attr-defined]
        ranks = [Ranks(size=here, here=here).threads for here in (1, 2, 64)]
        assert ranks == [threads, max(1, threads // 2), 1]
        rows.append(torch.stack([env.step(each)[3]["features"] for each in actions]))
    assert rows[0].equal(rows[1])
    assert rows[0].equal(rows[2])
