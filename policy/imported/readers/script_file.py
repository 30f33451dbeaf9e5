"""Networks in TorchScript: the graph is read as a recipe, the module is never run."""

from __future__ import annotations

import io
import warnings
import zipfile
from typing import Any

import torch
from torch import Tensor

from policy.networks.recipe import INPUT, MOST_NUMBERS, NetworkError, Node

from .found import Found, plain_tensor, recipe_of
from .script_operations import operation_of

_MOST_BYTES = 512 * 2**20
_PASSED = frozenset(
    {
        "aten::contiguous",
        "aten::detach",
        "aten::clone",
        "aten::dropout",
        "aten::expand_as",
        "aten::to",
        "aten::alias",
        "prim::unchecked_cast",
        "prim::unchecked_unwrap_optional",
    }
)
"""What leaves its first argument as it is."""
_SILENT = frozenset({"prim::RaiseException", "aten::warn", "prim::Print"})
_RECURRENT = frozenset(
    {
        "aten::lstm",
        "aten::gru",
        "aten::rnn_tanh",
        "aten::rnn_relu",
        "aten::lstm_cell",
        "aten::gru_cell",
        "aten::copy_",
        "prim::SetAttr",
        "prim::Loop",
    }
)


def read_script(content: bytes) -> Found:
    """The network of a TorchScript file, scripted or traced.

    Raises:
        NetworkError: it cannot be followed; what it is is named first.
    """
    _require_harmless(content)
    with warnings.catch_warnings():
        # TorchScript is deprecated, and what robots run.
        warnings.simplefilter("ignore")
        try:
            module = torch.jit.load(io.BytesIO(content), map_location="cpu")
            graph = module.inlined_graph
        except Exception as error:
            raise NetworkError(
                f"torch cannot read it as TorchScript ({type(error).__name__})"
            ) from None
        return _Translation(module, graph).found()


