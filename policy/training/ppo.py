"""PPO: its settings, and RSL-RL's runner reporting to a callback."""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import torch
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict
from torch import Tensor

from data.features import column
from data.files.plain import ADDED_LATER, KIND_NONE, NONE_AS_BEFORE
from policy.env.env import QuadrupedEnv
from policy.extensions.bonus import ExplorationBonusCfg
from policy.extensions.kl_penalty import KlPenaltyCfg
from policy.networks.brought_model import BroughtModel
from policy.networks.recipe import Recipe
from policy.networks.two_model import TwoModel
from policy.options.gaits_model import GaitsCfg, GaitsModel
from policy.parallel.ranks import ALONE, Ranks
from policy.robots.hints import RobotError

from .mirror import mirror_of
from .reward_ppo import RewardPpo as RewardPpo
from .reward_ppo import ScoreFn as ScoreFn
from .reward_ppo import figures_of as figures_of
from .reward_ppo import history_of as history_of
from .take_over import take_over


@dataclass(frozen=True, kw_only=True)
class PpoCfg:
    """How a policy is trained; the defaults fit two CPU cores."""

    REMOVED: ClassVar = ("reference_kl_weight",)
    """Settings that older files have: of a pull to the first policy that was never on.
    """

    num_envs: int = 128
    """Environments that run side by side, those of all ranks together."""
    steps_per_env: int = 24
    """Control steps each environment contributes to one update."""
    hidden_sizes: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of actor and critic."""
    init_std: float = 0.6
    """Exploration noise at the start, in units of the action."""
    learning_rate: float = 1e-3
    """First step size; adapted so that an update moves the policy by `desired_kl`."""
    desired_kl: float = 0.04
    """Mean KL divergence between the policies before and after an update."""
    epochs: int = 5
    """Passes over each rollout."""
    minibatches: int = 4
    """Parts each pass is cut into."""
    gamma: float = 0.99
    """Discount per control step."""
    lam: float = 0.95
    """Bias-variance trade-off of the advantage (GAE)."""
    clip: float = 0.2
    """Clip range of the policy ratio and, in units of reward, of the value update."""
    entropy_weight: float = 0.005
    """Weight of the entropy bonus."""
    privileged_critic: bool = False
    """Let the critic see the truth, where the environment shows it: what a robot's
    sensors do not tell, and how the robot differs from its model."""
    mirror: bool = field(default=False, metadata=ADDED_LATER)
    """Learn from every step as its mirror image too, where both sides of the robot are
    the same."""
    kl_penalty: KlPenaltyCfg | None = field(default=None, metadata=KIND_NONE)
    """The KL-penalty form of PPO instead of the clipped one, which also adapts the
    learning rate."""
    bonus: ExplorationBonusCfg | None = field(default=None, metadata=KIND_NONE)
    """A bonus for motion that is new."""
    recipe: Recipe | None = field(default=None, metadata=NONE_AS_BEFORE)
    """The network of a policy from elsewhere; None is an MLP of `hidden_sizes`."""
    gaits: GaitsCfg | None = field(default=None, metadata=NONE_AS_BEFORE)
    """The gaits that a policy chooses among; None is one policy alone."""
    policies: Literal[2] | None = field(default=None, metadata=NONE_AS_BEFORE)
    """Two networks, one for each robot of a team; None is one for all."""

    def __post_init__(self) -> None:
        if self.mirror and (self.privileged_critic or self.kl_penalty is not None):
            raise RobotError(
                "learning in the mirror works neither with a critic that sees the "
                "truth, as where robots differ, nor with a KL penalty: leave one out"
            )

    @property
    def steps_per_iteration(self) -> int:
        """Environment steps of one update."""
        return self.num_envs * self.steps_per_env


def to_rsl_rl(cfg: PpoCfg) -> dict[str, Any]:
    """Spell `cfg` the way RSL-RL reads it; a new dictionary on every call."""
    network: dict[str, Any] = {
        "class_name": "MLPModel",
        "hidden_dims": list(cfg.hidden_sizes),
        "activation": "elu",
        "obs_normalization": True,
    }
    noise = {
        "class_name": "GaussianDistribution",
        "init_std": cfg.init_std,
        "std_type": "scalar",
    }
    if cfg.policies is not None:
        network["class_name"] = TwoModel
    actor: dict[str, Any] = dict(network)
    if cfg.recipe is not None:
        actor = {"class_name": BroughtModel, "recipe": cfg.recipe}
    if cfg.gaits is not None:
        actor = {"class_name": GaitsModel, "gaits": cfg.gaits}
    return {
        "num_steps_per_env": cfg.steps_per_env,
        "save_interval": 1,
        "obs_groups": {
            "actor": ["policy"],
            "critic": ["privileged" if cfg.privileged_critic else "policy"],
        },
        "actor": {**actor, "distribution_cfg": noise},
        "critic": dict(network),
        "algorithm": {
            "class_name": RewardPpo,
            "num_learning_epochs": cfg.epochs,
            "num_mini_batches": cfg.minibatches,
            "clip_param": cfg.clip,
            "use_clipped_value_loss": True,
            "gamma": cfg.gamma,
            "lam": cfg.lam,
            "entropy_coef": cfg.entropy_weight,
            "learning_rate": cfg.learning_rate,
            "schedule": "adaptive",
            "desired_kl": cfg.desired_kl,
            **(cfg.kl_penalty.algorithm if cfg.kl_penalty else {}),
        },
    }


@dataclass(frozen=True, kw_only=True)
class IterationStats:
    """What one iteration of training did."""

    iteration: int
    """Iterations done, this one included."""
    steps: int
    """Environment steps done, over all environments."""
    steps_per_s: float
    """Environment steps per second of this iteration."""
    mean_return: float
    """Mean reward of a step times the steps of a full episode."""
    scalars: dict[str, float]
    """Everything measured, by TensorBoard tag."""


class Runner(OnPolicyRunner):
    """RSL-RL's runner, reporting to a callback instead of to the console."""

    alg: RewardPpo  # pyright: ignore[reportIncompatibleVariableOverride]
    env: QuadrupedEnv

    def __init__(
        self,
        env: QuadrupedEnv,
        cfg: PpoCfg,
        ranks: Ranks = ALONE,
        *,
        algorithm: type[RewardPpo] = RewardPpo,
    ) -> None:
        """Make networks and storage for `env`, which holds this rank's share of the
        environments of `cfg`."""
        self.ppo, self.ranks = cfg, ranks
        settings = to_rsl_rl(cfg)
        settings["algorithm"]["class_name"] = algorithm
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(env, settings, log_dir=None, device=str(env.device))
        self.alg.ranks = ranks
        if cfg.bonus is not None:
            self.alg.bonus = cfg.bonus.make(step_dt_s=env.step_dt, ranks=ranks)
        if cfg.mirror:
            self.alg.mirror = mirror_of(env.robot).to(env.sim.device)
        if cfg.kl_penalty is not None:
            self.alg.penalise(cfg.kl_penalty.make(ranks))

    def _configure_multi_gpu(self) -> None:
        """Tell RSL-RL of the ranks; its own way knows GPUs only."""
        ranks = self.ranks
        self.is_distributed = ranks.size > 1
        self.gpu_world_size = ranks.size
        self.gpu_global_rank = self.gpu_local_rank = ranks.rank
        told = {"global_rank": ranks.rank, "world_size": ranks.size}
        self.cfg["multi_gpu"] = told if self.is_distributed else None

    @property
    def told(self) -> dict[str, Any]:
        """What beside its settings makes a training what it is."""
        return {"ranks": self.ranks.size} if self.ranks.size > 1 else {}

    @property
    def std(self) -> Tensor:
        """Exploration noise [12], or [2, 12] of two policies, which may be changed in
        place."""
        return self.alg.get_policy().distribution.std_param.data  # type: ignore[union-attr]

    def networks(self) -> dict[str, dict[str, Any]]:
        """Weights of actor and critic."""
        return {
            "actor": self.alg.actor.state_dict(),
            "critic": self.alg.critic.state_dict(),
        }

    def policy_states(self) -> dict[str, Any]:
        """State dictionaries of a policy file."""
        return self.alg.save()

    def start_from(self, init: Path, payload: dict[str, Any]) -> None:
        """Take over the networks of a policy file, and hold it as the reference."""
        take_over(self.alg, init, payload, sizes=self.ppo.hidden_sizes)
        with torch.random.fork_rng(devices=_devices(self.device)):
            reference = Runner(self.env, self.ppo).alg.get_policy()
        reference.load_state_dict(deepcopy(self.alg.get_policy().state_dict()))
        self.alg.reference = reference.eval()

    def begin(self) -> None:
        """Prepare the first iteration of a training."""
        env = self.env
        # Spread the time-outs, or all environments would be reset at the same step.
        env.episode_length_buf = torch.randint_like(
            env.episode_length_buf, high=env.max_episode_length
        )

    def snapshot(self) -> dict[str, Any]:
        """What beside networks and iterations a training goes on from."""
        state = {"env": self.env.snapshot(), "torch_rng": torch.get_rng_state()}
        if torch.device(self.device).type == "cuda":
            state["device_rng"] = torch.cuda.get_rng_state()
        return state

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from what `snapshot` gave, among other things."""
        self.env.restore(snapshot["env"])
        torch.set_rng_state(snapshot["torch_rng"])
        if "device_rng" in snapshot:
            torch.cuda.set_rng_state(snapshot["device_rng"])

    def learn(  # type: ignore[override]
        self,
        num_learning_iterations: int,
        on_iteration: Callable[[IterationStats], bool],
    ) -> None:
        """See `Learning.learn`."""
        self.alg.train_mode()
        obs = self.env.get_observations()
        while self.current_learning_iteration < num_learning_iterations:
            start_s = time.perf_counter()
            with torch.inference_mode():
                obs, scalars = self.collect(obs)
                collected_s = time.perf_counter()
                self.alg.compute_returns(obs)
            losses = self.alg.update()
            stop_s = time.perf_counter()
            self.current_learning_iteration += 1
            stats = self._stats(scalars, losses, start_s, collected_s, stop_s)
            if not on_iteration(stats):
                return

    def collect(self, obs: TensorDict) -> tuple[TensorDict, dict[str, float]]:
        """Fill the storage from observations `obs` on; gives the last ones, and figures
        of the rollout by TensorBoard tag."""
        extras: dict[str, Any] = {}
        for _ in range(self.ppo.steps_per_env):
            actions = self.alg.act(obs)
            obs, rewards, dones, extras = self.env.step(actions, score=False)
            self.alg.process_env_step(obs, rewards, dones, extras)
        # What the environment itself tells, as of the last step.
        return obs, self.figures() | {k: float(v) for k, v in extras["log"].items()}

    def figures(self) -> dict[str, float]:
        """Score the rollout by the task; gives figures of it by TensorBoard tag."""
        rewards, log = self.env.score(self.alg.features)
        self.alg.storage.rewards.copy_(rewards[..., None])
        scalars = {name: float(value) for name, value in log.items()}
        minutes = rewards.numel() * self.env.step_dt / 60.0
        falls = float(self.alg.features[..., column("fallen")].sum())
        scalars["episode/falls_per_minute"] = falls / minutes
        aborted = float((1.0 - self.alg.valid).sum())
        # Of all ranks, as what is told is a mean over them.
        scalars["episode/aborted"] = aborted * self.ranks.size
        return scalars

    def _stats(
        self,
        scalars: dict[str, float],
        losses: dict[str, float],
        start_s: float,
        collected_s: float,
        stop_s: float,
    ) -> IterationStats:
        iteration = self.current_learning_iteration
        found = self.ranks.means(
            {
                **scalars,
                **figures_of(self.alg.reward_fn),
                **{f"loss/{name}": value for name, value in losses.items()},
                "loss/learning_rate": self.alg.learning_rate,
                "policy/std": float(self.alg.get_policy().output_std.detach().mean()),
                "policy/reference_kl": self.alg.reference_kl,
                "train/return": self.alg.mean_reward * self.env.cfg.episode_steps,
                "perf/steps_per_s": self.ppo.steps_per_iteration / (stop_s - start_s),
                "perf/collect_s": collected_s - start_s,
                "perf/learn_s": stop_s - collected_s,
            }
        )
        return IterationStats(
            iteration=iteration,
            steps=iteration * self.ppo.steps_per_iteration,
            steps_per_s=found["perf/steps_per_s"],
            mean_return=found["train/return"],
            scalars=found,
        )


def _devices(device: str) -> list[int]:
    """GPUs whose chance is at stake beside the processor's."""
    return [] if device == "cpu" else [torch.cuda.current_device()]
