"""Actors on a real Ray whose steps an off-policy learner remembers."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.errors import GaitprefError
from data.features import FEATURE_DIM
from policy.engines.actors_cfg import ActorsCfg
from policy.engines.trajectory import Origin
from policy.env.env_cfg import EnvCfg
from policy.offpolicy.explorer import SentSteps
from policy.offpolicy.from_actors import FromActors
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.offpolicy.ring import Ring
from policy.offpolicy.sac import Sac
from policy.offpolicy.sac_cfg import PriorityCfg, SacCfg
from policy.robots.robot import load_robot
from policy.training.checkpoint import load_policy, read_plain
from policy.training.ppo import IterationStats, PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.one_ray import one_ray
from tests.policy.test_actors import _actors_on

# Ray leaves log files and sockets to the end of the process.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
ENV = EnvCfg(episode_s=0.4)
PPO = PpoCfg(num_envs=4, steps_per_env=8, hidden_sizes=(16,))
SAC = SacCfg(
    critic_sizes=(16,),
    memory=600,
    learn_from=60,
    batch=32,
    priorities=PriorityCfg(),
)
ROBOT = load_robot(physics_dt_s=ENV.physics_dt_s)
CFG = TrainCfg(steps=12 * PPO.steps_per_iteration, env=ENV, ppo=PPO)
TWO = ActorsCfg(actors=2)


def test_steps_that_do_not_follow_are_parted() -> None:
    """Two actors of two columns. The first goes on; then the second dies and the first
    fills in, which neither follows; then both are back."""
    ring = Ring(20, 4, 1, device="cpu")
    learner = Sac(SAC, 1, torch.ones(12), (16,))
    source = FromActors(ROBOT, CFG, TWO, learner, ring, seed=0, tell=lambda line: None)
    for sent in (
        ((0, 1), (1, 1)),
        ((1, 2), (0, 2)),
        ((0, 4), (0, 3)),
        ((0, 5), (1, 4)),
    ):
        ring.add(source.joined([_sent(*each) for each in sent]))
    # Rows of three steps each; what was sent says who, and which.
    assert ring.obs[::3, ::2, 0].tolist()[:4] == [[1, 11], [2, 12], [3, 4], [5, 14]]
    assert ring.cut[:12].nonzero().tolist() == [[5, 2], [5, 3], *_both(8)]
    assert ring.starts[:12].nonzero().tolist() == [*_both(0), [6, 2], [6, 3], *_both(9)]


def _both(row: int) -> list[list[int]]:
    return [[row, column] for column in range(4)]


def _sent(actor: int, sequence: int) -> SentSteps:
    marks = np.zeros((3, 2), dtype=bool)
    obs = np.full((3, 2, 1), 10 * actor + sequence, dtype=np.float32)
    rows = np.zeros((3, 2, FEATURE_DIM), dtype=np.float32)
    chunk = {"obs": obs, "features": rows, "starts": marks, "fallen": marks}
    return SentSteps(
        origin=Origin(actor, sequence, 0),
        chunk={**chunk, "cut": marks},
        log={},
        collect_s=0.0,
    )


def test_what_actors_cannot_do_is_refused(tmp_path: Path) -> None:
    engine = OffPolicy(cfg=SAC, actors=replace(TWO, update="gradients"))
    with pytest.raises(GaitprefError, match="--update gradients is A3C's"):
        train(tmp_path, ROBOT, CFG, engine=engine)
    engine = OffPolicy(cfg=SAC, actors=TWO, offline=True, replay=(tmp_path,))
    with pytest.raises(GaitprefError, match="nothing for --actors to do"):
        train(tmp_path, ROBOT, CFG, engine=engine)
    engine = OffPolicy(cfg=SAC, actors=replace(TWO, actors=3))
    with pytest.raises(GaitprefError, match="cannot be shared evenly by 3"):
        train(tmp_path, ROBOT, CFG, engine=engine)


def test_an_actor_dies_and_the_training_goes_on_and_is_resumed(tmp_path: Path) -> None:
    """Memory fills by the steps asked for, learned from by priority; resumed, actors go
    on with numbers that nobody had."""
    seen: list[IterationStats] = []
    said: list[str] = []

    def disturb(stats: IterationStats) -> None:
        seen.append(stats)
        if stats.iteration == 2:
            os.kill(_actors_on(os.getpid())[0], signal.SIGKILL)

    engine = OffPolicy(cfg=SAC, actors=TWO, tell=said.append)
    with one_ray():
        train(tmp_path, ROBOT, CFG, engine=engine, on_iteration=disturb)
        first = read_plain(tmp_path / "resume.pt")
        longer = replace(CFG, steps=CFG.steps + 2 * PPO.steps_per_iteration)
        result = train(tmp_path, ROBOT, longer, engine=engine, resume=True)
    last = seen[-1].scalars
    assert last["actors/replaced"] == 1
    assert any("died and is replaced" in line for line in said)
    assert last["actors/used"] == 2 * 12
    assert last["memory/steps"] == CFG.steps
    assert last["loss/critic"] > 0.0
    # Asked for before the last update, while the learner learned.
    assert last["actors/lag_most"] == 1.0
    assert len(first["ring"]["mass"].unique()) > 20
    after = read_plain(tmp_path / "resume.pt")
    assert all(after["sequences"][a] > n for a, n in first["sequences"].items())
    assert result.stats is not None
    assert result.stats.scalars["memory/steps"] == longer.steps == 14 * 32
    assert load_policy(result.policy).info.steps == longer.steps
