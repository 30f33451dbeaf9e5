"""Policy files that say something else of themselves."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from data.files.plain import to_plain
from policy.env.env_cfg import EnvCfg, getup_env
from policy.training.checkpoint import read_plain, saved_bytes


def slower(file: Path, out: Path) -> Path:
    """The policy of `file` at 40 Hz."""
    return _retold(file, out, lambda told: told["env"].update(substeps=5))


def heavier(file: Path, out: Path) -> Path:
    """The policy of `file`, of a robot whose trunk weighs 4 kg more."""

    def load(told: dict[str, Any]) -> None:
        before = told["robot_mjcf"]
        told["robot_mjcf"] = before.replace('mass="5.204"', 'mass="9.204"')
        assert told["robot_mjcf"] != before

    return _retold(file, out, load)


def getting_up(file: Path, out: Path) -> Path:
    """The policy of `file`, as one that begins lying."""
    getup = to_plain(getup_env(EnvCfg()).getup)
    return _retold(file, out, lambda told: told["env"].update(getup=getup))


def _retold(file: Path, out: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    payload = read_plain(file)
    told = json.loads(payload["infos"]["gaitpref"])
    change(told)
    out.write_bytes(saved_bytes({**payload, "infos": {"gaitpref": json.dumps(told)}}))
    return out
