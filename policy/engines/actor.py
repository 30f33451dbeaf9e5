"""One actor: environments, a copy of the policy, and what it makes of both.

It knows nothing of who runs it, and where.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor, nn

from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.env.randomise import make_env
from policy.robots.robot import Robot, load_robot_xml
from policy.training.ppo import PpoCfg, Runner, ScoreFn, history_of

from .asynchronous import gradients_of, moments_of
from .trajectory import Gradient, Origin, Trajectory

Weights = Mapping[str, Mapping[str, np.ndarray]]
"""State of the networks by name."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EnvPlan:
    """The environments of an actor."""

    actor: int
    robot_name: str
    robot_mjcf: str
    env: EnvCfg
    num_envs: int
    """Environments of this one."""
    seed: int

    def robot(self) -> Robot:
        """The robot that acts."""
        return load_robot_xml(
            self.robot_mjcf, name=self.robot_name, physics_dt_s=self.env.physics_dt_s
        )

    def begin_env(self) -> QuadrupedEnv:
        """The environments, on one core; sets PyTorch's chance of this process."""
        torch.set_num_threads(1)
        seeds = np.random.SeedSequence(self.seed).generate_state(2)
        torch.manual_seed(int(seeds[0]))
        return make_env(
            self.robot(), self.env, self.num_envs, seed=int(seeds[1]), threads=1
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ActorPlan(EnvPlan):
    """All an actor has to know before it begins."""

    ppo: PpoCfg
    """The learner's; an actor learns nothing itself."""
    reward_fn: ScoreFn | None = None
    """What it scores by where it sends gradients; None is the task's own reward."""

    def begin(self) -> Actor:
        """The actor."""
        return Actor(self)


class Actor:
    """Collects rollouts with whatever weights it is given."""

    def __init__(self, plan: ActorPlan) -> None:
        self._plan = plan
        env = plan.begin_env()
        # What is learned, and from what else, is the learner's affair.
        own = replace(plan.ppo, num_envs=plan.num_envs, bonus=None, kl_penalty=None)
        self._runner = Runner(env, replace(own, mirror=False))
        self._runner.alg.reward_fn = plan.reward_fn
        self._runner.alg.train_mode()
        self._runner.begin()
        self._obs = env.get_observations()

    def rollout(self, weights: Weights, version: int, sequence: int) -> Trajectory:
        """A rollout of the policy `weights`.

        Args:
            weights: State of the network `actor`.
            version: What the learner calls them.
            sequence: Number of this rollout.
        """
        begun_s = time.perf_counter()
        self._collect(weights)
        alg = self._runner.alg
        storage = alg.storage
        return Trajectory(
            origin=Origin(self._plan.actor, sequence, version),
            observations=_arrays(storage.observations),
            last_observations=_arrays(self._obs),
            actions=_array(storage.actions),
            log_probs=_array(storage.actions_log_prob[..., 0]),
            features=_array(alg.features),
            starts=_array(alg.starts),
            dones=_array(storage.dones[..., 0]),
            time_outs=_array(alg.time_outs),
            valid=_array(alg.valid),
            collect_s=time.perf_counter() - begun_s,
        )

    def gradient(self, weights: Weights, version: int, sequence: int) -> Gradient:
        """What a rollout of the policy `weights`, which are of both networks, says they
        should change by."""
        begun_s = time.perf_counter()
        scalars = self._collect(weights)
        alg = self._runner.alg
        with torch.inference_mode():
            alg.compute_returns(self._obs)
        of_actor, of_critic, losses = gradients_of(alg)
        moments = {
            name: moments_of(network, alg.storage.observations.flatten(0, 1))
            for name, network in (("actor", alg.actor), ("critic", alg.critic))
        }
        return Gradient(
            origin=Origin(self._plan.actor, sequence, version),
            actor=of_actor,
            critic=of_critic,
            moments=moments,
            scalars=scalars | losses,
            mean_reward=alg.mean_reward,
            collect_s=time.perf_counter() - begun_s,
        )

    def _collect(self, weights: Weights) -> dict[str, float]:
        alg = self._runner.alg
        for name, state in weights.items():
            load_weights(getattr(alg, name), state)
        alg.storage.clear()
        with torch.inference_mode():
            self._obs, scalars = self._runner.collect(self._obs)
        return scalars


def weights_of(networks: Mapping[str, nn.Module]) -> Weights:
    """What actors act by, for `networks` by name."""
    return {
        name: {key: _array(value) for key, value in network.state_dict().items()}
        for name, network in networks.items()
    }


def history_rows(reward_fn: ScoreFn | None) -> int:
    """Rows before a rollout that its reward looks at."""
    return 0 if reward_fn is None else history_of(reward_fn)


def load_weights(network: nn.Module, state: Mapping[str, np.ndarray]) -> None:
    """Let `network` have the weights `state`."""
    # Arrays that other processes share are not to be written to; torch copies them.
    network.load_state_dict({k: torch.tensor(v) for k, v in state.items()})


def _arrays(groups: TensorDict) -> dict[str, np.ndarray]:
    return {str(name): _array(groups[name]) for name in groups.keys()}  # noqa: SIM118


def _array(values: Tensor) -> np.ndarray:
    """A copy that later rollouts do not write into."""
    return values.detach().cpu().numpy().copy()