def _require_harmless(content: bytes) -> None:
    """Refuse what would run, or unpack to more than is taken, before it is loaded."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > _MOST_BYTES:
                raise NetworkError("it unpacks to more than 512 MB")
            for member in members:
                if member.filename.endswith(".py") and (
                    b"__setstate__" in archive.read(member)
                ):
                    raise NetworkError(
                        f"{member.filename[-60:]} in it runs code when it is loaded "
                        "(__setstate__)"
                    )
    except (zipfile.BadZipFile, NotImplementedError, EOFError, OSError) as error:
        raise NetworkError(f"it is a damaged archive ({error})") from None


def _refuse_by_name(block: Any) -> None:
    """Say first what a network is that is not taken, wherever in it that shows.

    Raises:
        NetworkError: it is recurrent.
    """
    for node in block.nodes():
        if node.kind() in _RECURRENT:
            raise NetworkError(
                f"the network is recurrent, or keeps what it saw ({node.kind()}), and "
                "only feed-forward networks of proprioception can be brought in"
            )
        for inner in node.blocks():
            _refuse_by_name(inner)


class _Part:
    """A module inside the file, by its path."""

    def __init__(self, module: Any, path: str) -> None:
        self.module, self.path = module, path


class _Value:
    """A tensor that the recipe computes or stores, by its name."""

    def __init__(self, name: str) -> None:
        self.name = name


class _Translation:
    """One walk along a graph. What is known beforehand is Python's own value."""

    def __init__(self, module: Any, graph: Any) -> None:
        self._nodes: list[Node] = []
        self._tensors: dict[str, Tensor] = {}
        self._values: dict[str, Any] = {}
        inputs = list(graph.inputs())
        if len(inputs) != 2:
            names = ", ".join(each.debugName() for each in inputs[1:])[:200]
            raise NetworkError(
                f"it takes {len(inputs) - 1} inputs ({names}), a policy takes one"
            )
        self._values[inputs[0].debugName()] = _Part(module._c, "")
        self._values[inputs[1].debugName()] = _Value(INPUT)
        _refuse_by_name(graph)
        self._walk(graph)
        self._output = self._values[next(iter(graph.outputs())).debugName()]
        if isinstance(self._output, list):
            self._output = self._output[0]

    def found(self) -> Found:
        """The network."""
        if not isinstance(self._output, _Value):
            raise NetworkError("its output is no tensor")
        recipe = recipe_of(
            self._nodes, self._output.name, self._obs_dim(), self._tensors
        )
        return Found(kind="TorchScript", recipe=recipe, tensors=self._tensors)

    def _obs_dim(self) -> int:
        """Width of the observations: what the first layer behind them takes, else where
        the last of the slices ends that they are cut into."""
        same, last = {INPUT}, 0
        shapes = {name: tuple(each.shape) for name, each in self._tensors.items()}
        for node in self._nodes:
            if node.op == "Transpose" and node.inputs[0] in shapes:
                shapes[node.output] = shapes[node.inputs[0]][::-1]
            if node.op in ("Gemm", "MatMul") and node.inputs[0] in same:
                weight = shapes.get(node.inputs[1], ())
                if len(weight) == 2:
                    return weight[1 if node.attributes.get("transB") else 0]
            if node.op in ("Sub", "Div", "Clip", "Identity") and node.inputs[0] in same:
                other = self._tensors.get(node.inputs[-1])
                if other is not None and other.ndim and other.shape[-1] > 1:
                    return int(other.shape[-1])
                same.add(node.output)
            along = node.attributes.get("axes")
            if node.op == "Slice" and along in ([1], [-1]) and node.inputs[0] in same:
                last = max(last, *node.attributes["ends"])
        if 0 < last <= MOST_NUMBERS:
            return last
        raise NetworkError("it does not say how many numbers an observation has")

    def _walk(self, block: Any) -> None:
        for node in block.nodes():
            if len(self._nodes) > 5000:
                raise NetworkError("its graph is too long")
            given = [self._values.get(v.debugName()) for v in node.inputs()]
            kind = node.kind()
            if kind == "prim::If":
                taken = list(node.blocks())[0 if given[0] is True else 1]
                if not isinstance(given[0], bool):
                    raise NetworkError(
                        "it decides by what it computes, which is not followed here"
                    )
                self._walk(taken)
                results = [self._values.get(v.debugName()) for v in taken.outputs()]
                for out, value in zip(node.outputs(), results, strict=True):
                    self._values[out.debugName()] = value
                continue
            if kind in _SILENT:
                continue
            self._values[node.output().debugName()] = self._value(node, kind, given)

    def _value(self, node: Any, kind: str, given: list[Any]) -> Any:
        if kind == "prim::Constant":
            return self._literal(node)
        if kind == "prim::GetAttr":
            return self._attribute(given[0], node.s("name"))
        if kind in ("prim::ListConstruct", "prim::TupleConstruct"):
            return list(given)
        if kind in _PASSED:
            return given[0]
        if kind in _KNOWN:
            return _KNOWN[kind](given)
        op, values, attributes = operation_of(kind, given)
        return self._add(op, values, attributes)

    def _literal(self, node: Any) -> Any:
        try:
            value = node.output().toIValue()
        except RuntimeError:
            # A function, which was inlined.
            return None
        if isinstance(value, Tensor):
            return self._store(f"constant {len(self._tensors)}", value)
        return value

    def _attribute(self, part: Any, name: str) -> Any:
        if not isinstance(part, _Part):
            raise NetworkError(f"it looks up {name[:40]!r} in what is no module")
        path = f"{part.path}{name}"
        value = part.module.getattr(name)
        if isinstance(value, Tensor):
            return self._store(path, value)
        if isinstance(value, bool | int | float | str | list | tuple | None):
            return value
        return _Part(value, f"{path}.")

    def _store(self, name: str, value: Tensor) -> _Value:
        self._tensors[name] = plain_tensor(name, value)
        return _Value(name)

    def _name(self, value: Any) -> str:
        """The name of a tensor, stored first where it is known beforehand."""
        if isinstance(value, _Value):
            return value.name
        if isinstance(value, Tensor):
            return self._store(f"index {value.tolist()}", value).name
        if isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
            return self._store(f"number {number!r}", torch.tensor(number)).name
        raise NetworkError("an operation gets something that is no tensor")

    def _add(self, op: str, values: list[Any], attributes: dict[str, Any]) -> _Value:
        output = f"value {len(self._nodes)}"
        names = tuple(self._name(value) for value in values)
        self._nodes.append(
            Node(op=op, inputs=names, output=output, attributes=attributes)
        )
        return _Value(output)


_KNOWN: dict[str, Any] = {
    "aten::__is__": lambda given: given[0] is given[1],
    "aten::__isnot__": lambda given: given[0] is not given[1],
    "aten::__not__": lambda given: not given[0],
    "aten::eq": lambda given: given[0] == given[1],
    "aten::ne": lambda given: given[0] != given[1],
    "aten::dim": lambda given: 2,
    "aten::len": lambda given: len(given[0]),
}
"""What is known without observations: these have two axes."""
