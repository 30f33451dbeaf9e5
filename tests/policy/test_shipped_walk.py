"""The walk that ships: small, whole, and able to begin with."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from benchmarks.until_it_walks import look
from data.files.files import sha256_file
from gaitpref import loop_cfg
from gaitpref.loop.run_config import claim
from gaitpref.loop.run_inputs import inputs_of
from policy.robots.shipped import WALK
from policy.training.checkpoint import PolicyError, load_policy
from policy.training.setup import setting_of
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

MADE = "7eeb9dd809fb38e3da5e7743c5a4b51b90209f8a4987af1e0c4b1cce72b711f5"
"""What `python -m benchmarks.shipped_walk` printed."""


def test_it_is_the_file_that_was_made() -> None:
    assert sha256_file(WALK) == MADE
    assert WALK.stat().st_size < 300_000


def test_it_walks_for_every_command_and_from_rest() -> None:
    """From other start states than it was chosen by."""
    found = look(WALK, episodes=32, seed=7)
    assert found.walking.walks
    assert found.evaluation.tracking_error_m_s < 0.06


def test_a_training_goes_on_from_it(tmp_path: Path) -> None:
    """Though it carries no optimizer's state."""
    setting = setting_of(WALK, None)
    cfg = TrainCfg(steps=3072, env=setting.env, ppo=load_policy(WALK).info.ppo)
    train(tmp_path, setting.robot, cfg, init=WALK)
    trained = load_policy(tmp_path / "policy.pt")
    assert trained.info.steps == load_policy(WALK).info.steps + 3072


@pytest.mark.parametrize(
    ("given", "base"),
    [(None, "walk"), ("task", "task"), ("none", "none")],
)
def test_a_loop_begins_with_it_unless_told_otherwise(
    tmp_path: Path, given: str | None, base: str
) -> None:
    """What it is, by its content, is kept beside the configuration."""
    cfg = loop_cfg(base=given)
    inputs = inputs_of(cfg).contents
    claim(tmp_path / "run", cfg, inputs)
    assert yaml.safe_load((tmp_path / "run/config.yaml").read_text())["base"] == base
    assert inputs["base"] == (MADE if base == "walk" else None)


def test_a_robot_of_ones_own_learns_to_walk_first(tmp_path: Path) -> None:
    mjcf = tmp_path / "mine.xml"
    mjcf.write_text(load_policy(WALK).info.robot_mjcf)
    assert loop_cfg(robot=mjcf).base == "task"
    with pytest.raises(PolicyError, match="no policy file walks"):
        loop_cfg(base="walks")
