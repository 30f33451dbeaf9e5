"""The configuration a run directory keeps, and what a resume is held to."""

from __future__ import annotations

from pathlib import Path

import yaml

from data.files import write_atomically
from data.plain import from_plain, to_plain
from data.yaml_file import read_yaml

from .loop_cfg import LoopCfg, RunError

CONFIG_NAME = "config.yaml"


def claim(run: Path, cfg: LoopCfg) -> None:
    """Write the configuration of a new run, or hold an old run to the one it has.

    Raises:
        RunError: the directory belongs to a run with other settings, or to no run.
    """
    path = run / CONFIG_NAME
    text = yaml.safe_dump(to_plain(cfg), sort_keys=False)
    if not path.exists():
        if run.is_dir() and any(run.iterdir()):
            raise RunError(
                f"{run} is not empty and holds no {CONFIG_NAME}: give a new directory"
            )
        run.mkdir(parents=True, exist_ok=True)
        write_atomically(path, text.encode())
        return
    old, new = _flat(_load(path)), _flat(yaml.safe_load(text))
    changed = sorted(key for key in old | new if old.get(key) != new.get(key))
    if changed:
        shown = ", ".join(f"{k} {old.get(k)} -> {new.get(k)}" for k in changed[:4])
        raise RunError(
            f"{run} was started with other settings ({shown}): repeat its command to "
            f"go on, or give another --run"
        )


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
