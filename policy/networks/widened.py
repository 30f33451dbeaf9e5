"""Networks that see more than they were trained with, and do not look at it yet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

_USUAL = 1.0
"""Deviation of what is seen, as a network that never saw it expects."""


def widened(state: Mapping[str, Any], seen: int, more: int) -> dict[str, Any]:
    """The state of RSL-RL's network that sees `seen` numbers, as one that sees `more`
    behind them, with weights of zero."""
    return {key: _widened(key, value, seen, more) for key, value in state.items()}


def _widened(key: str, value: Any, seen: int, more: int) -> Any:
    sees = key == "mlp.0.weight" or key.startswith("obs_normalizer.")
    if not (sees and isinstance(value, Tensor)) or value.shape[-1:] != (seen,):
        return value
    fill = _USUAL if key.endswith(("_var", "_std")) else 0.0
    extra = torch.full((len(value), more), fill, dtype=value.dtype)
    return torch.cat([value, extra], dim=-1)
