"""Rewards where rollouts are: on the device that trains."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy, deepcopy
from dataclasses import fields, is_dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn


def on_device(value: Any, device: torch.device) -> Any:
    """`value` with all tensors that it holds on `device`; itself where they are.

    Looks into networks, records, objects with attributes, lists and mappings. What a
    plain function holds on to it leaves alone.
    """
    if device.type == "cpu":
        return value
    match value:
        case Tensor():
            return value.to(device)
        case nn.Module():
            return _moved_attributes(deepcopy(value).to(device), device)
        case Mapping():
            moved = {key: on_device(entry, device) for key, entry in value.items()}
            return type(value)(moved)  # pyright: ignore[reportCallIssue]
        case tuple() if hasattr(value, "_fields"):
            return type(value)(*(on_device(entry, device) for entry in value))
        case list() | tuple():
            return type(value)(on_device(entry, device) for entry in value)
        case partial():
            held = on_device([*value.args], device), on_device(value.keywords, device)
            return partial(on_device(value.func, device), *held[0], **held[1])
    if is_dataclass(value) and not isinstance(value, type):
        moved = copy(value)
        for each in fields(value):
            new = on_device(getattr(value, each.name), device)
            # Frozen for others; this copy is nobody's yet.
            object.__setattr__(moved, each.name, new)
        return moved
    if type(value).__module__.partition(".")[0] in _OURS and hasattr(value, "__dict__"):
        return _moved_attributes(copy(value), device)
    return value


_OURS = ("data", "gaitpref", "policy", "rewardmodel")


def _moved_attributes(value: Any, device: torch.device) -> Any:
    """`value` with the tensors among its plain attributes on `device`."""
    for name, entry in list(vars(value).items()):
        # Those of a network torch has moved.
        if not name.startswith(("_parameters", "_buffers", "_modules")):
            moved = on_device(entry, device)
            if moved is not entry:
                object.__setattr__(value, name, moved)
    for child in value.children() if isinstance(value, nn.Module) else ():
        _moved_attributes(child, device)
    return value
