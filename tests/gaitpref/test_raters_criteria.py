"""Criteria, the simulated rater, and the total reward."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from data.features import FEATURE_DIM, column
from gaitpref.raters.criteria import (
    BUILT_IN,
    CriterionContext,
    CriterionError,
    load_criterion,
)
from gaitpref.raters.criterion_scores import score_of_criterion
from gaitpref.raters.error_model import better
from gaitpref.training.total_reward import total_reward
from policy.env.env_cfg import EnvCfg
from policy.env.known_terms import KnownTermsCfg
from policy.env.task_reward import TaskRewardCfg
from policy.robots.robot import load_robot

CONTEXT = CriterionContext(task=TaskRewardCfg(height_m=0.28), control_dt_s=0.02)


def _row(**values: float | list[float]) -> Tensor:
    """A standing row with some features replaced."""
    row = torch.zeros(FEATURE_DIM)
    row[column("gravity_b")] = torch.tensor([0.0, 0.0, -1.0])
    row[column("base_height")] = 0.28
    row[column("foot_contact")] = 1.0
    for name, value in values.items():
        row[column(name)] = torch.tensor(value)
    return row


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_criteria_keep_the_leading_shape(name: str) -> None:
    """One finite score per row, for a clip and for a batch alike."""
    score = score_of_criterion(load_criterion(name, CONTEXT))
    rows = torch.randn(7, 5, FEATURE_DIM, generator=torch.Generator().manual_seed(0))
    starts = torch.ones(7, 5, dtype=torch.bool)
    assert score(rows, starts).shape == (7, 5)
    assert score(rows, starts).isfinite().all()
    alone = score(rows[3:4, 2:3], starts[:1, :1])
    assert score(rows, starts)[3, 2].allclose(alone)


@pytest.mark.parametrize(
    ("name", "better", "worse"),
    [
        ("task", {"command": [0.5, 0.0, 0.0], "base_lin_vel_b": [0.5, 0.0, 0.0]},
         {"command": [0.5, 0.0, 0.0]}),
        ("smooth", {}, {"action_rate": 0.3}),
        ("high_step", {"foot_contact": [1.0, 0.0, 0.0, 1.0],
                       "foot_height": [0.0, 0.1, 0.1, 0.0]}, {}),
        ("crouch", {"base_height": 0.21}, {}),
        ("low_energy", {}, {"joint_torque": 5.0, "joint_vel": 2.0}),
        ("pace", {"foot_contact": [1.0, 0.0, 1.0, 0.0]},
         {"foot_contact": [1.0, 0.0, 0.0, 1.0]}),
        ("get_up", {"base_height": 0.2},
         {"base_height": 0.2, "gravity_b": [0.0, 1.0, 0.0]}),
        ("get_up", {}, {"base_height": 0.1}),
        ("get_up", {}, {"joint_vel": 3.0}),
    ],
)  # fmt: skip
def test_built_in_criteria_prefer_what_they_are_named_for(
    name: str, better: dict, worse: dict
) -> None:
    """The better of two rows gets the higher score."""
    score = score_of_criterion(load_criterion(name, CONTEXT))
    rows = torch.stack([_row(**better), _row(**worse)])[None]
    high, low = score(rows, torch.ones(1, 2, dtype=torch.bool))[0]
    assert high > low


def trotting(frequency_hz: float, steps: int = 200) -> Tensor:
    """Rows [T, F] of diagonal legs that change places `frequency_hz` times a second."""
    phase = (torch.arange(steps) * 0.02 * frequency_hz) % 1.0
    rows = _row().repeat(steps, 1)
    right = (phase < 0.5).float()
    rows[:, column("foot_contact")] = torch.stack(
        [right, 1 - right, 1 - right, right], dim=1
    )
    return rows


def _score(name: str, rows: Tensor, starts: tuple[int, ...] = (0,)) -> Tensor:
    """Scores [T] of rows [T, F] of episodes that begin at `starts`."""
    begins = torch.zeros(len(rows), 1, dtype=torch.bool)
    begins[list(starts)] = True
    return score_of_criterion(load_criterion(name, CONTEXT))(rows[:, None], begins)[
        :, 0
    ]


def test_a_trot_is_told_by_its_frequency() -> None:
    """Each is best at its own name; out of step it keeps the half for two beats."""
    rows = {hz: trotting(hz) for hz in (1.5, 2.5, 4.0)}
    for hz, own in rows.items():
        scores = {
            other: float(_score(f"trot@{other}", own)[60:].mean()) for other in rows
        }
        assert max(scores, key=scores.__getitem__) == hz
        assert scores[hz] > 0.9
        assert min(scores.values()) == pytest.approx(0.5, abs=0.05)
    assert torch.equal(_score("trot", rows[2.5]), _score("trot@2.5", rows[2.5]))
    assert float(_score("trot", _row().repeat(100, 1)).max()) == 0.0


def test_a_trot_does_not_look_across_a_reset() -> None:
    """An episode scores the same alone and behind another one."""
    first, second = trotting(4.0), trotting(2.5)
    both = _score("trot", torch.cat([first, second]), starts=(0, 200))
    assert torch.equal(both[200:], _score("trot", second))


@pytest.mark.parametrize("name", ["trot@", "trot@fast", "trot@-2", "trot@inf"])
def test_a_trot_needs_a_frequency(name: str) -> None:
    with pytest.raises(CriterionError, match="number of Hz"):
        load_criterion(name, CONTEXT)


def test_a_criterion_of_ones_own_may_look_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two arguments are rows and starts of episodes; the result is checked alike."""
    (tmp_path / "looking_back.py").write_text(
        "def wish(features, starts):\n    return starts.float()\n"
        "def wrong(features, starts):\n    return features\n"
    )
    monkeypatch.chdir(tmp_path)
    assert _score("looking_back:wish", _row().repeat(3, 1)).tolist() == [1, 0, 0]
    with pytest.raises(CriterionError, match="one score per row"):
        load_criterion("looking_back:wrong", CONTEXT)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("raise RuntimeError('boom')", "raised RuntimeError: boom"),
        ("return features[..., 0] * float('nan')", "gave NaN or infinity for 6 of 6"),
        ("return features", r"one score per row"),
        ("return 3.0", "got float: one score per row"),
    ],
)
def test_a_criterion_that_misbehaves_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, message: str
) -> None:
    """One line that says what it did and what it should do."""
    name = f"wishes_{abs(hash(body))}"
    (tmp_path / f"{name}.py").write_text(f"def wish(features):\n    {body}\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CriterionError, match=message) as caught:
        load_criterion(f"{name}:wish", CONTEXT)
    assert f"{name}:wish" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["no_such", "no.such.module:f", "math:no_such", ":"])
