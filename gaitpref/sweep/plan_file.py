"""Reads what a sweep varies from a file of YAML or TOML, as

    criterion: [high_step, crouch]
    seed: [0, 1, 2]
    loop: {preset: quick, labels: 20}
    set:
      method.weight: [1.0, 3.0]
    variants:
      default: {}
      unjudged: {method.accept: null}

where `loop` holds for all, and a variant is several changes that go together.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from data.files.files import read_text
from data.files.limits import TEXT_BYTES
from data.files.plain import CLASS
from data.files.yaml_file import read_yaml

from .sweep_plan import CRITERION, SEED, SweepError, SweepPlan

_KEYS = (CRITERION, SEED, "set", "variants", "loop")


def read_plan(path: Path) -> SweepPlan:
    """The plan in a file; the ending .toml says that it is TOML.

    A value of `set` is a list of what is tried, or one value; in place of a dotted path
    its parts may be written as nested tables, as TOML does.

    Raises:
        SweepError: the file holds no plan.
        FileError, OSError: it is no file, too large, missing, or cannot be read.
    """
    found = _load(path)
    if not isinstance(found, dict) or not found:
        raise SweepError(f"{path} holds no plan: it names {', '.join(_KEYS)}")
    for key in found:
        if key not in _KEYS:
            near = difflib.get_close_matches(str(key), _KEYS, 1)
            meant = f"did you mean {near[0]}? " if near else ""
            raise SweepError(
                f"{path} names {key!r}: {meant}it can name {', '.join(_KEYS)}"
            )
    tables = {key: _table(path, found, key) for key in ("set", "variants", "loop")}
    axes = {key: _several(found[key]) for key in (CRITERION, SEED) if key in found}
    axes |= {name: _several(value) for name, value in _flat(tables["set"])}
    return SweepPlan(
        axes=axes,
        variants={
            str(name): dict(_flat(_table(path, tables["variants"], name)))
            for name in tables["variants"]
        },
        fixed=dict(_flat(tables["loop"])),
    )


def _load(path: Path) -> Any:
    try:
        if path.suffix == ".toml":
            return tomllib.loads(read_text(path, TEXT_BYTES))
        return read_yaml(path)
    except ValueError as error:
        told = " ".join(str(error).split())[:160]
        raise SweepError(f"{path} cannot be read: {told}") from None


def _table(path: Path, found: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = found.get(key)
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise SweepError(f"{path}: {key} must hold names and values, got {value!r}")
    return value


def _several(value: Any) -> tuple[Any, ...]:
    return tuple(value) if isinstance(value, list) else (value,)


def _flat(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted paths and values; a table that names a class is a value."""
    for key, value in table.items():
        if isinstance(value, dict) and value and CLASS not in value:
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value
