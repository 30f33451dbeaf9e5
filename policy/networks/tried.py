"""A network of a stranger is tried before it acts: what it makes is bounded.

Shapes: N observations, D numbers each.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map_only

from .recipe import MOST_NUMBERS, NetworkError, RecipeNetwork


def tried(network: RecipeNetwork, obs: Tensor) -> Tensor:
    """What `network` gives for `obs` [N, D].

    Raises:
        NetworkError: its operations do not fit, or make too much.
    """
    try:
        with torch.no_grad(), _Bounded():
            return network(obs)
    except NetworkError:
        raise
    except (
        RuntimeError,
        ValueError,
        TypeError,
        LookupError,
        ArithmeticError,
        AttributeError,
    ) as error:
        told = " ".join(str(error).split())[:160]
        raise NetworkError(
            f"its operations do not fit {len(obs)} observations of {obs.shape[1]} "
            f"numbers ({told})"
        ) from None


class _Bounded(TorchDispatchMode):
    """Adds up what operations make, and stops them before it is too much: a few can
    double their values until no memory holds them."""

    def __init__(self) -> None:
        super().__init__()
        self.numbers = 0

    def __torch_dispatch__(
        self, func: Any, types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        kwargs = kwargs or {}
        if not all(returned.alias_info for returned in func._schema.returns):
            self.numbers += _size(func, args, kwargs)
        if self.numbers > MOST_NUMBERS:
            raise NetworkError(
                f"its operations make more than {MOST_NUMBERS:,} numbers of a few "
                "observations: give a network of plain layers"
            )
        return func(*args, **kwargs)


def _size(func: Any, args: Any, kwargs: Any) -> int:
    """Numbers that an operation will make."""
    given = [each for each in tree_leaves((args, kwargs)) if isinstance(each, Tensor)]
    if not given:
        return 0
    args, kwargs = tree_map_only(Tensor, lambda t: t.to("meta"), (args, kwargs))
    try:
        made = tree_leaves(func(*args, **kwargs))
    except RuntimeError:
        # It depends on values, as where they are not 0 (all of them at most), or fails.
        return sum(each.numel() * max(1, each.ndim) for each in given)
    return sum(each.numel() for each in made if isinstance(each, Tensor))
