"""Bonuses for base motion that is new: what there is to learn before any answer.

They look at how the base moves and never at joints, or waving a leg would be news.

Shapes: T steps of a rollout, N environments, S = 6 figures of motion, R states.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from rsl_rl.extensions import RandomNetworkDistillation
from tensordict import TensorDict
from torch import Tensor, nn

from data.features import column
from policy.parallel.ranks import ALONE, Ranks

MOTION_SCALE = (0.3, 0.3, 0.6, 0.05, 0.2, 0.2)
"""What counts as a difference in (forward m/s, left m/s, yaw rad/s, height m, roll,
pitch), the last two as sines."""

_LIMIT = 20.0
"""A tumbling robot is no newer than this many scales."""


@dataclass(frozen=True, kw_only=True)
class ExplorationBonusCfg:
    """A bonus for motion that is new, added to any reward."""

    kind: Literal["rnd", "entropy"]
    """`rnd`: the error of a network that learns to predict a random one (Burda et al.
    2018); `entropy`: the distance to the k-th nearest of the states seen so far (Liu
    and Abbeel 2021, eq. 5)."""
    weight: float = 1.0
    """Reward per second of a step whose novelty is one deviation above the mean."""
    decay_iterations: int | None = None
    """Iterations over which the weight falls to 0; None keeps it."""
    neighbors: int = 5
    """k of `entropy`."""
    memory: int = 2048
    """States `entropy` remembers."""

    def __post_init__(self) -> None:
        if self.neighbors < 1 or self.memory <= self.neighbors:
            raise ValueError(
                f"memory must exceed neighbors, which must be at least 1; got "
                f"{self.memory} and {self.neighbors}"
            )
        if self.decay_iterations is not None and self.decay_iterations < 1:
            raise ValueError(
                f"decay_iterations must be at least 1, got {self.decay_iterations}"
            )

    def make(self, *, step_dt_s: float, ranks: Ranks = ALONE) -> ExplorationBonus:
        """The bonus of a training whose control steps take `step_dt_s`, and which
        `ranks` do together."""
        made = RndBonus if self.kind == "rnd" else EntropyBonus
        bonus = made(self, step_dt_s=step_dt_s)
        bonus.ranks = ranks
        return bonus


def base_motion(features: Tensor) -> Tensor:
    """Scaled motion [..., S] of the base in feature rows [..., F]."""
    motion = torch.cat(
        [
            features[..., column("base_lin_vel_b")][..., :2],
            features[..., column("base_ang_vel_b")][..., 2:],
            features[..., column("base_height")],
            features[..., column("gravity_b")][..., [1, 0]],
        ],
        dim=-1,
    )
    return (motion / motion.new_tensor(MOTION_SCALE)).clamp(-_LIMIT, _LIMIT)


class ExplorationBonus(nn.Module):
    """Novelty of whole rollouts, with everything needed to go on after a resume.

    The bonus of a rollout has mean 0 and deviation `weight`: what sums to nothing
    neither pays for staying alive nor for falling.
    """

    ranks: Ranks = ALONE
    """Whose rollouts count as one."""

    def __init__(self, cfg: ExplorationBonusCfg, *, step_dt_s: float) -> None:
        super().__init__()
        self.cfg = cfg
        self._step_dt_s = step_dt_s
        self.iterations: Tensor
        self.register_buffer("iterations", torch.zeros((), dtype=torch.long))

    @property
    def weight(self) -> float:
        """Weight of the next rollout."""
        decay = self.cfg.decay_iterations
        if decay is None:
            return self.cfg.weight
        return self.cfg.weight * max(0.0, 1.0 - int(self.iterations) / decay)

    @torch.no_grad()
    def forward(self, features: Tensor) -> Tensor:
        """Bonus [T, N] of `features` [T, N, F], which count as seen from then on."""
        motion = base_motion(features)
        novelty = self.novelty(motion)
        mean, std = self.ranks.mean_and_std(novelty)
        scale = self.weight * self._step_dt_s / std.clamp_min(1e-6)
        self.remember(motion)
        self.iterations += 1
        return (novelty - mean) * scale

    def novelty(self, motion: Tensor) -> Tensor:
        """How new states [T, N, S] are, [T, N], in any unit."""
        raise NotImplementedError

    def remember(self, motion: Tensor) -> None:
        """Count states [T, N, S] as seen."""
        raise NotImplementedError


class EntropyBonus(ExplorationBonus):
    """Log distance to the k-th nearest state of a memory: an estimate of entropy."""

    def __init__(self, cfg: ExplorationBonusCfg, *, step_dt_s: float) -> None:
        super().__init__(cfg, step_dt_s=step_dt_s)
        self.memory: Tensor
        self.register_buffer("memory", torch.zeros(cfg.memory, len(MOTION_SCALE)))

    def novelty(self, motion: Tensor) -> Tensor:
        if not int(self.iterations):
            self._replace(motion, self.cfg.memory)
        states = motion.flatten(0, 1)
        nearest = torch.cdist(states, self.memory).topk(
            self.cfg.neighbors, dim=1, largest=False
        )
        return torch.log1p(nearest.values[:, -1]).view(motion.shape[:2])

    def remember(self, motion: Tensor) -> None:
        # A sixteenth a rollout: what was seen lately is old news, and so is what was
        # seen ten rollouts ago.
        self._replace(motion, max(1, self.cfg.memory // 16))

    def _replace(self, motion: Tensor, count: int) -> None:
        states = motion.flatten(0, 1)
        chosen = torch.randint(len(states), (count,))
        slots = torch.randperm(len(self.memory))[:count]
        self.memory[slots] = states[chosen]


class RndBonus(ExplorationBonus):
    """RSL-RL's random network distillation on the motion of the base."""

    def __init__(self, cfg: ExplorationBonusCfg, *, step_dt_s: float) -> None:
        super().__init__(cfg, step_dt_s=step_dt_s)
        # Its own schedule is a plain attribute that no checkpoint holds; ours is used.
        self.rnd = RandomNetworkDistillation(
            num_states=len(MOTION_SCALE),
            obs_groups={"rnd_state": ["motion"]},
            num_outputs=16,
            predictor_hidden_dims=[64, 64],
            target_hidden_dims=[64, 64],
            state_normalization=True,
            weight=1.0,
        )

    def novelty(self, motion: Tensor) -> Tensor:
        return self.rnd.get_intrinsic_reward(_group(motion)).view(motion.shape[:2])

    def remember(self, motion: Tensor) -> None:
        # The rollout was collected in inference mode, which no gradient survives.
        with torch.inference_mode(False), torch.enable_grad():
            states = _group(motion.clone())
            self.rnd.train()
            self.rnd.update_normalization(states)
            for chosen in torch.randperm(len(states)).chunk(4):
                self.rnd.optimizer.zero_grad()
                self.rnd.compute_loss(states[chosen]).backward()
                found = (p.grad for p in self.rnd.predictor.parameters())
                self.ranks.average([each for each in found if each is not None])
                self.rnd.optimizer.step()

    def get_extra_state(self) -> dict[str, object]:
        """State of the predictor's optimiser."""
        return self.rnd.optimizer.state_dict()

    def set_extra_state(self, state: dict[str, object]) -> None:
        self.rnd.optimizer.load_state_dict(state)


def _group(motion: Tensor) -> TensorDict:
    states = motion.flatten(0, 1)
    return TensorDict({"motion": states}, batch_size=[len(states)])
