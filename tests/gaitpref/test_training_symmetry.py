"""When policies learn in the mirror: where neither robot nor reward tells sides apart.

Shapes: T steps, N robots, F feature columns.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from gaitpref.training.symmetry import in_mirror
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.extensions.kl_penalty import KlPenaltyCfg
from policy.robots.robot import Robot, load_robot
from policy.rollouts.babble import Babble
from policy.rollouts.rollout import first_episodes
from policy.training.ppo import PpoCfg

ENV = EnvCfg(episode_s=2.0)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=ENV.physics_dt_s)


@pytest.fixture(scope="module")
def rows(robot: Robot) -> Tensor:
    """[T, N, F] of robots that tumble."""
    env = QuadrupedEnv(robot, ENV, 16, seed=0)
    babble = Babble(
        16,
        control_dt_s=ENV.control_dt_s,
        action_scale_rad=ENV.action_scale_rad,
        rng=torch.Generator().manual_seed(0),
    )
    return torch.stack([step.features for step in first_episodes(babble, env)])


@pytest.mark.parametrize(
    ("criterion", "mirrored"),
    [
        ("task", True),
        ("high_step", True),
        ("trot", True),
        ("pace", True),
        ("benchmarks.wishes:carried_right_foot", False),
        ("benchmarks.wishes:nose_up_when_slow", True),
    ],
)
def test_only_a_wish_about_one_side_is_not_learned_in_the_mirror(
    robot: Robot, rows: Tensor, criterion: str, mirrored: bool
) -> None:
    score = load_criterion(criterion, criterion_context(robot, ENV))
    ppo = in_mirror(PpoCfg(), robot, score_of_criterion(score), rows)
    assert ppo.mirror == mirrored


def test_what_cannot_be_mirrored_is_left_as_it_is(robot: Robot) -> None:
    home = robot.home_joint_pos.copy()
    home[1] += 0.1
    assert in_mirror(PpoCfg(), robot).mirror
    assert not in_mirror(PpoCfg(), replace(robot, home_joint_pos=home)).mirror
    for ppo in (
        PpoCfg(privileged_critic=True),
        PpoCfg(kl_penalty=KlPenaltyCfg(kind="fixed")),
    ):
        assert in_mirror(ppo, robot) == ppo
