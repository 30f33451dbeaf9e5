"""Robots that differ: each option is tested by what it changes in the physics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from mujoco.batch import Batch

from data.features import column
from gaitpref.cli.main import main
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import RANDOMISE, EnvCfg, NoiseCfg, RandomiseCfg, ResetCfg
from policy.env.randomise import RandomisedEnv, make_env
from policy.robots.robot import Robot, load_robot
from policy.sim.batch_sim import VariedBatchSim
from policy.sim.chosen import Listed
from policy.training.checkpoint import PolicyError, load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

STILL = ResetCfg(
    joint_pos_rad=0,
    joint_vel_rad_s=0,
    base_lin_vel_m_s=0,
    base_ang_vel_rad_s=0,
    tilt_rad=0,
    height_m=0,
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=EnvCfg().physics_dt_s)


def _env(robot: Robot, num_envs: int, **options: Any) -> RandomisedEnv:
    """An environment that starts at rest and differs by `options` alone."""
    cfg = EnvCfg(randomise=RandomiseCfg(**options), reset=STILL)
    env = make_env(robot, cfg, num_envs, seed=0)
    assert isinstance(env, RandomisedEnv)
    return env


def _model(env: RandomisedEnv, index: int) -> Any:
    """The MuJoCo model of one robot."""
    assert isinstance(env.sim, VariedBatchSim)
    return env.sim._batch.get_model(index)


def _held(env: QuadrupedEnv, steps: int) -> torch.Tensor:
    """The last feature rows after holding the home pose."""
    extras: dict[str, Any] = {}
    for _ in range(steps):
        extras = env.step(torch.zeros(env.num_envs, 12))[3]
    return extras["features"]


def _batch(env: RandomisedEnv) -> Batch:
    assert isinstance(env.sim, VariedBatchSim)
    return env.sim._batch


def test_off_is_the_plain_environment(robot: Robot) -> None:
    assert RANDOMISE["off"] == EnvCfg().randomise
    assert type(make_env(robot, EnvCfg(), 2, seed=0)) is QuadrupedEnv


def test_a_heavier_robot_sinks_deeper_and_weighs_more(robot: Robot) -> None:
    """Each simulation has its own masses, within the range, and feels them."""
    env = _env(robot, 16, mass=(0.8, 1.2))
    masses = np.array([_model(env, i).body_subtreemass[0] for i in range(16)])
    factors = env.sim.draw.mass[:, 0].numpy()
    assert masses == pytest.approx(12.744 * factors)
    assert ((factors > 0.8) & (factors < 1.2)).all()
    height = _held(env, 40)[:, column("base_height")][:, 0].numpy()
    assert np.corrcoef(factors, height)[0, 1] < -0.95


def test_a_stronger_robot_stands_higher(robot: Robot) -> None:
    env = _env(robot, 16, strength=(0.7, 1.3))
    factors = env.sim.draw.strength[:, 0].numpy()
    height = _held(env, 40)[:, column("base_height")][:, 0].numpy()
    assert np.corrcoef(factors, height)[0, 1] > 0.95
    limits = np.array([_model(env, i).actuator_forcerange[0, 1] for i in range(16)])
    assert limits == pytest.approx(23.7 * factors)


def test_less_friction_slides_farther(robot: Robot) -> None:
    """The same shove moves feet on ice, and none on rubber."""
    env = _env(robot, 12, friction=(0.05, 1.5))
    _held(env, 20)
    env.sim.push(Listed(torch.arange(12)), torch.tensor([[0.0, 0.8]]).repeat(12, 1))
    slid_m = torch.zeros(12)
    for _ in range(20):
        rows = env.step(torch.zeros(12, 12))[3]["features"]
        touching = rows[:, column("foot_contact")] > 0
        slid_m += (rows[:, column("foot_speed")] * touching).sum(dim=1) * env.step_dt
    factors = env.sim.draw.friction[:, 0]
    assert slid_m[factors.argmin()] > 3 * slid_m[factors.argmax()]
    friction = [_model(env, i).geom("floor").friction[0] for i in range(12)]
    assert friction == pytest.approx((0.8 * factors).tolist())


def test_a_shifted_centre_of_mass_tilts_the_robot(robot: Robot) -> None:
    env = _env(robot, 16, com_m=0.05)
    gravity = _held(env, 40)[:, column("gravity_b")].numpy()
    shift = env.sim.draw.com_m.numpy()
    assert np.corrcoef(shift[:, 0], gravity[:, 0])[0, 1] > 0.9
    assert np.corrcoef(shift[:, 1], gravity[:, 1])[0, 1] > 0.9


def test_a_late_target_arrives_one_step_late(robot: Robot) -> None:
    """After one step of a new target, only the robots without delay have moved."""
    env = _env(robot, 32, delayed_share=0.5)
    _held(env, 20)
    before = env.sim.read().joint_pos
    env.step(torch.full((32, 12), 1.0))
    moved = (env.sim.read().joint_pos - before).abs().amax(dim=1)
    late = env.sim.draw.delayed[:, 0] > 0
    assert 4 < late.sum() < 28
    assert moved[late].max() < 0.02 < 0.05 < moved[~late].min()


def test_pushes_come_at_their_time_and_within_their_size(robot: Robot) -> None:
    env = _env(robot, 64, push_m_s=0.5, push_every_s=1.0)
    speeds = []
    for _ in range(50):
        rows = env.step(torch.zeros(64, 12))[3]["features"]
        speeds.append(float(rows[:, :2].abs().amax()))
    assert max(speeds[40:49]) < 0.05
    assert 0.2 < speeds[49] < 0.6


def test_a_biased_encoder_deceives_policy_and_servo(robot: Robot) -> None:
    """The policy reads the biased angle, and the joint rests that much elsewhere."""
    env = _env(robot, 4, encoder_bias_rad=0.05)
    plain = make_env(robot, EnvCfg(reset=STILL), 4, seed=0)
    for other in (env, plain):
        _held(other, 60)
    bias = env.sim.draw.encoder_bias_rad
    true = env.sim.read().joint_pos
    seen = env.get_observations()["policy"][:, 9:21]
    home = torch.tensor(robot.home_joint_pos, dtype=torch.float32)
    assert seen == pytest.approx(true - home + bias, abs=1e-5)
    difference = (true - plain.sim.read().joint_pos).flatten()
    agreement = torch.corrcoef(torch.stack([difference, -bias.flatten()]))[0, 1]
    assert agreement > 0.7


def test_noise_is_seen_by_the_policy_and_not_by_the_critic(robot: Robot) -> None:
    """Within its amplitude, new in every step, and in no feature row."""
    noise = NoiseCfg(joint_vel_rad_s=0.4)
    env = _env(robot, 32, noise=noise)
    plain = make_env(robot, EnvCfg(reset=STILL), 32, seed=0)
    for other in (env, plain):
        other.fix_commands(torch.zeros(32, 3))
    assert _held(env, 10).equal(_held(plain, 10))
    seen, true = env.get_observations()["policy"], env.get_observations()["privileged"]
    error = seen - true[:, :48]
    assert 0.3 < error[:, 21:33].abs().max() <= 0.4
    error[:, 21:33] = 0
    assert error.abs().max() == 0
    env.step(torch.zeros(32, 12))
    assert not env.get_observations()["policy"].equal(seen)


def test_the_critic_sees_how_the_robot_differs(robot: Robot) -> None:
    env = _env(robot, 8, mass=(0.9, 1.1), friction=(0.5, 1.5))
    privileged = env.get_observations()["privileged"]
    assert privileged.shape == (8, 76)
    assert privileged[:, 57:].equal(env.sim.draw.columns)
    assert (privileged[:, 57:59].std(dim=0) > 0.01).all()


def test_a_new_episode_is_a_new_robot_and_the_others_stay(robot: Robot) -> None:
    env = _env(robot, 4, mass=(0.8, 1.2))
    before = env.sim.draw.columns.clone()
    env._reset(Listed(torch.tensor([1, 3])))
    changed = (env.sim.draw.columns != before).any(dim=1)
    assert changed.tolist() == [False, True, False, True]


def test_a_snapshot_of_robots_that_differ_goes_on_bit_for_bit(robot: Robot) -> None:
    cfg = EnvCfg(randomise=RANDOMISE["full"], episode_s=0.4)
    actions = torch.randn(50, 6, 12, generator=torch.Generator().manual_seed(1))
    env = make_env(robot, cfg, 6, seed=0)
    for action in actions[:15]:
        env.step(action)
    snapshot = env.snapshot()
    first = [env.step(action)[0] for action in actions[15:]]
    other = make_env(robot, cfg, 6, seed=8)
    other.restore(snapshot)
    assert other.get_observations()["policy"].equal(snapshot["obs"])
    for step, action in zip(first, actions[15:], strict=True):
        obs = other.step(action)[0]
        assert obs["policy"].equal(step["policy"])
        assert obs["privileged"].equal(step["privileged"])


def test_training_on_robots_that_differ_gives_a_policy_for_any(
    robot: Robot, tmp_path: Path
) -> None:
    """`--randomize full` trains with a critic that sees more; the actor is as ever."""
    arguments = ["--reward", "task", "--envs", "8", "--steps", "192"]
    out = tmp_path / "run"
    assert main(["train", "--out", str(out), *arguments, "--randomize", "full"]) == 0
    policy = load_policy(out / "policy.pt")
    assert policy.info.env.randomise == RANDOMISE["full"]
    assert policy.info.ppo.privileged_critic
    assert policy(torch.zeros(3, 48)).shape == (3, 12)


def test_a_critic_that_saw_the_truth_does_not_train_on_without_it(
    robot: Robot, tmp_path: Path
) -> None:
    ppo = PpoCfg(num_envs=8, hidden_sizes=(8,), privileged_critic=True)
    env = replace(EnvCfg(), randomise=RANDOMISE["light"])
    first = train(tmp_path / "a", robot, TrainCfg(steps=192, env=env, ppo=ppo)).policy
    plain = TrainCfg(steps=192, env=EnvCfg(), ppo=replace(ppo, privileged_critic=False))
    with pytest.raises(PolicyError, match=r"was shown .* numbers.*--randomize"):
        train(tmp_path / "b", robot, plain, init=first)


def test_equal_seeds_give_equal_robots(robot: Robot, tmp_path: Path) -> None:
    ppo = PpoCfg(num_envs=8, hidden_sizes=(8,), privileged_critic=True)
    cfg = TrainCfg(
        steps=384, env=replace(EnvCfg(), randomise=RANDOMISE["light"]), ppo=ppo
    )
    one, two = (train(tmp_path / name, robot, cfg).policy for name in ("one", "two"))
    assert one.read_bytes() == two.read_bytes()
