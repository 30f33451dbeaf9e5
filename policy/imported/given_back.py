"""A policy in the layout it came in: the file it was imported from, with new weights.

All else in the file stays: metadata, names, what a trainer keeps beside the network.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from data.files.files import read_file, write_atomically
from data.files.limits import POLICY_BYTES
from policy.networks.recipe import NetworkError, Recipe, RecipeNetwork
from policy.training.checkpoint import Policy

from .meaning.beside import activation_beside, policy_file
from .readers.adapting import TWO_SCRIPTS, files_of
from .readers.network_file import read_network
from .readers.onnx_file import loaded

_STDS = ("std", "distribution.std_param")
_LOG_STDS = ("log_std", "distribution.log_std_param")


def export_like(policy: Policy, source: Path, out: Path) -> Path:
    """Write the weights of `policy` into `out` in the layout of `source`.

    Raises:
        NetworkError: the policy was not imported from such a file.
    """
    file = policy_file(source)
    network = policy.network
    if not isinstance(network, RecipeNetwork):
        raise NetworkError(
            "this policy was trained here and came in no other layout: export it "
            "without --like"
        )
    found = read_network(file, activation_beside(file))
    if _shapes(found.recipe) != _shapes(network.recipe):
        raise NetworkError(
            f"{file} has another network than the policy: give the file it was "
            f"imported from{_name_of(policy)}"
        )
    tensors = network.tensors()
    names = {each.name for each in network.recipe.weights}
    new = {name: tensor for name, tensor in tensors.items() if name in names}
    target = out / file.name
    if target.exists() and target.samefile(file):
        raise NetworkError(f"{target} is the source itself: give another --out")
    if found.kind == TWO_SCRIPTS:
        parts = files_of(file).items()
        written = {each.name: _part(part, each, new) for part, each in parts}
    else:
        content = read_file(file, POLICY_BYTES)
        written = {file.name: _one(found.kind, content, file.parent, new, policy)}
    out.mkdir(parents=True, exist_ok=True)
    for name, data in written.items():
        write_atomically(out / name, data)
    return target


def _one(
    kind: str, content: bytes, folder: Path, new: Mapping[str, Tensor], policy: Policy
) -> bytes:
    """A file with a whole network."""
    if kind == "ONNX":
        return _onnx(content, folder, new)
    if kind == "TorchScript":
        return _script(content, new)
    assert isinstance(policy.network, RecipeNetwork)
    std = torch.empty(12)
    std[list(policy.network.recipe.action_order)] = policy.std
    return _checkpoint(content, new, std)


def _shapes(recipe: Recipe) -> Any:
    """What must be equal for weights to fit; the order of joints may differ."""
    return {each.name: each.shape for each in recipe.weights}, recipe.obs_dim


def _name_of(policy: Policy) -> str:
    origin = policy.info.origin
    return "" if origin is None else f", {origin.file}"


def _onnx(content: bytes, folder: Path, new: Mapping[str, Tensor]) -> bytes:
    """In one file, also where weights lay beside it."""
    onnx, model = loaded(content, folder)
    for each in model.graph.initializer:
        if each.name in new:
            array = new[each.name].numpy().reshape(tuple(each.dims))
            kind = onnx.helper.tensor_dtype_to_np_dtype(each.data_type)
            each.CopyFrom(onnx.numpy_helper.from_array(array.astype(kind), each.name))
    for node in model.graph.node:
        if node.op_type == "Constant" and node.output[0] in new:
            tensor = onnx.numpy_helper.from_array(new[node.output[0]].numpy())
            for attribute in node.attribute:
                if attribute.name == "value":
                    attribute.t.CopyFrom(tensor)
    return model.SerializeToString()


def _script(content: bytes, new: Mapping[str, Tensor]) -> bytes:
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # TorchScript is deprecated, and what robots run.
        warnings.simplefilter("ignore")
        module = torch.jit.load(io.BytesIO(content), map_location="cpu")
        stored = module.state_dict()
        if missing := sorted(set(new) - set(stored)):
            raise NetworkError(f"{missing[0][:60]} cannot be written into TorchScript")
        with torch.no_grad():
            for name, tensor in new.items():
                stored[name].copy_(tensor)
        torch.jit.save(module, stream)
    return stream.getvalue()


def _part(part: str, file: Path, new: Mapping[str, Tensor]) -> bytes:
    """One of two files; the tensors of both are told apart by how their names begin."""
    begins = f"{part}."
    own = {n.removeprefix(begins): t for n, t in new.items() if n.startswith(begins)}
    return _script(read_file(file, POLICY_BYTES), own)


def _checkpoint(content: bytes, new: Mapping[str, Tensor], std: Tensor) -> bytes:
    payload = torch.load(io.BytesIO(content), weights_only=True, map_location="cpu")
    part = "model_state_dict" if "model_state_dict" in payload else "actor_state_dict"
    states = payload[part]
    for name, tensor in new.items():
        states[name] = tensor.to(states[name].dtype)
    for name in _STDS:
        if name in states:
            states[name] = std.to(states[name].dtype).reshape(states[name].shape)
    for name in _LOG_STDS:
        if name in states:
            states[name] = std.log().to(states[name].dtype).reshape(states[name].shape)
    stream = io.BytesIO()
    torch.save(payload, stream)
    return stream.getvalue()
