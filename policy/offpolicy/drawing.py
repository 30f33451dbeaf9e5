"""Which remembered steps are learned from: all alike, or more often those the critics
err about.

By priority they are drawn in proportion (Schaul et al. 2016, arXiv 1511.05952). Adding
up 200,000 masses for every batch takes half of what a tree of their sums does, which
has to be kept as well.

Shapes: R rows of the ring, N columns, B steps of a batch.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .sac_cfg import PriorityCfg


def draw_evenly(count: int, usable: Tensor) -> Tensor:
    """Places [B] among `usable` [R, N], flat, from PyTorch's chance."""
    flat = usable.flatten()
    drawn = torch.randint(len(flat), (count,), device=flat.device)
    while not (good := flat[drawn]).all():
        again = torch.randint(len(flat), (count,), device=flat.device)
        drawn = torch.where(good, drawn, again)
    return drawn


class Priorities:
    """How likely each place of a ring is drawn."""

    def __init__(
        self, cfg: PriorityCfg, shape: tuple[int, int], device: str | torch.device
    ) -> None:
        self.cfg = cfg
        self.mass = torch.zeros(shape, device=device)
        """[R, N] priorities to the power of `alpha`; 0 where nothing is yet."""

    def raise_rows(self, rows: Tensor) -> None:
        """Let what was put into `rows` be drawn as likely as anything: of what is new
        nobody knows how wrong the critics are."""
        most = self.mass.max()
        self.mass[rows] = torch.where(most > 0, most, 1.0)

    def raise_all(self) -> None:
        """The same of all: under a new reward every error is another."""
        self.mass[self.mass > 0] = self.mass.max()

    def draw(self, count: int, usable: Tensor) -> tuple[Tensor, Tensor]:
        """Places [B] among `usable` [R, N], flat, from PyTorch's chance, and how much
        each counts [B] for being drawn more often than others; at most 1."""
        ends = (self.mass[: len(usable)] * usable).flatten().double().cumsum(dim=0)
        asked = torch.rand(count, dtype=ends.dtype, device=ends.device) * ends[-1]
        places = torch.searchsorted(ends, asked, right=True)
        rarity = self.mass.view(-1)[places] ** -self.cfg.beta
        return places, rarity / rarity.max()

    def learned(self, places: Tensor, errors: Tensor) -> None:
        """Take over how wrong the critics were, `errors` [B], about `places` [B]."""
        self.mass.view(-1)[places] = (errors + self.cfg.least) ** self.cfg.alpha
