"""A fallen robot as a task: how episodes begin, what ends them, what is paid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from data.datasets.dataset import Dataset
from data.features import FEATURE_DIM, column
from data.files.plain import from_plain, to_plain
from gaitpref.cli.main import main
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg, getup_env
from policy.env.task_reward import (
    GETUP_TASK,
    TaskRewardCfg,
    getup_terms,
    task_reward_for,
)
from policy.env.terrain import TerrainCfg
from policy.env.world import in_world
from policy.robots.robot import Robot, load_robot
from policy.training.checkpoint import load_policy

CFG = getup_env(EnvCfg())


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=EnvCfg().physics_dt_s)


@pytest.fixture(scope="module")
def env(robot: Robot) -> QuadrupedEnv:
    return QuadrupedEnv(robot, CFG, 32, seed=0)


def _cosines(env: QuadrupedEnv) -> torch.Tensor:
    """Cosine [N] of every robot's tilt."""
    return -env.get_observations()["policy"][:, 8]


def _lie(env: QuadrupedEnv) -> torch.Tensor:
    """Which robots [N] are far from standing."""
    low = env.sim.read().base_height < 0.5 * float(env.robot.home_qpos[2]) + 1e-3
    return (_cosines(env) < 0.5) | low


def test_episodes_begin_fallen_at_rest_and_unlike(env: QuadrupedEnv) -> None:
    """Tilted by more than 60 degrees or low, on the ground and not in it."""
    env.reset(seed=3)
    state = env.sim.read()
    assert _lie(env).all()
    assert _cosines(env).min() < -0.9
    assert state.base_height.max() < 0.25
    assert state.base_height.min() > 0.03
    assert state.joint_vel.abs().max() == 0
    assert state.joint_pos.std(dim=0).min() > 0.1
    assert env.get_observations()["policy"][:, 7].std() > 0.1
    before = state.base_pos_w
    env.step(torch.zeros(32, 12))
    assert (env.sim.read().base_pos_w - before).norm(dim=-1).max() < 0.1


def test_no_fall_ends_an_episode_but_the_time_does(env: QuadrupedEnv) -> None:
    """Robots that lie all the time are cut off at its end, and start lying again."""
    env.reset(seed=1)
    env.episode_length_buf[:] = CFG.episode_steps - 5
    extras: dict[str, Any] = {}
    for step in range(5):
        _, _, dones, extras = env.step(torch.zeros(32, 12))
        assert not extras["fallen"].any()
        assert extras["features"][:, column("fallen")].eq(0).all()
        assert dones.all() == (step == 4)
    assert extras["time_outs"].all()
    assert _lie(env).all()


def test_legs_of_a_robot_that_lies_are_on_the_ground(robot: Robot) -> None:
    """Thighs and shanks of the robot that ships collide; a walking one is as ever."""
    assert in_world(robot, EnvCfg()) is robot
    solid = in_world(robot, CFG)
    assert solid.mj_model.ngeom == robot.mj_model.ngeom + 8
    assert solid.mj_model.body_mass == pytest.approx(robot.mj_model.body_mass)
    assert in_world(solid, CFG).mjcf == solid.mjcf
    assert solid.foot_radius == pytest.approx(robot.foot_radius)
    for leg in ("FR", "FL", "RR", "RL"):
        for link in ("thigh", "calf"):
            body = solid.mj_model.body(f"{leg}_{link}").id
            shapes = solid.mj_model.geom_bodyid == body
            hits = solid.mj_model.geom_conaffinity[shapes] > 0
            assert hits.sum() == (1 if link == "thigh" else 2)


def test_getting_up_pays_more_at_every_stage() -> None:
    """On the back, on the side, upright but low, risen, standing still at home."""
    rows = torch.zeros(5, FEATURE_DIM)
    rows[:, column("gravity_b")] = torch.tensor(
        [[0, 0, 1.0], [0, 1.0, 0], [0, 0, -1.0], [0, 0, -1.0], [0, 0, -1.0]]
    )
    rows[:, column("base_height")] = torch.tensor([[0.06, 0.08, 0.08, 0.28, 0.28]]).T
    rows[:4, column("joint_pos_offset")] = 0.6
    terms = getup_terms(rows, height_m=0.28)
    assert terms["upright"].tolist() == pytest.approx([0, 0.5, 1, 1, 1])
    assert terms["rise"].tolist() == pytest.approx([0, 0.25 * 2 / 7, 2 / 7, 1, 1])
    assert terms["stand"][4] == 1
    assert terms["stand"][3] == pytest.approx(torch.exp(torch.tensor(-2.16)).item())
    total = torch.stack(tuple(terms.values())).sum(dim=0)
    assert (total.diff() > 0).all()


def test_what_is_paid_is_configured_and_only_there(robot: Robot) -> None:
    """The walking reward has no such terms, in its log or in its files."""
    assert "rise" not in TaskRewardCfg().weights
    assert "rise" not in to_plain(TaskRewardCfg())
    assert from_plain(EnvCfg, to_plain(CFG)) == CFG
    paid = task_reward_for(robot, GETUP_TASK).weights
    assert {name for name, weight in paid.items() if weight > 0} == {
        "upright",
        "rise",
        "stand",
    }


def test_robots_lie_on_slopes_too(robot: Robot) -> None:
    cfg = getup_env(EnvCfg(terrain=TerrainCfg(kind="slopes")))
    env = QuadrupedEnv(robot, cfg, 32, seed=0)
    state = env.sim.read()
    assert _lie(env).all()
    assert (state.base_pos_w[:, :2].std(dim=0) > 1.0).all()
    assert state.base_height.max() < 0.3
    assert state.base_height.min() > 0.0


def test_train_and_record_getting_up(tmp_path: Path) -> None:
    """`--getup` is in the policy, and in what is recorded of it."""
    out, root = tmp_path / "run", tmp_path / "set"
    arguments = ["--reward", "task", "--envs", "8", "--steps", "192", "--getup"]
    assert main(["train", "--out", str(out), *arguments]) == 0
    policy = load_policy(out / "policy.pt")
    assert policy.info.env.getup is not None
    assert policy.info.env.task == GETUP_TASK
    arguments = ["--policy", str(out / "policy.pt"), "--dataset", str(root)]
    assert main(["record", *arguments, "--episodes", "2"]) == 0
    for entry in Dataset.open(root).entries():
        assert entry.meta.task == "getup"
        assert entry.end_reason == "truncated"
        assert entry.meta.command == (0.0, 0.0, 0.0)
        episode = Dataset.open(root).read(entry.sha256)
        first = episode.features[0]
        lies = first[column("gravity_b")][2] > -0.6
        assert lies or first[column("base_height")][0] < 0.16
