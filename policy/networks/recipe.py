"""A feed-forward network of others as a list of operations, and torch that follows it.

Operations are those of ONNX, of which a few suffice. A recipe is plain values: nothing
that a stranger's file says is executed, an operation that is not in the table is
refused by name. Following it in torch, its weights can be trained on.

Shapes: N observations, D numbers of one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import torch
from torch import Tensor, nn

from data.errors import GaitprefError

INPUT = "obs"
MOST_NODES = 2000
MOST_NUMBERS = 50_000_000
"""Weights of a network that is taken: 200 MB."""


class NetworkError(GaitprefError):
    """A network that cannot be brought in."""


@dataclass(frozen=True, kw_only=True)
class Node:
    """One operation."""

    op: str
    inputs: tuple[str, ...]
    """Names of values; an empty one is left out."""
    output: str
    attributes: dict[str, Any] = field(default_factory=dict)
    """Numbers and lists of numbers by name."""


@dataclass(frozen=True, kw_only=True)
class Stored:
    """A tensor of a network, whose numbers are kept beside the recipe."""

    name: str
    """As its file calls it."""
    shape: tuple[int, ...]
    dtype: Literal["float32", "int64", "bool"] = "float32"

    @property
    def numbers(self) -> int:
        """How many it has."""
        return math.prod(self.shape)

    def zeros(self) -> Tensor:
        """A tensor to load the numbers into."""
        return torch.zeros(self.shape, dtype=getattr(torch, self.dtype))


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How observations become actions."""

    obs_dim: int
    """Numbers of an observation."""
    nodes: tuple[Node, ...]
    """In the order in which they are computed."""
    output: str
    """Name of the actions."""
    weights: tuple[Stored, ...]
    """The tensors that training changes."""
    constants: tuple[Stored, ...] = ()
    """The tensors that stay as they are, as a normaliser's."""
    action_order: tuple[int, ...]
    """[12] where each joint of ours is among the actions."""

    def __post_init__(self) -> None:
        if len(self.nodes) > MOST_NODES:
            raise NetworkError(f"a network of {len(self.nodes)} operations is too long")
        if sorted(self.action_order) != list(range(12)):
            raise NetworkError("action_order must be an order of 12 joints")
        stored = (*self.weights, *self.constants)
        if any(size < 0 for each in stored for size in each.shape):
            raise NetworkError("a size of a tensor is negative")
        if sum(each.numbers for each in stored) > MOST_NUMBERS:
            raise NetworkError(f"a network has more than {MOST_NUMBERS:,} numbers")
        known = {INPUT, "", *(each.name for each in stored)}
        for node in self.nodes:
            require_known(node.op)
            if missing := [name for name in node.inputs if name not in known]:
                raise NetworkError(
                    f"operation {node.op} uses {missing[0][:60]!r}, which nothing gives"
                )
            known.add(node.output)
        if self.output not in known:
            raise NetworkError(f"nothing gives the actions {self.output[:60]!r}")


class RecipeNetwork(nn.Module):
    """Observations [N, D] to actions [N, 12] in our order of the joints."""

    def __init__(self, recipe: Recipe) -> None:
        """Its weights are zeros, to be loaded."""
        super().__init__()
        self.recipe = recipe
        self._names: dict[str, str] = {}
        for kind, tensors in (("w", recipe.weights), ("c", recipe.constants)):
            for index, stored in enumerate(tensors):
                key = self._names[stored.name] = f"{kind}{index}"
                if kind == "w":
                    self.register_parameter(key, nn.Parameter(stored.zeros()))
                else:
                    self.register_buffer(key, stored.zeros())
        order = torch.tensor(recipe.action_order)
        self.register_buffer("order", order, persistent=False)

    def fill(self, tensors: Mapping[str, Tensor]) -> None:
        """Take weights and constants by the names of their file."""
        state = {key: tensors[name] for name, key in self._names.items()}
        self.load_state_dict(state)

    def tensors(self) -> dict[str, Tensor]:
        """Weights and constants by the names of their file."""
        state = self.state_dict()
        return {name: state[key] for name, key in self._names.items()}

    def forward(self, obs: Tensor) -> Tensor:
        """See the class."""
        return self.followed(obs)[self.recipe.output].index_select(1, self.order)

    def followed(self, obs: Tensor) -> dict[str, Any]:
        """All that is stored and computed, by its name."""
        values: dict[str, Any] = {INPUT: obs, "": None}
        for name, key in self._names.items():
            values[name] = getattr(self, key)
        for node in self.recipe.nodes:
            given = [values[name] for name in node.inputs]
            values[node.output] = _OPS[node.op](node.attributes, *given)
        return values


