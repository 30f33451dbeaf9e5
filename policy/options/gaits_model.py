"""An actor made of frozen gaits and of what chooses among them.

Shapes: N environments, O gaits, D numbers that a chooser sees.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import torch
from rsl_rl.modules import MLP, EmpiricalNormalization
from tensordict import TensorDict
from torch import Tensor, nn

from policy.env.course import AHEAD_DIM, SIGHT_M
from policy.env.feature_row import OBS_DIM

from .choosing import ChoosingCfg, Draws, Running, choose, ran

SEEN_DIM = AHEAD_DIM - 1 + 9
"""What a chooser sees: what is ahead without the time, motion and tilt of the base."""
_CHOOSER = (64, 64)


@dataclass(frozen=True, kw_only=True)
class GaitsCfg:
    """Which gaits there are, and when one may end."""

    names: tuple[str, ...]
    """What they are called, each once."""
    sha256s: tuple[str, ...]
    """Of the policy files they are from."""
    hidden_sizes: tuple[tuple[int, ...], ...]
    """Of the network of each."""
    control_dt_s: float
    """Time between two actions."""
    choosing: ChoosingCfg = field(default_factory=ChoosingCfg)
    """When a gait ends, and who follows."""

    def __post_init__(self) -> None:
        if len(self.names) < 2 or len(set(self.names)) != len(self.names):
            raise ValueError(f"two or more gaits with different names: {self.names}")
        if not len(self.names) == len(self.sha256s) == len(self.hidden_sizes):
            raise ValueError("every gait has a name, a hash and sizes")


class Gait(nn.Module):
    """One frozen policy."""

    def __init__(self, hidden_sizes: tuple[int, ...]) -> None:
        super().__init__()
        self.obs_normalizer = EmpiricalNormalization(OBS_DIM)
        self.mlp = MLP(OBS_DIM, 12, list(hidden_sizes), "elu")

    def forward(self, obs: Tensor) -> Tensor:
        """Actions [N, 12] of `obs` [N, 48]."""
        return self.mlp(self.obs_normalizer(obs))


class Chooser(nn.Module):
    """What each gait is worth, and whether it ends."""

    def __init__(self, options: int) -> None:
        super().__init__()
        self.values = MLP(SEEN_DIM, options, list(_CHOOSER), "elu")
        self.ends = MLP(SEEN_DIM, options, list(_CHOOSER), "elu")

    def forward(self, seen: Tensor) -> tuple[Tensor, Tensor]:
        """Values [N, O] and probabilities of an end [N, O] where `seen` [N, D] is."""
        return self.values(seen), self.ends(seen).sigmoid()


def seen_by_chooser(obs: Tensor) -> Tensor:
    """[N, D] of observations on a course [N, 54]."""
    ahead = obs[:, OBS_DIM : OBS_DIM + AHEAD_DIM - 1].clone()
    ahead[:, -2:] /= SIGHT_M
    return torch.cat((ahead, obs[:, :9]), dim=1)


def begins(obs: Tensor) -> Tensor:
    """[N] where observations on a course [N, 54] are the first of an episode."""
    return obs[:, OBS_DIM + AHEAD_DIM - 1] <= 0.0


class _Std(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.std_param = nn.Parameter(torch.zeros(12), requires_grad=False)


class GaitsModel(nn.Module):
    """Stands for RSL-RL's actor in a policy that chooses among gaits.

    It remembers which gait runs in every row of a batch, from the first step of an
    episode on, which it sees by the time in the observation.
    """

    def __init__(
        self,
        obs: TensorDict | None = None,
        obs_groups: dict[str, list[str]] | None = None,
        obs_set: str = "actor",
        output_dim: int = 12,
        *,
        gaits: GaitsCfg,
        distribution_cfg: dict[str, Any] | None = None,
    ) -> None:
        """Its weights are to be loaded; all but `gaits` is for RSL-RL's sake."""
        super().__init__()
        self.cfg = gaits
        self.gaits = nn.ModuleList(Gait(sizes) for sizes in gaits.hidden_sizes)
        self.chooser = Chooser(len(gaits.names))
        self.distribution = _Std()
        self.running = Running.nothing(0)
        self.explored = 0.0
        """Share of choices at random."""
        self.wandering: Tensor | None = None
        """[N] rows that change their gait at random, so that clips differ."""
        self.rng: torch.Generator | None = None
        """Of chance in choices and ends; None takes the best and the likelier."""
        self.requires_grad_(requires_grad=False)

    @torch.no_grad()
    def forward(self, obs: TensorDict) -> Tensor:
        """Actions [N, 12] of the gaits that run now."""
        return self.act(obs["policy"])

    def act(self, obs: Tensor) -> Tensor:
        """Actions [N, 12] of `obs` [N, 54]; looks, chooses and remembers."""
        if len(self.running.gait) != len(obs):
            self.running = Running.nothing(len(obs))
        q, ends = self.chooser(seen_by_chooser(obs))
        return self.act_as(obs, self.choice(obs, q, ends))

    def choice(self, obs: Tensor, q: Tensor, ends: Tensor) -> Running:
        """Which gaits run in the step from `obs` [N, 54]."""
        rng = self.rng
        draws = Draws.none(obs) if rng is None else Draws.of(rng, len(obs))
        if self.wandering is not None:
            # Who does not wander takes the likelier end, whatever others do.
            ends_at = torch.where(self.wandering, draws.ends, 0.5)
            draws = replace(draws, ends=ends_at)
        return choose(
            self.running,
            q,
            ends,
            begins(obs),
            self.cfg.choosing,
            control_dt_s=self.cfg.control_dt_s,
            draws=draws,
            explored=self.explored,
            wandering=self.wandering,
        )

    def act_as(self, obs: Tensor, running: Running) -> Tensor:
        """Actions [N, 12] of `running`, which is remembered."""
        self.running = ran(running)
        return _acted(self.gaits, obs, running.gait)

    def as_jit(self) -> nn.Module:
        """The same without memory, which goes in and comes out."""
        return GaitsNetwork(self)


class GaitsNetwork(nn.Module):
    """Gaits and what chooses among them, to be written into a file."""

    def __init__(self, model: GaitsModel) -> None:
        super().__init__()
        self.gaits, self.chooser = model.gaits, model.chooser
        self._cfg = model.cfg

    def forward(
        self, obs: Tensor, gait: Tensor, steps: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Actions [N, 12] of `obs` [N, 54], and the memory for the step after.

        Args:
            obs: As on a course.
            gait: [N] long, which gait ran in the step before; any at the first.
            steps: [N] long, control steps since it was chosen.
        """
        q, ends = self.chooser(seen_by_chooser(obs))
        now = ran(
            choose(
                Running(gait=gait, steps=steps, chosen=gait < 0),
                q,
                ends,
                begins(obs),
                self._cfg.choosing,
                control_dt_s=self._cfg.control_dt_s,
                draws=Draws.none(obs),
            )
        )
        return _acted(self.gaits, obs, now.gait), now.gait, now.steps


def _acted(gaits: nn.ModuleList, obs: Tensor, gait: Tensor) -> Tensor:
    """Actions [N, 12] of `obs` [N, 54] by the gait [N] that runs."""
    actions = torch.stack([each(obs[:, :OBS_DIM]) for each in gaits], dim=1)
    which = gait[:, None, None].expand_as(actions[:, :1])
    return actions.gather(1, which)[:, 0]
