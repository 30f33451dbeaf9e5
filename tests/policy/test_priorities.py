"""Steps the critics err about are learned from more often, and each time count less."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from data.features import FEATURE_DIM, column
from policy.env.env_cfg import EnvCfg
from policy.offpolicy.drawing import Priorities
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.offpolicy.ring import Batch, Chunk, Ring
from policy.offpolicy.sac import Sac
from policy.offpolicy.sac_cfg import PriorityCfg, SacCfg
from policy.robots.robot import load_robot
from policy.training.checkpoint import read_plain
from policy.training.ppo import IterationStats, PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

ENV = EnvCfg(episode_s=0.4)
PPO = PpoCfg(num_envs=4, steps_per_env=24, hidden_sizes=(16,))
SAC = SacCfg(
    critic_sizes=(16,),
    memory=400,
    learn_from=90,
    batch=32,
    priorities=PriorityCfg(),
)


def _ring(rows: int = 4, cfg: PriorityCfg | None = None) -> Ring:
    """Eight steps in two columns, all of the same worth, in a ring of `rows`."""
    ring = Ring(rows, 2, 1, device="cpu", priorities=cfg or PriorityCfg())
    ring.add(_chunk(4))
    ring.score(_zero, 0)
    return ring


def _chunk(rows: int) -> Chunk:
    marks = torch.zeros(rows, 2, dtype=torch.bool)
    return Chunk(
        obs=torch.arange(rows * 2.0).view(rows, 2, 1),
        features=torch.zeros(rows, 2, FEATURE_DIM),
        starts=marks,
        fallen=marks,
        cut=marks,
    )


def _zero(features: torch.Tensor, starts: torch.Tensor) -> torch.Tensor:
    return torch.zeros(starts.shape)


def _shares(ring: Ring, count: int = 20_000) -> torch.Tensor:
    """How often each place is drawn."""
    torch.manual_seed(0)
    drawn = ring.sample(count, n_step=1, gamma=0.5).place
    return drawn.bincount(minlength=ring.rows * ring.columns) / count


def test_steps_are_drawn_in_proportion_to_what_the_critics_missed() -> None:
    """Of six usable steps one was missed by nothing, one by three times the others; the
    last two have no outcome yet, whatever was missed."""
    ring = _ring(cfg=PriorityCfg(alpha=1.0, least=1.0))
    batch = ring.sample(8, n_step=1, gamma=0.5)
    told = replace(batch, place=torch.arange(8))
    ring.learned(told, torch.tensor([1.0, 1.0, 5.0, 1.0, 0.0, 1.0, 99.0, 99.0]))
    expected = torch.tensor([2.0, 2.0, 6.0, 2.0, 1.0, 2.0, 0.0, 0.0]) / 15.0
    assert torch.allclose(_shares(ring), expected, atol=0.01)


def test_what_counts_less_makes_up_for_being_drawn_more() -> None:
    """With beta 1, weighted means of a batch are those of all steps."""
    cfg = PriorityCfg(alpha=1.0, beta=1.0)
    priorities = Priorities(cfg, (50, 2), "cpu")
    priorities.raise_rows(torch.arange(50))
    torch.manual_seed(1)
    value = torch.rand(100)
    priorities.learned(torch.arange(100), 0.1 + 5.0 * value**3)
    usable = torch.ones(50, 2, dtype=torch.bool)
    places, weight = priorities.draw(50_000, usable)
    assert value[places].mean() > value.mean() + 0.2
    assert float(weight.max()) == 1.0
    found = (weight * value[places]).sum() / weight.sum()
    assert float(found) == pytest.approx(float(value.mean()), abs=0.02)


def test_what_is_new_and_what_is_worth_something_else_is_drawn_most() -> None:
    """New steps take the place of the oldest; a new reward makes all steps new."""
    ring = _ring(cfg=PriorityCfg(alpha=1.0))
    told = replace(ring.sample(8, n_step=1, gamma=0.5), place=torch.arange(8))
    ring.learned(told, torch.tensor([0.1, 0.1, 0.1, 3.0, 0.1, 0.1, 0.1, 0.1]))
    ring.add(_chunk(2))
    shares = _shares(ring)
    # Rows 0 and 1 are new; the newest has no outcome, and the dearest was written over.
    assert shares[:2].sum() > 0.9
    ring.raise_priorities()
    usable = ring.usable().flatten()
    assert torch.allclose(_shares(ring)[usable], torch.tensor(1 / 6), atol=0.02)


def test_a_step_that_counts_nothing_teaches_the_critics_nothing() -> None:
    """Whatever it gained."""
    obs = torch.randn(4, 3, generator=torch.Generator().manual_seed(0))
    learned = []
    for gain in (0.0, 100.0):
        torch.manual_seed(2)
        sac = Sac(SAC, 3, torch.ones(12), (16,))
        batch = Batch(
            obs=obs,
            action=torch.zeros(4, 12),
            gain=torch.tensor([1.0, 1.0, 1.0, gain]),
            later_obs=obs,
            discount=torch.full((4,), 0.9),
            place=torch.arange(4),
            weight=torch.tensor([1.0, 0.5, 1.0, 0.0]),
        )
        _, errors = sac.update(batch)
        learned.append(sac.critic.state_dict())
    assert errors[3] > 500.0 > errors[:3].max()
    for name, value in learned[0].items():
        assert torch.equal(value, learned[1][name]), name


def test_it_goes_on_bit_for_bit_and_begins_anew_under_another_reward(
    tmp_path: Path,
) -> None:
    """Priorities are part of what it goes on from; who takes over its memory draws all
    of it alike."""
    robot = load_robot(physics_dt_s=ENV.physics_dt_s)

    def trained(out: Path, iterations: int, **more: object) -> dict:
        cfg = TrainCfg(steps=iterations * 96, env=ENV, ppo=PPO)
        engine = OffPolicy(cfg=more.pop("sac", SAC), replay=more.pop("replay", ()))  # type: ignore[arg-type]
        train(out, robot, cfg, engine=engine, **more)  # type: ignore[arg-type]
        return read_plain(out / "resume.pt")

    whole = trained(tmp_path / "whole", 4)

    def interrupt(stats: IterationStats) -> None:
        if stats.iteration == 2:
            os.kill(os.getpid(), signal.SIGINT)

    trained(tmp_path / "cut", 4, on_iteration=interrupt)
    trained(tmp_path / "cut", 4, resume=True)
    for name in ("policy.pt", "resume.pt"):
        parts = [(tmp_path / each / name).read_bytes() for each in ("whole", "cut")]
        assert parts[0] == parts[1], name
    mass = whole["ring"]["mass"]
    assert mass.shape == whole["ring"]["reward"].shape
    assert len(mass.unique()) > 20

    def height(features: torch.Tensor, starts: torch.Tensor) -> torch.Tensor:
        return features[..., column("base_height")][..., 0]

    never = replace(SAC, memory=1200, learn_from=1000)
    more = {"replay": (tmp_path / "whole",), "reward_fn": height, "sac": never}
    after = trained(tmp_path / "on", 1, **more)
    assert len(after["ring"]["mass"].unique()) == 1
