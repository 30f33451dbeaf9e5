"""Networks in ONNX, read as a recipe; nothing runs them but torch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from policy.networks.recipe import (
    INPUT,
    MOST_NODES,
    NetworkError,
    Node,
    require_known,
)

from .found import Found, plain_tensor, recipe_of
from .onnx_weights import put_inside

_FLOAT_ATTRIBUTES, _INT_ATTRIBUTES, _TEXT = {1, 6}, {2, 7}, {3}
_FLOATS = (1, 10, 11, 16)
"""Types of ONNX that are numbers with a fraction."""


def read_onnx(content: bytes, folder: Path | None = None) -> Found:
    """The network of an ONNX file.

    Args:
        content: What is in the file.
        folder: Where it lies, with weights in a file beside it.

    Raises:
        NetworkError: it cannot be followed; what it is is named first.
    """
    onnx, model = loaded(content, folder)
    graph = model.graph
    if len(graph.node) > MOST_NODES:
        raise NetworkError(f"a network of {len(graph.node)} operations is too long")
    tensors = {each.name: _tensor(each.name, each, onnx) for each in graph.initializer}
    name, obs_dim = _input(graph, tensors)
    for node in graph.node:
        if node.op_type != "Constant":
            require_known(node.op_type)
        if not node.output:
            raise NetworkError(
                f"its operation {node.op_type} has no output, each has one or more: "
                "export the network anew"
            )
    nodes: list[Node] = []
    for node in graph.node:
        if node.op_type == "Constant":
            tensors[node.output[0]] = _constant(node, onnx)
            continue
        nodes.append(
            Node(
                op=node.op_type,
                inputs=tuple(INPUT if n == name else n for n in node.input),
                output=node.output[0],
                attributes=_attributes(node, onnx),
            )
        )
    used = {n for node in nodes for n in node.inputs}
    tensors = {n: t for n, t in tensors.items() if n in used}
    recipe = recipe_of(nodes, _output(graph), obs_dim, tensors)
    metadata = {prop.key: prop.value for prop in model.metadata_props}
    return Found(kind="ONNX", recipe=recipe, tensors=tensors, metadata=metadata)


def loaded(content: bytes, folder: Path | None = None) -> tuple[Any, Any]:
    """The package and the model in `content`, with all weights inside.

    Raises:
        NetworkError: it is none, or its weights are not where they may be.
    """
    try:
        import onnx
    except ModuleNotFoundError:
        raise NetworkError(
            "reading ONNX needs the package onnx, which is not installed: pip install "
            "-e '.[onnx]' -c constraints.txt"
        ) from None
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:
        raise NetworkError(f"it is no ONNX model ({type(error).__name__})") from None
    put_inside(model, onnx, folder)
    return onnx, model


def _tensor(name: str, proto: Any, onnx: Any) -> Tensor:
    try:
        array = np.array(onnx.numpy_helper.to_array(proto))
    except Exception as error:
        raise NetworkError(f"{name[:60]} is damaged ({type(error).__name__})") from None
    return plain_tensor(name, torch.from_numpy(array))


def _constant(node: Any, onnx: Any) -> Tensor:
    for attribute in node.attribute:
        if attribute.name == "value":
            return _tensor(node.output[0], attribute.t, onnx)
        value = onnx.helper.get_attribute_value(attribute)
        if isinstance(value, int | float) or (
            isinstance(value, list) and all(isinstance(v, int | float) for v in value)
        ):
            return plain_tensor(node.output[0], torch.tensor(value))
    raise NetworkError(f"the constant {node.output[0][:60]} holds no numbers")


def _attributes(node: Any, onnx: Any) -> dict[str, Any]:
    found = {}
    for attribute in node.attribute:
        value = onnx.helper.get_attribute_value(attribute)
        if attribute.type in _INT_ATTRIBUTES | _FLOAT_ATTRIBUTES:
            plain = isinstance(value, int | float)
            found[attribute.name] = value if plain else [*value]
        elif attribute.type in _TEXT:
            found[attribute.name] = value.decode(errors="replace")[:40]
        else:
            raise NetworkError(
                f"the operation {node.op_type} has {attribute.name!r}, which is no "
                "number"
            )
    return found


def _input(graph: Any, tensors: dict[str, Tensor]) -> tuple[str, int]:
    """Name and width of the observations."""
    given = [each for each in graph.input if each.name not in tensors]
    names = [each.name for each in given]
    told = ", ".join(names)[:200]
    if recurrent := [n for n in names if n.startswith(("h_", "c_", "hidden", "cell"))]:
        raise NetworkError(
            f"the network is recurrent (input {recurrent[0][:40]}), and only "
            "feed-forward networks of proprioception can be brought in"
        )
    if len(given) != 1:
        raise NetworkError(
            f"it takes {len(given)} inputs ({told}), a policy takes one; one that "
            "remembers, as among gaits, is brought in by what it was made of"
        )
    kind = given[0].type.tensor_type
    sizes = [each.dim_value for each in kind.shape.dim]
    if len(sizes) > 2:
        raise NetworkError(
            f"its input {told} is {sizes}: pictures and height maps are not taken"
        )
    if len(sizes) != 2 or sizes[1] < 1 or kind.elem_type not in _FLOATS:
        raise NetworkError(
            f"its input {told} must be [N, D] of numbers, got {sizes} (0 is open): "
            "export it with the width of the observations fixed"
        )
    return names[0], int(sizes[1])


def _output(graph: Any) -> str:
    """The output that is the actions: by its name, else the first."""
    names = [each.name for each in graph.output]
    for name in ("actions", "action", "continuous_actions"):
        if name in names:
            return name
    if not names:
        raise NetworkError("it has no output")
    return names[0]
