"""What each part of a training with actors, and of labeling, costs: measured here.

Times are of a processor, not of a clock, so that other work on the machine counts
little. Shapes: T steps of a rollout, N environments.
"""

from __future__ import annotations

import json
import pickle
import time
from dataclasses import dataclass
from pathlib import Path

import torch

from data.episodes.writer import encode_episode
from policy.engines.actor import Actor, ActorPlan, weights_of
from policy.engines.actors_cfg import ActorsCfg
from policy.engines.with_actors import ActorsRunner, WithActors
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.ppo import PpoCfg
from policy.training.setup import setting_of
from policy.training.train_cfg import TrainCfg

from .harness import median

PAGE = Path("docs/results/page.json")
CROWD = Path("docs/results/crowd.json")


@dataclass(frozen=True, kw_only=True)
class Costs:
    """One environment step, one answer, one second of a robot's log."""

    actor_s: float
    """An actor's core for an environment step: policy, physics, feature row."""
    learner_s: float
    """The learner's core for it: reward, V-trace, PPO's epochs."""
    adopt_s: float
    """The learner's core for taking it out of what an actor sent."""
    step_bytes: float
    """What an actor sends for it."""
    weights_bytes: float
    """What an actor is sent for each rollout."""
    gradient_bytes: float
    """What a process sends for each gradient, of the networks of `PpoCfg`."""
    rater_cores: float
    """A label host's cores for a rater who answers at a person's pace, or, where no
    crowd was measured, for one who watches."""
    log_bytes_per_s: float
    """A data set for each second of a robot that is logged."""


def measured_costs(
    *, envs: int = 64, repeats: int = 5, page: Path = PAGE, crowd: Path = CROWD
) -> Costs:
    """Measure all of it, in a minute or two.

    Args:
        envs: Environments of one actor.
        repeats: Rollouts, of which the median counts; one more comes before.
        page: Where `benchmarks.page` has put its figures.
        crowd: The same of `benchmarks.page --crowd`, if there are any.
    """
    torch.set_num_threads(1)
    setting = setting_of(None, None)
    cfg = TrainCfg(steps=1, env=setting.env, ppo=PpoCfg(num_envs=envs))
    runner = WithActors(cfg=ActorsCfg(actors=1))(setting.robot, cfg, 0)
    assert isinstance(runner, ActorsRunner)
    runner.alg.train_mode()
    actor = Actor(
        ActorPlan(
            actor=0,
            robot_name=setting.robot.name,
            robot_mjcf=setting.robot.mjcf,
            env=setting.env,
            ppo=cfg.ppo,
            num_envs=envs,
            seed=0,
        )
    )
    steps = envs * cfg.ppo.steps_per_env
    # The first one warms up.
    iterations = [_iteration(actor, runner) for _ in range(repeats + 1)][1:]
    weights = weights_of({"actor": runner.alg.actor})

    def per_step(name: str) -> float:
        return median([getattr(each, name) for each in iterations]) / steps

    return Costs(
        actor_s=per_step("actor_s"),
        learner_s=per_step("learner_s"),
        adopt_s=per_step("adopt_s"),
        step_bytes=per_step("sent_bytes"),
        weights_bytes=float(len(pickle.dumps(weights))),
        gradient_bytes=_gradient_bytes(runner),
        rater_cores=rater_cores(page, crowd),
        log_bytes_per_s=_log_bytes_per_s(),
    )


@dataclass(frozen=True, kw_only=True)
class _Iteration:
    actor_s: float
    adopt_s: float
    learner_s: float
    sent_bytes: float


def _iteration(actor: Actor, runner: ActorsRunner) -> _Iteration:
    """A rollout of one actor, and an update on it alone."""
    clock = time.process_time
    begun_s = clock()
    sent = actor.rollout(weights_of({"actor": runner.alg.actor}), 0, 0)
    actor_s = clock() - begun_s
    packed = pickle.dumps(sent)
    begun_s = clock()
    with torch.inference_mode():
        last = runner.alg.adopt([pickle.loads(packed)])
    adopt_s = clock() - begun_s
    begun_s = clock()
    with torch.inference_mode():
        runner.figures()
        runner.alg.compute_returns(last)
    runner.alg.update()
    return _Iteration(
        actor_s=actor_s,
        adopt_s=adopt_s,
        learner_s=clock() - begun_s,
        sent_bytes=float(sent.bytes),
    )


def rater_cores(page: Path = PAGE, crowd: Path = CROWD) -> float:
    """Of a crowd that answers, where one was measured, or of those who watch."""
    if crowd.exists():
        told = json.loads(crowd.read_text())
        return told["cores"] / told["raters"]
    return json.loads(page.read_text())["cores_8_raters"] / 8


def _gradient_bytes(runner: ActorsRunner) -> float:
    """A number for every parameter of actor and critic."""
    networks = (runner.alg.actor, runner.alg.critic)
    parameters = (each for network in networks for each in network.parameters())
    return float(sum(each.numel() * each.element_size() for each in parameters))


def _log_bytes_per_s() -> float:
    cfg = RecordCfg(episodes=4, episode_s=10.0)
    episodes = list(record(WALK, cfg, seed=0, round=0))
    size = sum(len(encode_episode(each, model_apart=True)) for each in episodes)
    return size / sum(each.duration_s for each in episodes)
