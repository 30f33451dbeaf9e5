"""The configuration a run directory keeps, and what a resume is held to."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import yaml

from data.errors import FileError
from data.files import read_json, write_atomically
from data.lock import LOCK_NAME
from data.plain import from_plain, to_plain
from data.yaml_file import read_yaml
from policy.identity import differences

from .loop_cfg import LoopCfg, RunError

CONFIG_NAME = "config.yaml"
INPUTS_NAME = "inputs.json"


def claim(run: Path, cfg: LoopCfg, inputs: Mapping[str, Any]) -> None:
    """Write the configuration of a new run, or hold an old run to the one it has.

    Args:
        run: The run's directory.
        cfg: Everything that decides how it goes; written whole, defaults too.
        inputs: What the files behind its names are, by their contents.

    Raises:
        RunError: the directory belongs to a run with other settings, or to no run.
    """
    path = run / CONFIG_NAME
    text = yaml.safe_dump(to_plain(cfg, whole=True), sort_keys=False)
    if not path.exists():
        ours = {LOCK_NAME, INPUTS_NAME}
        if run.is_dir() and any(entry.name not in ours for entry in run.iterdir()):
            raise RunError(
                f"{run} is not empty and holds no {CONFIG_NAME}: give a new directory"
            )
        run.mkdir(parents=True, exist_ok=True)
        write_atomically(run / INPUTS_NAME, json.dumps(inputs, indent=1).encode())
        write_atomically(path, text.encode())
        return
    old, new = _flat(_load(path)), _flat(yaml.safe_load(text))
    _require_whole(run, new.keys() - old.keys())
    changed = [
        f"{key} {old.get(key)} -> {new.get(key)}"
        for key in sorted(old | new)
        if old.get(key) != new.get(key)
    ]
    changed += differences(_inputs(run), json.loads(json.dumps(inputs)))
    if changed:
        raise RunError(
            f"{run} was started with other settings ({', '.join(changed[:4])}): repeat "
            "its command to go on, or give another --run"
        )


def _require_whole(run: Path, absent: Collection[str]) -> None:
    if absent:
        names = ", ".join(sorted(absent)[:4]) + (", ..." if len(absent) > 4 else "")
        raise RunError(
            f"{run} was started by an earlier gaitpref, whose {CONFIG_NAME} does not "
            f"tell {len(absent)} of today's settings ({names}), so it cannot be known "
            "whether they were the same: go on with that version, or give another "
            f"--run; `gaitpref report --run {run}` still shows it"
        )


def _inputs(run: Path) -> dict[str, Any]:
    path = run / INPUTS_NAME
    try:
        return read_json(path)
    except (FileError, OSError) as error:
        raise RunError(
            f"{path} cannot be read ({error}), so it cannot be known what the run was "
            "started with: give another --run"
        ) from None


def read_config(run: Path) -> LoopCfg:
    """The configuration of the run in the directory `run`.

    Raises:
        RunError: there is none, or it cannot be read.
    """
    path = run / CONFIG_NAME
    if not path.exists():
        raise RunError(
            f"{run} holds no {CONFIG_NAME}: `gaitpref loop --run {run}` makes a run"
        )
    try:
        return from_plain(LoopCfg, _load(path))
    except (ValueError, TypeError, OverflowError) as error:
        raise RunError(f"{path} cannot be read: {error}") from None


def _load(path: Path) -> dict[str, object]:
    try:
        values = read_yaml(path)
    except ValueError as error:
        raise RunError(
            f"{path} is damaged: {' '.join(str(error).split())[:160]}"
        ) from None
    if not isinstance(values, dict):
        raise RunError(f"{path} is damaged: it holds no settings")
    return values


def _flat(values: object, prefix: str = "") -> dict[str, object]:
    if isinstance(values, dict):
        return {
            key: value
            for name, entry in values.items()
            for key, value in _flat(entry, f"{prefix}{name}.").items()
        }
    return {prefix.rstrip("."): values}
