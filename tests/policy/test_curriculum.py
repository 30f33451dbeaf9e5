"""Commands grow as they are followed, and not otherwise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from data.features import FEATURE_DIM, column
from gaitpref.cli.main import main
from policy.env.curriculum import Curriculum, CurriculumCfg
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import CommandCfg, EnvCfg
from policy.robots.robot import Robot, load_robot
from policy.training.checkpoint import load_policy, read_plain
from policy.training.ppo import IterationStats, PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

CFG = CurriculumCfg(start=0.4, end=1.0, widen=0.2, good=0.8, window_s=0.1)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=EnvCfg().physics_dt_s)


def _rows(error_m_s: float) -> torch.Tensor:
    """Rows [4, F] of robots that miss their commands by so much."""
    rows = torch.zeros(4, FEATURE_DIM)
    rows[:, column("command")] = torch.tensor([0.6, 0.1, 0.2])
    rows[:, column("base_lin_vel_b")] = torch.tensor([0.6 - error_m_s, 0.1, 0.0])
    return rows


def _observed(curriculum: Curriculum, error_m_s: float, steps: int) -> float:
    for _ in range(steps):
        curriculum.observe(_rows(error_m_s))
    return float(curriculum.share)


def test_it_widens_by_one_step_for_every_window_of_good_tracking() -> None:
    """Not before the window is over, not for poor tracking, and not beyond the end."""
    curriculum = Curriculum(CFG, control_dt_s=0.02, device=torch.device("cpu"))
    assert _observed(curriculum, 0.1, 4) == 0.4
    assert _observed(curriculum, 0.1, 1) == pytest.approx(0.6)
    # exp(-0.3^2 / 0.25) is 0.70.
    assert _observed(curriculum, 0.3, 20) == pytest.approx(0.6)
    assert _observed(curriculum, 0.0, 50) == 1.0


def test_ranges_grow_from_the_slowest_command() -> None:
    curriculum = Curriculum(CFG, control_dt_s=0.02, device=torch.device("cpu"))
    assert curriculum.range((0.2, 1.2)) == pytest.approx((0.2, 0.6))
    assert curriculum.range((-0.5, 0.5)) == pytest.approx((-0.2, 0.2))
    assert curriculum.range((-2.0, -1.0)) == pytest.approx((-1.4, -1.0))


def test_the_environment_asks_for_what_the_curriculum_has_come_to(robot: Robot) -> None:
    """Commands stay in the narrow ranges while robots stand, and widen with them.

    Standing robots follow commands of about nothing.
    """
    slow = CommandCfg(
        forward_m_s=(0.0, 0.5), left_m_s=(0.0, 0.0), yaw_rad_s=(0, 0), resample_s=0.2
    )
    cfg = EnvCfg(commands=slow, curriculum=replace(CFG, start=0.2, widen=0.4))
    env = QuadrupedEnv(robot, cfg, 64, seed=0)
    assert env.command[:, 0].max() <= 0.1
    shares = []
    for _ in range(31):
        shares.append(float(env.step(torch.zeros(64, 12))[3]["log"]["command/share"]))
    assert shares[0] == pytest.approx(0.2)
    assert shares[-1] == pytest.approx(1.0)
    assert 0.3 < env.command[:, 0].max() <= 0.5
    snapshot = env.snapshot()
    other = QuadrupedEnv(robot, cfg, 64, seed=1)
    other.restore(snapshot)
    for resumed in (env, other):
        log = resumed.step(torch.zeros(64, 12))[3]["log"]
        assert log["command/share"] == pytest.approx(1.0)


def test_a_resumed_training_goes_on_where_the_curriculum_was(tmp_path: Path) -> None:
    """`--curriculum --resume` keeps what was observed, to the last bit."""
    both = []
    arguments = ["--reward", "task", "--envs", "8", "--curriculum"]
    for name, parts in (("once", ["768"]), ("twice", ["384", "768"])):
        out = tmp_path / name
        for part in parts:
            end = ["--steps", part, "--resume"]
            assert main(["train", "--out", str(out), *arguments, *end]) == 0
        both.append(read_plain(out / "resume.pt")["env"]["curriculum"])
    share, total, steps = both[1].tolist()
    assert both[0].equal(both[1])
    assert (share, steps) == (CurriculumCfg().start, 96)
    assert 0 < total < 96
    assert load_policy(tmp_path / "twice/policy.pt").info.env.curriculum is not None


def test_training_tells_how_far_the_commands_have_come(
    robot: Robot, tmp_path: Path
) -> None:
    """Beside the terms of the reward, for TensorBoard."""
    told: list[dict[str, float]] = []

    def note(stats: IterationStats) -> None:
        told.append(dict(stats.scalars))

    ppo = PpoCfg(num_envs=8)
    env = EnvCfg(curriculum=CurriculumCfg())
    cfg = TrainCfg(steps=ppo.steps_per_iteration, env=env, ppo=ppo)
    train(tmp_path / "policy", robot, cfg, on_iteration=note)
    assert [row["command/share"] for row in told] == [pytest.approx(0.4)]


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [("start", 2.0, "start <= end"), ("good", 1.5, "good must lie in")],
)
def test_impossible_curricula_are_refused(field: str, value: float, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        replace(CurriculumCfg(), **{field: value})
