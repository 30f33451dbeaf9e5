"""Actor and learner in one process, beside PPO as it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.errors import GaitprefError
from policy.engines.actor import Actor, ActorPlan, weights_of
from policy.engines.actors_cfg import ActorsCfg, ActorsError
from policy.engines.asynchronous import absorb, apply_gradients, moments_of
from policy.engines.ray_cluster import require_same_versions, versions
from policy.engines.with_actors import ActorsRunner, WithActors
from policy.env.curriculum import CurriculumCfg
from policy.env.randomise import make_env
from policy.robots.robot import Robot, load_robot
from policy.training.ppo import Runner
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.two_ranks import ENV, ONE_BATCH, Steady

CFG = TrainCfg(steps=1000, env=ENV, ppo=replace(ONE_BATCH, minibatches=3))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=ENV.physics_dt_s)


def learner(robot: Robot, cfg: TrainCfg = CFG, actors: int = 1) -> ActorsRunner:
    runner = WithActors(cfg=ActorsCfg(actors=actors))(robot, cfg, 0)
    assert isinstance(runner, ActorsRunner)
    runner.alg.reward_fn = Steady()
    runner.alg.train_mode()
    return runner


def plan(robot: Robot, actor: int = 0, num_envs: int = 8) -> ActorPlan:
    return ActorPlan(
        actor=actor,
        robot_name=robot.name,
        robot_mjcf=robot.mjcf,
        env=ENV,
        ppo=CFG.ppo,
        num_envs=num_envs,
        seed=5,
        reward_fn=Steady(),
    )


def test_without_lag_an_actor_and_a_learner_are_ppo(robot: Robot) -> None:
    """Two iterations with a reward that looks back: the same networks, value targets
    and step size as a runner has that does both."""
    apart = learner(robot)
    seeds = np.random.SeedSequence(5).generate_state(2)
    torch.manual_seed(int(seeds[0]))
    together = Runner(make_env(robot, ENV, 8, seed=int(seeds[1])), CFG.ppo)
    together.alg.reward_fn = Steady()
    together.begin()
    actor = Actor(plan(robot))
    for name in ("actor", "critic"):
        state = getattr(together.alg, name).state_dict()
        getattr(apart.alg, name).load_state_dict(state)
    for iteration in range(2):
        chance = torch.get_rng_state()
        together.learn(iteration + 1, lambda stats: True)
        torch.set_rng_state(chance)
        sent = actor.rollout(weights_of({"actor": apart.alg.actor}), 0, iteration)
        with torch.inference_mode():
            last = apart.alg.adopt([sent])
            apart.figures()
            apart.alg.compute_returns(last)
        apart.alg.update()
        assert apart.alg.clipped_share == 0.0
        stored, expected = apart.alg.storage, together.alg.storage
        assert stored.returns.allclose(expected.returns, atol=1e-5)
        assert stored.advantages.allclose(expected.advantages, atol=1e-4)
        assert apart.alg.learning_rate == together.alg.learning_rate
        for name in ("actor", "critic"):
            found = getattr(apart.alg, name).state_dict()
            for key, value in getattr(together.alg, name).state_dict().items():
                assert found[key].allclose(value, atol=1e-5), (iteration, name, key)


def test_what_a_dropped_rollout_held_is_not_looked_back_at(robot: Robot) -> None:
    """What was before it is no neighbour of what comes after it."""
    runner = learner(robot)
    actor, weights = Actor(plan(robot)), weights_of({"actor": runner.alg.actor})
    first, _, third, fourth = (actor.rollout(weights, 0, n) for n in range(4))
    with torch.inference_mode():
        runner.alg.adopt([first])
        runner.alg.adopt([third])
        assert runner.alg.before is not None
        assert not runner.alg.before[0].any()
        runner.alg.adopt([fourth])
    assert runner.alg.before is not None
    rows = len(runner.alg.before[0])
    seen = torch.tensor(third.features)[-rows:]
    assert runner.alg.before[0].equal(seen)


def test_older_rollouts_count_less(robot: Robot) -> None:
    """Two actors, one with other weights: its steps are clipped, the other's not."""
    runner = learner(robot, actors=2)
    present = weights_of({"actor": runner.alg.actor})
    other = {"actor": {k: v + 0.02 for k, v in present["actor"].items()}}
    sent = [
        Actor(plan(robot, actor, 4)).rollout(weights, actor, 0)
        for actor, weights in enumerate((present, other))
    ]
    with torch.inference_mode():
        last = runner.alg.adopt(sent)
        runner.figures()
        runner.alg.compute_returns(last)
    assert 0.05 < runner.alg.clipped_share < 0.5


def test_a_gradient_is_a_step_towards_what_paid(robot: Robot) -> None:
    """Along the actor's own gradient the actions that were better become likelier, and
    the learner's normalisers know what the actor saw."""
    runner = learner(robot)
    alg = runner.alg
    networks = {"actor": alg.actor, "critic": alg.critic}
    actor = Actor(plan(robot))
    sent = actor.gradient(weights_of(networks), 0, 1)
    rollout = Actor(plan(robot)).rollout(weights_of(networks), 0, 1)
    apply_gradients(alg, sent.actor, sent.critic)
    with torch.inference_mode():
        last = alg.adopt([rollout])
        runner.figures()
        likelier = alg.storage.actions_log_prob[..., 0] - torch.tensor(
            rollout.log_probs
        )
        alg.compute_returns(last)
    assert float((likelier * alg.storage.advantages[..., 0]).mean()) > 0.0
    seen = alg.storage.observations.flatten(0, 1)
    for part in seen.chunk(3):
        absorb(alg.actor, moments_of(alg.actor, part))
    alg.critic.update_normalization(seen)
    ours, theirs = (n.obs_normalizer.state_dict() for n in (alg.actor, alg.critic))
    for name, value in theirs.items():
        assert ours[name].allclose(value, atol=1e-4, rtol=1e-4), name


@pytest.mark.parametrize(
    ("actors", "settings", "told"),
    [
        (ActorsCfg(actors=3), CFG, "give --envs 9"),
        (ActorsCfg(actors=4, cores=2), CFG, r"has 2: give --actors 2"),
        (ActorsCfg(actors=1, address="here"), CFG, "takes HOST:PORT"),
        (ActorsCfg(actors=1, address="127.0.0.1:9"), CFG, "no Ray answers"),
        (
            ActorsCfg(actors=1),
            replace(CFG, env=replace(ENV, curriculum=CurriculumCfg())),
            "leave out --curriculum",
        ),
        (
            ActorsCfg(actors=1, update="gradients"),
            replace(CFG, ppo=replace(ONE_BATCH, mirror=True)),
            "give --update vtrace",
        ),
    ],
)
def test_what_actors_cannot_do_is_told(
    robot: Robot, tmp_path: Path, actors: ActorsCfg, settings: TrainCfg, told: str
) -> None:
    with pytest.raises(GaitprefError, match=told) as caught:
        train(tmp_path, robot, settings, engine=WithActors(cfg=actors))
    assert "\n" not in str(caught.value)


def test_machines_with_other_versions_are_named() -> None:
    ours = versions()
    require_same_versions(ours, versions(), "node-a")
    told = r"node-b has mujoco 3\.1, the learner's machine 4"
    with pytest.raises(ActorsError, match=told):
        require_same_versions(ours, ours | {"mujoco": "3.1"}, "node-b")
