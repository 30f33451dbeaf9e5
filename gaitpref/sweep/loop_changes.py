"""Changes of a loop's configuration by dotted paths, as `method.weight`."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from data.files.plain import CLASS, from_plain, to_plain
from gaitpref.loop.loop_cfg import LoopCfg

from .sweep_plan import SweepError, value_text


def changed(cfg: LoopCfg, changes: Mapping[str, Any]) -> LoopCfg:
    """`cfg` with plain values put in the places that dotted paths name; all its checks
    run again.

    A decision is left out with None, and another put in its place with a mapping that
    names its `class`.

    Raises:
        SweepError: there is no such place, or the value does not fit.
    """
    plain = to_plain(cfg, whole=True)
    for path, value in changes.items():
        _put(plain, path, value)
    try:
        return from_plain(LoopCfg, plain)
    except (ValueError, TypeError, OverflowError) as error:
        told = ", ".join(f"{path}={value_text(v)}" for path, v in changes.items())
        raise SweepError(f"{told} cannot be: {error}") from None


def _put(plain: dict[str, Any], path: str, value: Any) -> None:
    *above, last = path.split(".")
    place: Any = plain
    for depth, name in enumerate([*above, last]):
        if not isinstance(place, dict):
            here = ".".join(path.split(".")[:depth])
            raise SweepError(
                f"{path} cannot be set: {here} is {value_text(place)} in this loop, "
                "and holds no settings"
            )
        if name not in place:
            raise SweepError(_unknown(path, name, place))
        if depth < len(above):
            place = place[name]
    place[last] = value


def _unknown(path: str, name: str, place: Mapping[str, Any]) -> str:
    known = sorted(key for key in place if key != CLASS)
    near = difflib.get_close_matches(name, known, 1)
    meant = f"did you mean {near[0]}? " if near else ""
    return (
        f"a loop has no option and no setting {path}: there is no {name!r}; {meant}"
        f"there are {', '.join(known)}"
    )
