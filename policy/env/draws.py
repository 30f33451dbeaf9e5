"""Uniform draws of an environment, several at once.

Shapes: K rows.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .env_cfg import Range

Bounds = Range | tuple[Tensor, Tensor]
"""A range whose ends may depend on how far a curriculum has come."""


def uniforms(
    rng: torch.Generator, rows: int, *parts: tuple[int, Bounds]
) -> list[Tensor]:
    """Draws [K, width] for each (width, bounds), on the device of `rng`, made at once:
    on a GPU every call costs."""
    sizes = [rows * width for width, _ in parts]
    units = torch.rand(sum(sizes), generator=rng, device=rng.device)
    return [
        low + (high - low) * unit.view(rows, width)
        for unit, (width, (low, high)) in zip(units.split(sizes), parts, strict=True)
    ]


def around_zero(amplitude: float) -> Range:
    """From `-amplitude` to `amplitude`."""
    return -amplitude, amplitude
