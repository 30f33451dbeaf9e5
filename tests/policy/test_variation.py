"""Policies in other postures, on the real simulator."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from data.features import column
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import Robot, load_robot
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.rollouts.rollout import first_episodes, hold_home
from policy.rollouts.variation import VariationCfg, Varied, joints_per_shift
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

ENV = EnvCfg(episode_s=1.0)
ALL = VariationCfg(share=1.0)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=ENV.physics_dt_s)


def test_joints_move_the_feet_where_they_should_go(robot: Robot) -> None:
    """1 cm forward, out or down in the frame of the base, for each foot alone."""
    per_shift = joints_per_shift(robot)
    mj_data = mujoco.MjData(robot.mj_model)
    for leg in range(4):
        for axis in range(3):
            mj_data.qpos[:] = robot.home_qpos
            joints = robot.qpos_adr[3 * leg : 3 * leg + 3]
            mj_data.qpos[joints] += 0.01 * per_shift[leg, :, axis]
            mujoco.mj_kinematics(robot.mj_model, mj_data)
            moved = mj_data.site_xpos[robot.foot_site_ids] - robot.home_foot_pos_w
            wanted = np.zeros((4, 3))
            wanted[leg, axis] = 0.01
            assert moved == pytest.approx(wanted, abs=0.002)


def heights(robot: Robot, cfg: VariationCfg, *, seed: int = 0) -> torch.Tensor:
    """Height of each base at the end of a second of standing."""
    env = QuadrupedEnv(robot, ENV, 32, seed=0, keep_final=True)
    actor = Varied(
        hold_home,
        robot,
        cfg,
        32,
        action_scale_rad=ENV.action_scale_rad,
        rng=torch.Generator().manual_seed(seed),
    )
    *_, last = first_episodes(actor, env)
    return last.features[:, column("base_height")][:, 0]


def test_a_varied_robot_stands_higher_or_lower(robot: Robot) -> None:
    """By centimetres, where it varies; not at all elsewhere."""
    still = heights(robot, VariationCfg())
    assert float(still.std()) < 0.004
    varied = heights(robot, ALL)
    assert float(varied.std()) > 0.01
    assert varied.min() < still.mean() - 0.02
    assert varied.max() > still.mean() + 0.02


def test_equal_seeds_give_equal_postures(robot: Robot) -> None:
    assert torch.equal(heights(robot, ALL), heights(robot, ALL))
    assert not torch.equal(heights(robot, ALL), heights(robot, ALL, seed=1))


def test_episodes_say_that_their_posture_was_varied(
    robot: Robot, tmp_path: Path
) -> None:
    ppo = PpoCfg(num_envs=8, hidden_sizes=(8,))
    policy = train(tmp_path, robot, TrainCfg(steps=192, env=ENV, ppo=ppo)).policy
    half = RecordCfg(
        episodes=40, episode_s=0.4, noisy_share=0.0, variation=VariationCfg(share=0.5)
    )
    found = list(record(policy, half, seed=0))
    varied = [e for e in found if e.meta.extra.get("posture") == "varied"]
    assert 8 <= len(varied) <= 32
    alike = [e for e in found if "posture" not in e.meta.extra]

    def spread(episodes: list) -> float:
        return float(np.std([e.action.mean(axis=0) for e in episodes], axis=0).mean())

    assert spread(varied) > 3 * spread(alike)


def test_shares_and_gains_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match=r"share must lie in \[0, 1\], got 1.5"):
        VariationCfg(share=1.5)
    with pytest.raises(ValueError, match=r"gain must lie in \[0, 1\), got 1.0"):
        VariationCfg(gain=1.0)
