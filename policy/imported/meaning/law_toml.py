"""A law as a small TOML, for people: written as a draft to fill in, read back."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from data.files.files import read_text
from data.files.limits import TEXT_BYTES
from data.files.plain import from_plain
from policy.law.gait import Gait
from policy.law.law import WIDTHS, LawError

from .draft import NEEDED, Draft, twelve, whole_of
from .term_names import term_of

_VECTORS = (
    "default_joint_pos_rad",
    "action_scale_rad",
    "action_offset_rad",
    "kp_nm_per_rad",
    "kd_nm_s_per_rad",
    "torque_limit_nm",
)
_NUMBERS = ("obs_limit", "action_limit", "joint_friction_nm", "physics_dt_s")
_SWITCHES = ("newest_first", "by_term")
_TABLES = ("gait", "terms")
_NAMES = ("joints", "before", "substeps", "activation")
_KNOWN = (*_NAMES, *_TABLES, *_VECTORS, *_NUMBERS, *_SWITCHES)
_HELP = {
    "joints": "names, in the order of the policy",
    "newest_first": "order of the frames of a history",
    "by_term": "all frames of a term together (true), or all terms of a frame",
    "before": '"zeros", where frames before the first are that, and not the first',
    "obs_limit": "scaled observations are clipped to plus or minus this",
    "default_joint_pos_rad": "what observed angles are measured from",
    "action_scale_rad": "a number, or one for each joint",
    "action_offset_rad": "where an action of 0 is; the default pose if left out",
    "kp_nm_per_rad": "stiffness",
    "kd_nm_s_per_rad": "damping, all there is",
    "torque_limit_nm": "those of the robot's model if left out",
    "physics_dt_s": "time step of the motors",
    "substeps": "time steps between two actions",
    "activation": "between the layers of a checkpoint",
}


def read_law_toml(path: Path) -> Draft:
    """The draft in a TOML file; what it leaves out is open.

    Raises:
        LawError: it is none.
    """
    try:
        told = tomllib.loads(read_text(path, TEXT_BYTES))
    except FileNotFoundError:
        raise LawError(f"there is no file {path}") from None
    except (ValueError, RecursionError) as error:
        raise LawError(f"{path}: it is no TOML ({error})") from None
    if unknown := sorted(set(told) - set(_KNOWN)):
        raise LawError(
            f"{path}: there is no {unknown[0][:40]!r}; there are {', '.join(_KNOWN)}"
        )
    values: dict[str, Any] = {
        name: twelve(told[name], name) for name in _VECTORS if name in told
    }
    values |= {name: _of(path, told, name, float) for name in _NUMBERS if name in told}
    values |= {name: _of(path, told, name, bool) for name in _SWITCHES if name in told}
    for name, kind in (("substeps", int), ("activation", str)):
        if name in told:
            values[name] = _of(path, told, name, kind)
    if "joints" in told:
        names = told["joints"]
        if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
            raise LawError(f"{path}: joints must be a list of names")
        values["joints"] = tuple(names)
    if told.get("before", "zeros") != "zeros":
        raise LawError(f'{path}: before must be "zeros", or left out')
    values["before"] = told.get("before")
    if "gait" in told:
        values["gait"] = _gait(path, told["gait"])
    if "terms" in told:
        values["terms"] = _terms(path, told["terms"])
    return Draft(source=path.name, **values)


def _of(path: Path, told: Mapping[str, Any], name: str, kind: type) -> Any:
    value = told[name]
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not kind:
        words = {float: "a number", bool: "true or false", int: "a whole number"}
        raise LawError(f"{path}: {name} must be {words.get(kind, 'a text')}: {value!r}")
    return value


def _gait(path: Path, told: Any) -> Gait:
    try:
        return from_plain(Gait, told)
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        names = ", ".join(each.name for each in fields(Gait))
        raise LawError(
            f"{path}: [gait] holds numbers by these names: {names} ({error})"
        ) from None


def _terms(path: Path, entries: Any) -> Any:
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise LawError(f"{path}: terms must be tables [[terms]]")
    found = []
    for entry in entries:
        if unknown := sorted(set(entry) - {"name", "scale", "clip", "frames"}):
            raise LawError(f"{path}: a term has no {unknown[0][:40]!r}")
        found.append(
            term_of(
                str(entry.get("name", "")),
                scale=entry.get("scale"),
                clip=entry.get("clip"),
                frames=whole_of(entry.get("frames"), f"{path}: frames"),
            )
        )
    return tuple(found)


def law_toml(draft: Draft) -> str:
    """`draft` as a TOML that a person fills in; what is open or guessed says so."""
    lines = [f"# The law of a policy, by {draft.source}."]
    lines.append(f"# Its robot: {draft.robot or 'no file says which'} (--robot).")
    for each in fields(Draft):
        name = each.name
        if name not in _KNOWN or name in _TABLES:
            continue
        value = getattr(draft, name)
        notes = [_HELP[name]] if name in _HELP else []
        if name in draft.guessed:
            notes.append(f"GUESSED: {draft.guessed[name]}")
        if value is None and name in NEEDED:
            lines.append(f"# {name} =   # FILL IN: {', '.join(notes)}")
        elif value is None:
            lines.append(f"# {name} =   # {', '.join(notes) or 'may be left out'}")
        else:
            note = f"  # {', '.join(notes)}" if notes else ""
            lines.append(f"{name} = {_spelled(value)}{note}")
    lines.append("")
    if draft.gait is not None:
        if note := draft.guessed.get("gait"):
            lines.append(f"# GUESSED: {note}")
        asked = asdict(draft.gait).items()
        lines += ["[gait]", *(f"{name} = {value}" for name, value in asked), ""]
    if draft.terms is None:
        lines.append(f"# FILL IN [[terms]] in their order; names: {', '.join(WIDTHS)}")
        lines += [
            "# [[terms]]",
            '# name = "base_ang_vel"',
            "# scale = 1.0",
            "# frames = 1",
        ]
    if note := draft.guessed.get("frames"):
        lines.append(f"# GUESSED: {note}")
    for term in draft.terms or ():
        lines += [
            "[[terms]]",
            f'name = "{term.name}"',
            f"scale = {_spelled(term.scale)}",
        ]
        if term.clip is not None:
            lines.append(f"clip = {_spelled(term.clip)}")
        lines.append(f"frames = {term.frames}")
    return "\n".join(lines) + "\n"


def _spelled(value: Any) -> str:
    if isinstance(value, tuple) and len(value) > 1 and len(set(value)) == 1:
        value = value[0]
    if isinstance(value, tuple) and len(value) == 1:
        value = value[0]
    return json.dumps(value)
