"""Commands that ask for more as they are followed better.

Shapes: N environments, F feature columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from data.features import column
from policy.parallel.ranks import ALONE, Ranks


@dataclass(frozen=True, kw_only=True)
class CurriculumCfg:
    """How the ranges of the commands widen, as multiples of the configured ones."""

    start: float = 0.4
    """Where they begin, around the slowest command."""
    end: float = 1.5
    """Where they end."""
    widen: float = 0.1
    """Added at a time."""
    good: float = 0.8
    """Mean of exp(-e^2 / 0.25), e the planar velocity error in m/s, from which on the
    ranges widen."""
    window_s: float = 5.0
    """Time it is averaged over; commands should be drawn anew within it."""

    def __post_init__(self) -> None:
        if not 0 < self.start <= self.end:
            raise ValueError(
                f"0 < start <= end must hold, got {self.start} and {self.end}"
            )
        if not (0 < self.good < 1 and self.widen > 0 and self.window_s > 0):
            raise ValueError(
                f"good must lie in (0, 1), widen and window_s be positive, got "
                f"{self.good}, {self.widen} and {self.window_s}"
            )


class Curriculum:
    """How far the commands have come; kept on the environment's own device."""

    def __init__(
        self,
        cfg: CurriculumCfg,
        *,
        control_dt_s: float,
        device: torch.device,
        ranks: Ranks = ALONE,
    ) -> None:
        self._cfg, self._ranks = cfg, ranks
        self._window = max(1, round(cfg.window_s / control_dt_s))
        self.share = torch.tensor(cfg.start, dtype=torch.float64, device=device)
        """[] of the configured ranges."""
        self._sum, self._steps = torch.zeros_like(self.share), 0

    def range(self, full: tuple[float, float]) -> tuple[Tensor, Tensor]:
        """The part of the configured range `full` that is asked for now, each []."""
        slowest = min(max(0.0, full[0]), full[1])
        low, high = (slowest + self.share * (end - slowest) for end in full)
        return low, high

    def observe(self, features: Tensor) -> None:
        """Take note of how the commands of one step [N, F] were followed."""
        error = features[:, column("command")] - features[:, column("base_lin_vel_b")]
        square = error[:, :2].square().sum(dim=-1)
        self._sum = self._sum + torch.exp(-square / 0.25).mean()
        self._steps += 1
        if self._steps < self._window:
            return
        followed = self._ranks.mean(self._sum / self._steps)
        wider = (self.share + self._cfg.widen).clamp(max=self._cfg.end)
        self.share = torch.where(followed >= self._cfg.good, wider, self.share)
        self._sum, self._steps = torch.zeros_like(self._sum), 0

    def snapshot(self) -> Tensor:
        """All state [3], to go on from."""
        steps = self.share.new_tensor(self._steps)
        return torch.stack([self.share, self._sum, steps])

    def restore(self, snapshot: Tensor) -> None:
        """Go on from `snapshot`."""
        self.share, self._sum, steps = snapshot.to(self.share.device).unbind()
        self._steps = int(steps)
