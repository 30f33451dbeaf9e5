"""A walk counts by its worst command, and from rest."""

from __future__ import annotations

import pytest
import torch

from data.features import FEATURE_DIM, column
from policy.env.env_cfg import EnvCfg
from policy.robots.shipped import WALK
from policy.rollouts.evaluate import rollout_features, summarise
from policy.rollouts.rollout import hold_home
from policy.rollouts.walking import command_walks, table, walking
from policy.training.checkpoint import load_policy


def rows(speeds: list[tuple[float, float]], steps: int = 500) -> torch.Tensor:
    """[T, N, F] of robots that were asked for the first speed and go the second."""
    features = torch.zeros(steps, len(speeds), FEATURE_DIM)
    for robot, (asked, gone) in enumerate(speeds):
        features[:, robot, column("command").start] = asked
        features[:, robot, column("base_lin_vel_b").start] = gone
    return features


def test_a_mean_hides_robots_that_stand_and_a_command_does_not() -> None:
    """Two of sixteen stand at 0.3 m/s; the mean is that of a good walk."""
    speeds = [(0.3, 0.0)] * 2 + [(0.3, 0.3)] * 2 + [(0.8, 0.8)] * 12
    features, lengths = rows(speeds), torch.full((16,), 500)
    whole = summarise(
        features, lengths, lambda features, starts: starts.float(), control_dt_s=0.02
    )
    assert whole.tracking_error_m_s == pytest.approx(0.3 * 2 / 16)
    slow, fast = command_walks(features, lengths, control_dt_s=0.02)
    assert (slow.never_set_off, slow.episodes, slow.walks) == (2, 4, False)
    assert slow.tracking_error_m_s == pytest.approx(0.15)
    assert (fast.never_set_off, fast.episodes, fast.walks) == (0, 12, True)


def test_a_start_is_no_walk_and_a_fall_is_no_stand() -> None:
    """The first two seconds do not count; who falls in them never set off nor stood."""
    features = rows([(0.5, 0.5), (0.5, 0.5)])
    features[:100, 0, column("base_lin_vel_b").start] = 0.0
    features[80, 1, column("fallen")] = 1.0
    lengths = torch.tensor([500, 81])
    features[81:, 1] = 0.0
    (found,) = command_walks(features, lengths, control_dt_s=0.02)
    assert (found.never_set_off, found.falls) == (0, 1)
    assert found.speed_m_s == pytest.approx(0.5)
    assert not found.walks


def test_diverged_episodes_and_commands_to_stand_are_left_out() -> None:
    features = rows([(0.0, 0.0), (0.5, 0.5), (0.5, 0.0)])
    (found,) = command_walks(features, torch.tensor([500, 500, 0]), control_dt_s=0.02)
    assert (found.episodes, found.never_set_off) == (1, 0)


def test_the_walk_that_ships_sets_off_and_a_statue_does_not() -> None:
    """In the simulator, with the noise of training and exactly from home."""
    policy = load_policy(WALK)
    robot, cfg = policy.robot(), EnvCfg(episode_s=4.0)
    for actor, stands in ((policy, 0), (hold_home, 1)):
        seen = rollout_features(actor, robot, cfg, episodes=8, seed=0)
        found = walking(actor, robot, cfg, *seen, seed=0)
        asked = [command.asked_m_s for command in found.commands]
        assert asked == pytest.approx([0.3 + 0.1 * i for i in range(8)])
        for command in (*found.commands, *found.from_rest):
            assert command.never_set_off == stands, command
        assert ("STANDS" in table(found)) == bool(stands)
    assert not found.walks
