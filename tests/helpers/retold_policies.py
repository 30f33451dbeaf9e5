"""Policy files that say something else of themselves."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from data.files.plain import to_plain
from policy.env.course import AHEAD_DIM
from policy.env.env_cfg import EnvCfg, getup_env
from policy.env.feature_row import obs_column
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


def restless(file: Path, out: Path, termination: str) -> Path:
    """The policy of `file`, whose chooser would end a gait at every look, and takes the
    first while the base rolls to one side and the second while it rolls to the other.
    """
    payload = read_plain(file)
    weights = payload["actor_state_dict"]
    for name in weights:
        if name.startswith("chooser."):
            weights[name].zero_()
    first, second, worth = (weights[f"chooser.values.{n}.weight"] for n in (0, 2, 4))
    rolls = AHEAD_DIM - 1 + obs_column("base_ang_vel_b").start
    for sign, unit in ((100.0, 0), (-100.0, 1)):
        first[unit, rolls] = sign
        second[unit, unit] = worth[unit, unit] = 1.0
    weights["chooser.ends.4.bias"].fill_(5.0)
    out.write_bytes(saved_bytes(payload))
    choosing = {"termination": termination, "length_s": 0.2}
    return _retold(
        out, out, lambda told: told["ppo"]["gaits"]["choosing"].update(choosing)
    )


def _retold(file: Path, out: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    payload = read_plain(file)
    told = json.loads(payload["infos"]["gaitpref"])
    change(told)
    out.write_bytes(saved_bytes({**payload, "infos": {"gaitpref": json.dumps(told)}}))
    return out