def test_an_unknown_criterion_is_named(name: str) -> None:
    """So is one that cannot be found."""
    with pytest.raises(CriterionError, match="criterion"):
        load_criterion(name, CONTEXT)


def test_the_rater_calls_equal_scores_equal() -> None:
    """The better clip wins; equal scores tie, up to rounding."""
    assert better(1.0, 0.5) == "a"
    assert better(-1.0, -0.5) == "b"
    assert better(0.3, 0.3 + 1e-9) == "equal"


def test_the_total_is_the_learned_part_and_the_known_terms() -> None:
    """By hand: weight 2, score 3 a second, 20 ms; alive 1 a second; a fall costs 1."""
    robot = load_robot(physics_dt_s=0.005)

    def three(features: Tensor, starts: Tensor) -> Tensor:
        return torch.full(starts.shape, 3.0)

    reward = total_reward(
        three, robot, EnvCfg(), known=KnownTermsCfg(torque=-1e-3), weight=2.0
    )
    walking, falling = _row(joint_torque=5.0), _row(fallen=1.0)
    features = torch.stack([walking, falling])[:, None]
    starts = torch.zeros(2, 1, dtype=torch.bool)
    total = reward(features, starts)[:, 0]
    assert float(total[0]) == pytest.approx(0.02 * (2 * 3 + 1 - 1e-3 * 12 * 25))
    assert float(total[1]) == pytest.approx(-1.0)
    parts = reward.parts(features, starts, len(features))
    assert set(parts) == {"score", "alive", "fall", "torque", "joint_limits"}
    # What is told of the rollout: parts per second, and shares of all their sizes.
    rewards = [v for name, v in reward.figures.items() if name.startswith("reward/")]
    shares = {n: v for n, v in reward.figures.items() if n.startswith("share/")}
    assert sum(rewards) == pytest.approx(float(total.mean()) / 0.02, rel=1e-5)
    assert reward.figures["reward/score"] == pytest.approx(2 * 3 / 2)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["share/fall"] == pytest.approx(1.0 / (0.12 + 0.02 + 0.006 + 1.0))


def test_joints_near_their_limits_cost() -> None:
    """Beyond 95 % of the range the distance counts; inside it nothing does."""
    robot = load_robot(physics_dt_s=0.005)

    def zero(features: Tensor, starts: Tensor) -> Tensor:
        return torch.zeros(starts.shape)

    reward = total_reward(
        zero, robot, EnvCfg(), known=KnownTermsCfg(alive=0, torque=0, joint_limits=-1)
    )
    row = _row()
    low, high = robot.joint_range[0] - robot.home_joint_pos[0]
    row[column("joint_pos_offset")][0] = high
    starts = torch.zeros(1, 1, dtype=torch.bool)
    expected = -0.02 * 0.025 * (high - low)
    assert float(reward(row[None, None], starts)) == pytest.approx(expected, rel=1e-4)
    assert float(reward(_row()[None, None], starts)) == 0.0
