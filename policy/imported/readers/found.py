"""A network that was found in a file of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from data.files.weights import not_finite
from policy.networks.recipe import (
    MOST_NUMBERS,
    NetworkError,
    Node,
    Recipe,
    RecipeNetwork,
    Stored,
)
from policy.networks.settled import settled
from policy.networks.tried import tried

UNORDERED = tuple(range(12))
"""The order of actions before it is known which joint is which."""
_DTYPES = {torch.float32: "float32", torch.int64: "int64", torch.bool: "bool"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A network, as its file has it: joints in the order of the policy."""

    kind: str
    """What file it is from, in words."""
    recipe: Recipe
    tensors: Mapping[str, Tensor]
    """Weights and constants by their names."""
    std: Tensor | None = None
    """[12] exploration noise of the training, where the file has it."""
    metadata: Mapping[str, str] | None = None
    """What the file says of itself."""
    guessed: Mapping[str, str] | None = None
    """What the file leaves open, and what was taken."""

    def network(self, order: tuple[int, ...] = UNORDERED) -> RecipeNetwork:
        """The network, giving actions in `order`."""
        network = RecipeNetwork(replace(self.recipe, action_order=order))
        network.fill(self.tensors)
        return network.eval()


def plain_tensor(name: str, value: Tensor) -> Tensor:
    """`value` in one of the types a recipe has.

    Raises:
        NetworkError: it holds something else.
    """
    if value.is_floating_point():
        value = value.to(torch.float32)
    elif value.dtype in (torch.int32, torch.int16, torch.int8, torch.uint8):
        value = value.to(torch.int64)
    if value.dtype not in _DTYPES:
        raise NetworkError(f"{name[:60]} holds numbers of the type {value.dtype}")
    return value.detach().cpu().contiguous()


def stored(name: str, value: Tensor) -> Stored:
    """What a recipe says of a tensor."""
    dtype = _DTYPES[value.dtype]
    return Stored(name=name, shape=tuple(value.shape), dtype=dtype)  # type: ignore[arg-type]


def recipe_of(
    nodes: Sequence[Node], output: str, obs_dim: int, tensors: Mapping[str, Tensor]
) -> Recipe:
    """The recipe of `nodes`, which train what layers multiply by and add.

    Args:
        nodes: In the order in which they are computed.
        output: Name of the actions.
        obs_dim: Numbers of an observation.
        tensors: All that are stored; a normaliser's stay as they are.
    """
    trained: set[str] = set()
    products = {node.output for node in nodes if node.op == "MatMul"}
    for node in nodes:
        if node.op in ("Gemm", "LayerNormalization"):
            trained |= {*node.inputs[1:]}
        elif node.op in ("MatMul", "Transpose") or (
            node.op == "Add" and products & {*node.inputs}
        ):
            trained |= {*node.inputs}
    trained &= {name for name, each in tensors.items() if each.is_floating_point()}
    return Recipe(
        obs_dim=obs_dim,
        nodes=tuple(nodes),
        output=output,
        weights=tuple(stored(n, t) for n, t in tensors.items() if n in trained),
        constants=tuple(stored(n, t) for n, t in tensors.items() if n not in trained),
        action_order=UNORDERED,
    )


def checked(found: Found) -> Found:
    """`found`, which was tried on observations of zeros, its whole numbers settled.

    Raises:
        NetworkError: it gives no 12 finite actions.
    """
    if bad := not_finite(found.tensors):
        raise NetworkError(f"weights are no finite numbers: {bad}")
    if found.recipe.obs_dim > MOST_NUMBERS // 10:
        raise NetworkError(f"it takes {found.recipe.obs_dim:,} numbers, a policy few")
    network = found.network()
    for count in (1, 3):
        actions = tried(network, torch.zeros(count, found.recipe.obs_dim))
        if actions.shape != (count, 12) or not actions.isfinite().all():
            raise NetworkError(
                f"it gives {tuple(actions.shape)} actions for {count} observations "
                f"where a quadruped has 12 joints, or no finite ones"
            )
    network = settled(network)
    return replace(found, recipe=network.recipe, tensors=network.tensors())
