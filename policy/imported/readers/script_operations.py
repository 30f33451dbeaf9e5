"""What operations of TorchScript are in a recipe."""

from __future__ import annotations

from typing import Any

import torch

from policy.networks.recipe import NetworkError

Operation = tuple[str, list[Any], dict[str, Any]]
"""Its name in a recipe, what it takes, and its attributes."""

_SAME = {
    "aten::relu": "Relu",
    "aten::relu_": "Relu",
    "aten::tanh": "Tanh",
    "aten::tanh_": "Tanh",
    "aten::sigmoid": "Sigmoid",
    "aten::silu": "Silu",
    "aten::silu_": "Silu",
    "aten::mish": "Mish",
    "aten::selu": "Selu",
    "aten::sqrt": "Sqrt",
    "aten::exp": "Exp",
    "aten::neg": "Neg",
    "aten::matmul": "MatMul",
    "aten::mm": "MatMul",
    "aten::mul": "Mul",
    "aten::div": "Div",
    "aten::minimum": "Min",
    "aten::maximum": "Max",
}
"""Operations that only are called otherwise, and take nothing but tensors."""
_OF_TWO = ("MatMul", "Mul", "Div", "Min", "Max")
_IN_PLACE = {
    f"{kind}_": kind
    for kind in (
        "aten::elu",
        "aten::leaky_relu",
        "aten::add",
        "aten::sub",
        "aten::clamp_min",
    )
}
_TO_THE_END = 2**31
"""Ends of slices from here on mean all there is."""


def operation_of(kind: str, given: list[Any]) -> Operation:
    """The operation of a recipe that does what `kind` does.

    Args:
        kind: As TorchScript calls it.
        given: Its arguments: tensors of the recipe, and Python's own values.

    Raises:
        NetworkError: none does.
    """
    op = _SAME.get(kind)
    # What is given beyond the tensors changes the operation.
    if op and len(given) == (2 if op in _OF_TWO else 1):
        return op, given, {}
    plain = _IN_PLACE.get(kind, kind)
    for kinds in (_layer, _sum, _shaped, _part):
        if (found := kinds(plain, given)) is not None:
            return found
    if "conv" in kind or "pool" in kind:
        raise NetworkError(f"it looks at pictures ({kind}), which is not taken")
    raise NetworkError(f"it has the operation {kind[:40]}, not followed here")


def _layer(kind: str, given: list[Any]) -> Operation | None:
    """Layers and what stands between them."""
    match kind, given:
        case "aten::linear", [x, weight, bias]:
            layer = [x, weight] if bias is None else [x, weight, bias]
            return "Gemm", layer, {"transB": 1}
        case "aten::addmm", [bias, x, weight, beta, alpha]:
            how = {"alpha": float(alpha), "beta": float(beta)}
            return "Gemm", [x, weight, bias], how
        case "aten::layer_norm", [x, [_], weight, bias, float(eps), *_]:
            return "LayerNormalization", [x, weight, bias], {"epsilon": eps}
        case "aten::gelu", [x, *approximate]:
            return "Gelu", [x], {"approximate": approximate[0]} if approximate else {}
        case "aten::softplus", [x, beta, threshold]:
            return "Softplus", [x], {"beta": float(beta), "threshold": float(threshold)}
        case "aten::elu", [x, alpha, *_]:
            return "Elu", [x], {"alpha": float(alpha)}
        case "aten::leaky_relu", [x, slope]:
            return "LeakyRelu", [x], {"alpha": float(slope)}
        case "aten::softmax", [x, int(axis), *_]:
            return "Softmax", [x], {"axis": axis}
        case (("aten::clamp" | "aten::clip" | "aten::hardtanh"), [x, low, high]):
            return "Clip", [x], {"min": low, "max": high}
        case "aten::clamp_min", [x, low]:
            return "Clip", [x], {"min": low}
    return None


def _sum(kind: str, given: list[Any]) -> Operation | None:
    """Sums of two tensors, or along axes of one."""
    match kind, given:
        case "aten::add", [a, b, 1]:
            return "Add", [a, b], {}
        case "aten::sub", [a, b, 1]:
            return "Sub", [a, b], {}
        case "aten::div", [a, b, None]:
            return "Div", [a, b], {}
        case "aten::div", [_, _, str(rounding)]:
            raise NetworkError(
                f"it rounds where it divides ({rounding[:20]}), which is not followed "
                "here"
            )
        case (
            ("aten::norm" | "aten::linalg_vector_norm"),
            [x, 2 | 2.0, axes, keep, *_],
        ):
            return "ReduceL2", [x], {"axes": axes, "keepdims": int(keep)}
        case (("aten::sum" | "aten::mean"), [x, list(axes), keep, *_]):
            op = "ReduceSum" if kind == "aten::sum" else "ReduceMean"
            return op, [x], {"axes": axes, "keepdims": int(keep)}
    return None


def _shaped(kind: str, given: list[Any]) -> Operation | None:
    """The same numbers in another shape."""
    match kind, given:
        case "aten::t", [x]:
            return "Transpose", [x], {"perm": [1, 0]}
        case (("aten::view" | "aten::reshape"), [x, list(sizes)]):
            return "Reshape", [x], {"shape": sizes}
        case "aten::expand", [x, list(sizes), *_]:
            return "Expand", [x], {"shape": sizes}
        case "aten::permute", [x, list(axes)]:
            return "Transpose", [x], {"perm": axes}
        case "aten::unsqueeze", [x, int(axis)]:
            return "Unsqueeze", [x], {"axes": [axis]}
        case "aten::squeeze", [x, int(axis)]:
            return "Squeeze", [x], {"axes": [axis]}
        case "aten::flatten", [x, 1, -1]:
            return "Flatten", [x], {"axis": 1}
        case "aten::cat", [list(parts), int(axis)]:
            return "Concat", parts, {"axis": axis}
    return None


def _part(kind: str, given: list[Any]) -> Operation | None:
    """Some of the numbers."""
    match kind, given:
        case "aten::slice", [x, int(axis), first, last, 1]:
            first, last = first or 0, 2**62 if last is None else last
            if first == 0 and last > _TO_THE_END:
                return "Identity", [x], {}
            return "Slice", [x], {"starts": [first], "ends": [last], "axes": [axis]}
        case "aten::slice", _:
            raise NetworkError("a slice that leaves numbers out is not followed here")
        case "aten::narrow", [x, int(axis), int(first), int(length)]:
            cut = {"starts": [first], "ends": [first + length], "axes": [axis]}
            return "Slice", [x], cut
        case "aten::select", [x, int(axis), int(index)]:
            return "Gather", [x, torch.tensor(index)], {"axis": axis}
        case "aten::index_select", [x, int(axis), idx]:
            return "Gather", [x, idx], {"axis": axis}
    return None
