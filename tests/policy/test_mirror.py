"""Learning in the mirror: that it is one, and what comes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.features import FEATURE_DIM, FEATURES, Feature, column
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.env.feature_row import OBSERVATION, in_order, obs_column
from policy.robots.robot import Robot, RobotError, load_robot
from policy.sim.chosen import Listed
from policy.training.checkpoint import load_policy
from policy.training.mirror import Mirror, has_mirror, mirror_of, mirrored
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

ENV = EnvCfg()


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=ENV.physics_dt_s)


@pytest.fixture(scope="module")
def mirror(robot: Robot) -> Mirror:
    return mirror_of(robot)


def test_what_is_mirrored_twice_is_what_it_was(mirror: Mirror) -> None:
    obs, action = torch.randn(5, 48), torch.randn(5, 12)
    assert torch.equal(mirror.obs(mirror.obs(obs)), obs)
    assert torch.equal(mirror.action(mirror.action(action)), action)
    rows = torch.randn(5, FEATURE_DIM)
    assert torch.equal(mirror.rows(mirror.rows(rows)), rows)
    assert not torch.equal(mirror.obs(obs), obs)


def _mirrored_pair(robot: Robot, mirror: Mirror) -> QuadrupedEnv:
    """Two robots, the second one the image of the first."""
    env = QuadrupedEnv(robot, ENV, 2, seed=3)
    qpos, qvel = (state[:1].float() for state in env.sim.raw_state())
    joints = mirror.action(qpos[:, 7:]), mirror.action(qvel[:, 6:])
    qpos = torch.cat(
        [qpos[:, :7] * qpos.new_tensor([1, -1, 1, 1, -1, 1, -1]), joints[0]], 1
    )
    qvel = torch.cat(
        [qvel[:, :6] * qvel.new_tensor([1, -1, 1, -1, 1, -1]), joints[1]], 1
    )
    env.sim.reset(Listed(torch.tensor([1])), qpos, qvel)
    env.fix_commands(torch.tensor([[0.5, 0.1, 0.2], [0.5, -0.1, -0.2]]))
    return env


def test_physics_in_the_mirror_are_those_of_the_mirrored_robot(
    robot: Robot, mirror: Mirror
) -> None:
    action = torch.randn(1, 12, generator=torch.Generator().manual_seed(0))

    def differences(second: torch.Tensor) -> tuple[float, float]:
        env = _mirrored_pair(robot, mirror)
        rows = torch.zeros(2, FEATURE_DIM)
        for _ in range(3):
            *_, extras = env.step(torch.cat([action, second]))
            rows = extras["features"]
        obs = env.get_observations()["policy"]
        return (
            float((mirror.obs(obs[0]) - obs[1]).abs().max()),
            float((mirror.rows(rows[0]) - rows[1]).abs().max()),
        )

    assert max(differences(mirror.action(action))) < 0.2
    assert min(differences(action)) > 5.0


def test_a_mirrored_row_exchanges_feet_and_keeps_what_has_no_side(
    mirror: Mirror,
) -> None:
    row = torch.arange(float(FEATURE_DIM))
    image = mirror.rows(row)
    feet = row[column("foot_air_time")]
    assert torch.equal(image[column("foot_air_time")], feet[[1, 0, 3, 2]])
    for name in ("base_height", "fallen"):
        assert torch.equal(image[column(name)], row[column(name)])


def test_a_column_without_a_rule_is_not_mirrored_by_its_width() -> None:
    """Four new numbers need not be of feet, nor twelve of joints."""
    signs = np.ones(12)
    for new in (Feature("battery_cell_v", 4, "V", ""), Feature("fan", 12, "1/s", "")):
        with pytest.raises(ValueError, match=f"what the mirror makes of '{new.name}'"):
            mirrored((*FEATURES, new), signs)
    wide = Feature("foot_speed", 5, "m/s", "")
    with pytest.raises(ValueError, match="makes 4 columns of 'foot_speed', which has"):
        mirrored((wide,), signs)


def test_columns_that_are_not_those_of_the_table_are_refused() -> None:
    """By name or by width, in whatever order they were made."""
    parts = {part.name: torch.ones(2, part.width) for part in OBSERVATION}
    backwards = dict(reversed(parts.items()))
    assert in_order(backwards, OBSERVATION).shape == (2, 48)
    command = torch.full((2, 3), 7.0)
    row = in_order(backwards | {"command": command}, OBSERVATION)
    assert torch.equal(row[:, obs_column("command")], command)
    for wrong in (
        {"wind": torch.ones(2, 3)},
        {"command": torch.ones(2, 2)},
    ):
        with pytest.raises(ValueError, match="the table says base_lin_vel_b 3"):
            in_order(parts | wrong, OBSERVATION)
    with pytest.raises(ValueError, match="has no part 'wind'; there are: base_lin"):
        obs_column("wind")


def test_a_robot_whose_sides_differ_is_refused(robot: Robot) -> None:
    home = robot.home_joint_pos.copy()
    home[1] += 0.1
    lopsided = replace(robot, home_joint_pos=home)
    with pytest.raises(RobotError, match=r"0\.100 rad\): train without the mirror"):
        mirror_of(lopsided)
    assert has_mirror(robot)
    assert not has_mirror(lopsided)


def test_a_policy_that_learns_in_the_mirror_is_the_same_on_both_sides(
    robot: Robot, mirror: Mirror, tmp_path: Path
) -> None:
    obs = torch.randn(256, 48, generator=torch.Generator().manual_seed(1))

    def asymmetry(learns_in_it: bool) -> float:
        ppo = PpoCfg(num_envs=16, mirror=learns_in_it)
        cfg = TrainCfg(steps=20 * ppo.steps_per_iteration, env=ENV, ppo=ppo, seed=0)
        policy = load_policy(train(tmp_path / str(learns_in_it), robot, cfg).policy)
        seen, image = policy(obs), policy(mirror.obs(obs))
        return float((mirror.action(seen) - image).norm() / seen.norm())

    assert asymmetry(True) < 0.7 * asymmetry(False)