def require_known(op: str) -> None:
    """Refuse an operation that is not in the table.

    Raises:
        NetworkError: it is not; recurrent and looking ones are named.
    """
    if op in _OPS:
        return
    kinds = {"LSTM": "recurrent", "GRU": "recurrent", "RNN": "recurrent"}
    kinds |= {"Loop": "recurrent", "Scan": "recurrent"}
    kinds |= {"Conv": "a network that looks at pictures", "MaxPool": "one that looks"}
    if op in kinds:
        raise NetworkError(
            f"the network is {kinds[op]} (operation {op}), and only feed-forward "
            "networks of proprioception can be brought in"
        )
    raise NetworkError(
        f"the network has the operation {op[:40]}, which is not followed here; those "
        f"that are: {', '.join(sorted(_OPS))}"
    )


def _ints(value: Any) -> list[int]:
    if isinstance(value, Tensor):
        return [int(v) for v in value.flatten().tolist()]
    return [int(v) for v in (value if isinstance(value, list | tuple) else [value])]


def _gemm(at: dict[str, Any], a: Tensor, b: Tensor, c: Tensor | None = None) -> Tensor:
    a = a.transpose(0, 1) if at.get("transA") else a
    if at.get("alpha", 1.0) == at.get("beta", 1.0) == 1.0 and (
        c is None or c.ndim == 1
    ):
        return nn.functional.linear(a, b if at.get("transB") else b.t(), c)
    b = b.t() if at.get("transB") else b
    product = at.get("alpha", 1.0) * (a @ b)
    return product if c is None else product + at.get("beta", 1.0) * c


def _slice(
    at: dict[str, Any],
    x: Tensor,
    starts: Any = None,
    ends: Any = None,
    axes: Any = None,
    steps: Any = None,
) -> Tensor:
    begin = _ints(at["starts"] if starts is None else starts)
    end = _ints(at["ends"] if ends is None else ends)
    axes = at.get("axes") if axes is None else axes
    along = list(range(len(begin))) if axes is None else _ints(axes)
    steps = at.get("steps") if steps is None else steps
    stride = [1] * len(begin) if steps is None else _ints(steps)
    cut: list[slice] = [slice(None)] * x.ndim
    for axis, first, last, step in zip(along, begin, end, stride, strict=True):
        if step < 1:
            raise NetworkError("a slice that runs backwards is not followed here")
        cut[axis] = slice(first, last, step)
    return x[tuple(cut)]


def _gather(at: dict[str, Any], x: Tensor, idx: Tensor | None = None) -> Tensor:
    axis = at.get("axis", 0)
    if idx is None:
        return x.select(axis, int(at["index"]))
    if idx.ndim == 0:
        return x.select(axis, int(idx))
    return x.index_select(axis, idx if idx.ndim == 1 else idx.flatten())


def _reshape(at: dict[str, Any], x: Tensor, shape: Any = None) -> Tensor:
    sizes = _ints(at["shape"] if shape is None else shape)
    # A network exported for one observation says 1 where there are N.
    if sizes and sizes[0] == 1 and x.ndim > 1:
        sizes[0] = x.shape[0]
    return x.reshape([x.shape[i] if s == 0 else s for i, s in enumerate(sizes)])


def _axes(at: dict[str, Any], axes: Any) -> list[int]:
    found = at.get("axes") if axes is None else axes
    return [] if found is None else _ints(found)


def _unsqueeze(at: dict[str, Any], x: Tensor, axes: Any = None) -> Tensor:
    for axis in sorted(_axes(at, axes)):
        x = x.unsqueeze(axis)
    return x


def _squeeze(at: dict[str, Any], x: Tensor, axes: Any = None) -> Tensor:
    for axis in sorted(_axes(at, axes), reverse=True):
        x = x.squeeze(axis)
    return x


