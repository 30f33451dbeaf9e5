"""Checkpoints of rsl_rl, versions 1 to 5: five layouts of one network.

| version | network | normaliser | noise |
|---|---|---|---|
| 1.x | model_state_dict: actor.N | - | std |
| 2.3 | as 1.x | obs_norm_state_dict | std, log_std |
| 3.x | as 1.x | actor_obs_normalizer in it | std, log_std |
| 4.x | actor_state_dict: mlp.N | obs_normalizer in it | std, log_std |
| 5.x | as 4.x | as 4.x | distribution.std_param, .log_std_param |
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from data.files.unpacking import require_stored
from policy.networks.recipe import INPUT, NetworkError, Node

from .found import Found, plain_tensor, recipe_of

_EPS = 1e-2
"""What rsl_rl adds to a deviation before it divides by it."""
ACTIVATIONS = {
    "elu": "Elu",
    "relu": "Relu",
    "selu": "Selu",
    "lrelu": "LeakyRelu",
    "tanh": "Tanh",
    "sigmoid": "Sigmoid",
    "silu": "Silu",
    "swish": "Silu",
    "gelu": "Gelu",
    "mish": "Mish",
    "softplus": "Softplus",
    "identity": "Identity",
}
"""What rsl_rl calls the functions between layers, and their operations."""


def read_checkpoint(content: bytes, activation: str | None) -> Found:
    """The actor of a checkpoint.

    Args:
        content: The file.
        activation: Between the layers, by the names of rsl_rl; a checkpoint does not
            say it. None takes ELU, which all training scripts known here use.

    Raises:
        NetworkError: there is none, or one that is no plain network.
    """
    payload = _payload(content)
    layout, states = _states(payload)
    _refuse_others(states)
    prefix = "actor" if any(n.startswith("actor.") for n in states) else "mlp"
    layers = _layers(states, prefix)
    normaliser = _normaliser(payload, states)
    named = normaliser | {name: states[name] for layer in layers for name in layer}
    tensors = {name: plain_tensor(name, value) for name, value in named.items()}
    nodes = _nodes(list(normaliser), layers, _operation(activation or "elu"))
    obs_dim = int(tensors[layers[0][0]].shape[1])
    return Found(
        kind=f"a checkpoint of rsl_rl {layout}",
        recipe=recipe_of(nodes, nodes[-1].output, obs_dim, tensors),
        tensors=tensors,
        std=_std(states),
        guessed={} if activation or len(layers) == 1 else {"activation": "elu"},
    )


def _payload(content: bytes) -> Mapping[str, Any]:
    try:
        require_stored(content)
        payload = torch.load(io.BytesIO(content), weights_only=True, map_location="cpu")
    except Exception as error:
        raise NetworkError(
            f"torch cannot read it without running code ({type(error).__name__}): "
            "save its state dictionaries alone, or export it as TorchScript or ONNX"
        ) from None
    if not isinstance(payload, Mapping):
        raise NetworkError(f"it holds a {type(payload).__name__}, no dictionaries")
    return payload


def _operation(activation: str) -> str:
    if activation not in ACTIVATIONS:
        raise NetworkError(
            f"the activation {activation[:40]!r} is not known; there are: "
            f"{', '.join(ACTIVATIONS)}"
        )
    return ACTIVATIONS[activation]


def _nodes(
    normaliser: list[str], layers: list[tuple[str, str]], activation: str
) -> list[Node]:
    """The layers by the names of their weights, behind the normaliser if any."""
    nodes: list[Node] = []
    if normaliser:
        mean, std, eps = normaliser
        nodes += [
            Node(op="Sub", inputs=(INPUT, mean), output="centred"),
            Node(op="Add", inputs=(std, eps), output="width"),
            Node(op="Div", inputs=("centred", "width"), output="normal"),
        ]
    for place, layer in enumerate(layers):
        if place:
            told = f"active {place - 1}"
            nodes.append(Node(op=activation, inputs=(nodes[-1].output,), output=told))
        at = nodes[-1].output if nodes else INPUT
        nodes.append(
            Node(
                op="Gemm",
                inputs=(at, *layer),
                output=f"layer {place}",
                attributes={"transB": 1},
            )
        )
    return nodes


def _states(payload: Mapping[str, Any]) -> tuple[str, dict[str, Tensor]]:
    if isinstance(model := payload.get("model_state_dict"), Mapping):
        layout, states = "1 to 3", dict(model)
    elif isinstance(actor := payload.get("actor_state_dict"), Mapping):
        layout, states = "4 or 5", dict(actor)
    else:
        named = ", ".join(sorted(map(str, payload))[:6])
        raise NetworkError(
            f"it has neither model_state_dict nor actor_state_dict, but {named[:200]}"
        )
    tensors = {
        str(name): value for name, value in states.items() if isinstance(value, Tensor)
    }
    return layout, tensors


def _refuse_others(states: Mapping[str, Tensor]) -> None:
    """Refuse what is more than layers one after the other, by its name."""
    kinds = {
        r"(^|\.)(memory|rnn|lstm|gru)": "recurrent",
        r"(^|[._])(cnn|conv)": "a network that looks at pictures",
        r"^(adaptation_module|estimator|history_encoder|encoder|student)\.": (
            "more than one network"
        ),
    }
    for name in states:
        for pattern, told in kinds.items():
            if re.search(pattern, name) and not name.startswith("critic"):
                raise NetworkError(
                    f"it is {told} ({name[:60]}), and a checkpoint does not say how "
                    "its parts are joined: recurrent nets and pictures are not taken; "
                    "others give as TorchScript or ONNX"
                )


def _layers(states: Mapping[str, Tensor], prefix: str) -> list[tuple[str, str]]:
    """Names of weight and bias of every layer, checked to follow one another."""
    pattern = re.compile(rf"^{prefix}\.(\d{{1,9}})\.weight$")
    numbers = sorted(int(m.group(1)) for name in states if (m := pattern.match(name)))
    layers = [(f"{prefix}.{n}.weight", f"{prefix}.{n}.bias") for n in numbers]
    if not layers:
        raise NetworkError(f"its actor has no layers {prefix}.N.weight")
    width = None
    for weight, bias in layers:
        w, b = states[weight], states.get(bias)
        if w.ndim != 2 or b is None or b.shape != w.shape[:1]:
            raise NetworkError(f"{weight} is no layer with a bias of its width")
        if width not in (None, w.shape[1]):
            raise NetworkError(f"{weight} takes {w.shape[1]} numbers and gets {width}")
        width = w.shape[0]
    if width != 12:
        raise NetworkError(f"its last layer gives {width} actions, a quadruped has 12")
    return layers


def _normaliser(
    payload: Mapping[str, Any], states: Mapping[str, Tensor]
) -> dict[str, Tensor]:
    """Mean and deviation of the observations by their names, and what is added to the
    deviation; nothing where there is no normaliser."""
    for prefix in ("actor_obs_normalizer.", "obs_normalizer."):
        mean, std = states.get(f"{prefix}_mean"), states.get(f"{prefix}_std")
        if mean is not None and std is not None:
            return _dividing(prefix, mean, std)
    older = payload.get("obs_norm_state_dict")
    if not isinstance(older, Mapping) or not isinstance(older.get("_mean"), Tensor):
        return {}
    if not isinstance(older.get("_std"), Tensor):
        raise NetworkError(
            "its obs_norm_state_dict has a _mean and no tensor _std: save both, or "
            "export the policy as TorchScript or ONNX"
        )
    return _dividing("obs_norm_state_dict/", older["_mean"], older["_std"])


def _dividing(prefix: str, mean: Tensor, std: Tensor) -> dict[str, Tensor]:
    return {
        f"{prefix}_mean": mean.reshape(1, -1),
        f"{prefix}_std": std.reshape(1, -1),
        "eps of the normaliser": torch.tensor(_EPS),
    }


def _std(states: Mapping[str, Tensor]) -> Tensor | None:
    for name in ("std", "distribution.std_param"):
        if name in states and states[name].numel() == 12:
            return states[name].float().reshape(12)
    for name in ("log_std", "distribution.log_std_param"):
        if name in states and states[name].numel() == 12:
            return states[name].float().exp().reshape(12)
    return None
