"""A network's whole numbers, which no observation changes, as numbers in its recipe.

ONNX hands bounds, shapes and axes from operation to operation like any tensor; torch's
exporters follow nothing whose shape depends on what a tensor holds.

Shapes: N observations, D numbers of one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from .recipe import INPUT, Node, Recipe, RecipeNetwork, Stored

_FEW, _MANY = 3, 5
"""Observations it is followed with: what differs between them hangs on N."""
_NUMBERS = {
    "Slice": ("starts", "ends", "axes", "steps"),
    "Unsqueeze": ("axes",),
    "Squeeze": ("axes",),
    "ReduceSum": ("axes",),
    "ReduceMean": ("axes",),
    "ReduceL2": ("axes",),
}
"""What operations take in whole numbers behind their first tensor."""


def settled(network: RecipeNetwork) -> RecipeNetwork:
    """`network` with attributes in the place of the whole numbers it would compute.

    It gives the same actions, and keeps its weights by their names. What hangs on an
    observation, or on N in a way that no attribute says, stays as it is.
    """
    recipe, tensors = network.recipe, network.tensors()
    outputs = [node.output for node in recipe.nodes]
    if len({INPUT, "", *tensors, *outputs}) < 2 + len(tensors) + len(outputs):
        # One name means two values: which is meant is not looked into.
        return network
    obs = [torch.zeros(count, recipe.obs_dim) for count in (_FEW, _MANY)]
    with torch.no_grad():
        trial = _Trial(recipe, *(network.followed(each) for each in obs))
    nodes, fixed, used = [], dict[str, Tensor](), {recipe.output}
    for node in reversed(recipe.nodes):
        if node.output not in used:
            continue
        if (value := trial.fixed(node.output)) is not None:
            fixed[node.output] = value
            continue
        nodes.append(trial.settled(node))
        used |= {*nodes[-1].inputs}
    constants = [each for each in recipe.constants if each.name in used]
    constants += [
        Stored(
            name=name,
            shape=tuple(value.shape),
            dtype="bool" if value.dtype is torch.bool else "int64",
        )
        for name, value in fixed.items()
    ]
    made = RecipeNetwork(
        replace(recipe, nodes=tuple(reversed(nodes)), constants=tuple(constants))
    )
    made.fill({**tensors, **fixed})
    return made.eval()


class _Trial:
    """What a network computed of a few observations, and of more."""

    def __init__(
        self, recipe: Recipe, few: dict[str, Any], many: dict[str, Any]
    ) -> None:
        self._few, self._many = few, many
        self._stored = {each.name for each in recipe.constants}
        self._free = {*self._stored, ""}
        for node in recipe.nodes:
            if node.op == "Shape" or {*node.inputs} <= self._free:
                self._free.add(node.output)

    def fixed(self, name: str) -> Tensor | None:
        """Whole numbers that neither an observation nor N changes."""
        few, many = self._few[name], self._many[name]
        if name not in self._free or few is None or few.is_floating_point():
            return None
        return few if torch.equal(few, many) else None

    def settled(self, node: Node) -> Node:
        """`node`, with attributes for what it takes in whole numbers."""
        told = None
        if node.op in _NUMBERS:
            told = self._numbers(node)
        elif node.op == "Gather":
            told = self._index(node)
        elif node.op == "Clip":
            told = self._bounds(node)
        elif node.op in ("Reshape", "Expand") and len(node.inputs) == 2:
            told = self._sizes(node)
        if told is None:
            return node
        attributes = {**node.attributes, **told}
        return replace(node, inputs=node.inputs[:1], attributes=attributes)

    def _numbers(self, node: Node) -> dict[str, Any] | None:
        given = zip(_NUMBERS[node.op], node.inputs[1:], strict=False)
        found = {word: self.fixed(name) for word, name in given if name}
        if any(value is None for value in found.values()):
            return None
        return {
            word: value.flatten().tolist()
            for word, value in found.items()
            if value is not None
        }

    def _index(self, node: Node) -> dict[str, Any] | None:
        one = self.fixed(node.inputs[-1])
        return None if one is None or one.ndim else {"index": one.item()}

    def _bounds(self, node: Node) -> dict[str, Any] | None:
        given = zip(("min", "max"), node.inputs[1:], strict=False)
        found = {word: self._few[name] for word, name in given if name}
        stored = {*node.inputs[1:]} <= self._stored | {""}
        if not stored or any(value.numel() != 1 for value in found.values()):
            return None
        return {word: value.item() for word, value in found.items()}

    def _sizes(self, node: Node) -> dict[str, Any] | None:
        """Sizes by what came of it; -1 is one that follows N."""
        few, many = self._few[node.output].shape, self._many[node.output].shape
        sizes = [a if a == b else -1 for a, b in zip(few, many, strict=True)]
        if node.op == "Reshape":
            fits = sizes.count(-1) < 2 and 0 not in sizes
        else:
            # From behind: what is expanded may have fewer axes.
            given = [self._few[node.inputs[0]].shape, self._many[node.inputs[0]].shape]
            same = zip(*(shape[::-1] for shape in (*given, few, many)), strict=False)
            keeps = [a == c and b == d for a, b, c, d in same][::-1]
            keeps = [False] * (len(sizes) - len(keeps)) + keeps
            fits = all(
                kept or size > 0 for kept, size in zip(keeps, sizes, strict=True)
            )
        return {"shape": sizes} if fits else None