def _reduced(name: str) -> Callable[..., Tensor]:
    def reduce(at: dict[str, Any], x: Tensor, axes: Any = None) -> Tensor:
        dims = _axes(at, axes) or list(range(x.ndim))
        keep = bool(at.get("keepdims", 1))
        if name == "norm":
            return torch.linalg.vector_norm(x, dim=dims, keepdim=keep)
        return getattr(x, name)(dim=dims, keepdim=keep)

    return reduce


def _clip(at: dict[str, Any], x: Tensor, low: Any = None, high: Any = None) -> Tensor:
    low = at.get("min") if low is None else low
    high = at.get("max") if high is None else high
    return x if low is None and high is None else x.clamp(low, high)


def _expand(at: dict[str, Any], x: Tensor, size: Any = None) -> Tensor:
    if size is None:
        return x.expand(_ints(at["shape"]))
    return x.expand(torch.broadcast_shapes(x.shape, _ints(size)))


def _of_one(function: Callable[[Tensor], Tensor]) -> Callable[..., Any]:
    return lambda at, x: function(x)


def _of_two(function: Callable[[Tensor, Tensor], Tensor]) -> Callable[..., Any]:
    return lambda at, a, b: function(a, b)


_F = nn.functional


def _divided(a: Tensor, b: Tensor) -> Tensor:
    whole = not (a.is_floating_point() or b.is_floating_point())
    return torch.div(a, b, rounding_mode="trunc" if whole else None)


_OPS: dict[str, Callable[..., Any]] = {
    "Gemm": _gemm,
    "MatMul": _of_two(torch.matmul),
    "Add": _of_two(torch.add),
    "Sub": _of_two(torch.sub),
    "Mul": _of_two(torch.mul),
    "Div": _of_two(_divided),
    "Max": _of_two(torch.maximum),
    "Min": _of_two(torch.minimum),
    "Elu": lambda at, x: _F.elu(x, at.get("alpha", 1.0)),
    "Relu": _of_one(_F.relu),
    "LeakyRelu": lambda at, x: _F.leaky_relu(x, at.get("alpha", 0.01)),
    "Selu": _of_one(_F.selu),
    "Silu": _of_one(_F.silu),
    "Mish": _of_one(_F.mish),
    "Gelu": lambda at, x: _F.gelu(x, approximate=at.get("approximate", "none")),
    "Softplus": lambda at, x: _F.softplus(
        x, at.get("beta", 1.0), at.get("threshold", 20.0)
    ),
    "Tanh": _of_one(torch.tanh),
    "Sigmoid": _of_one(torch.sigmoid),
    "Softmax": lambda at, x: x.softmax(at.get("axis", -1)),
    "Sqrt": _of_one(torch.sqrt),
    "Exp": _of_one(torch.exp),
    "Erf": _of_one(torch.erf),
    "Pow": _of_two(torch.pow),
    "Neg": _of_one(torch.neg),
    "Identity": _of_one(lambda x: x),
    "Dropout": lambda at, x, *rest: x,
    "Clip": _clip,
    "Concat": lambda at, *xs: torch.cat(xs, dim=at.get("axis", 0)),
    "Slice": _slice,
    "Gather": _gather,
    "Reshape": _reshape,
    "Flatten": lambda at, x: x.flatten(at.get("axis", 1)),
    "Transpose": lambda at, x: x.permute(_ints(at["perm"])),
    "Unsqueeze": _unsqueeze,
    "Squeeze": _squeeze,
    "Expand": _expand,
    "ReduceSum": _reduced("sum"),
    "ReduceMean": _reduced("mean"),
    "ReduceL2": _reduced("norm"),
    "Shape": lambda at, x: torch.tensor(x.shape[at.get("start", 0) : at.get("end")]),
    "NonZero": _of_one(lambda x: x.nonzero().t()),
    "Cast": lambda at, x: x.to(_DTYPES[int(at["to"])]),
    "LayerNormalization": lambda at, x, w, b=None: _F.layer_norm(
        x, x.shape[int(at.get("axis", -1)) :], w, b, at.get("epsilon", 1e-5)
    ),
}
"""The operations that are followed, with their attributes first."""

_DTYPES = {1: torch.float32, 6: torch.int64, 7: torch.int64, 9: torch.bool}
"""What ONNX calls 1, 6, 7 and 9."""
