"""The configuration a run directory keeps, and what a resume is held to."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import yaml

from data.errors import FileError
from data.files.files import read_json, write_atomically
from data.files.lock import LOCK_NAME
from data.files.plain import CLASS, from_plain, to_plain
from data.files.yaml_file import read_yaml
from policy.training.identity import differences

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
    unwritten = set(_unwritten_nones(cfg))
    differing = [
        (name, None if old is _UNTOLD and name in unwritten else old, new)
        for name, old, new in _differing(_load(path), yaml.safe_load(text))
    ]
    _require_whole(run, [name for name, old, _ in differing if old is _UNTOLD])
    changed = [f"{name} {_told(old)} -> {_told(new)}" for name, old, new in differing]
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
        RunError: there is none, it cannot be read, or an earlier version wrote it.
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
    if "method" not in values:
        raise RunError(
            f"{path.parent} was started by an earlier gaitpref, which wrote its "
            f"settings in another way (no `method` in {CONFIG_NAME}): go on with that "
            "version, or give another --run; its page, its rewards and its policies "
            "are as that version left them"
        )
    return values


_UNTOLD = object()


def _unwritten_nones(record: Any, name: str = "") -> Iterator[str]:
    """Names of the settings below `record` of which a file tells nothing where they
    are None."""
    for each in fields(record):
        within = f"{name}.{each.name}" if name else each.name
        if each.metadata.get("none_as_before"):
            yield within
        if is_dataclass(value := getattr(record, each.name)):
            yield from _unwritten_nones(value, within)


def _differing(
    old: object, new: object, name: str = ""
) -> Iterator[tuple[str, object, object]]:
    """Names and both values of the settings that differ, `_UNTOLD` where there is none;
    records of different classes as a whole. A setting that was None, and is no more,
    decided nothing."""
    if not (isinstance(old, dict) and isinstance(new, dict)) or (
        old.get(CLASS) != new.get(CLASS)
    ):
        if old != new:
            yield name, old, new
        return
    for key in sorted(old | new, key=str):
        within = f"{name}.{key}" if name else str(key)
        if not (key in old and old[key] is None and key not in new):
            yield from _differing(old.get(key, _UNTOLD), new.get(key, _UNTOLD), within)


def _told(value: object) -> str:
    if value is _UNTOLD:
        return "nothing"
    return str(value.get(CLASS, value) if isinstance(value, dict) else value)
