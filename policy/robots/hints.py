"""What a small TOML beside a model says where the model leaves it open.

```toml
[legs]                                  # joints hip, thigh, calf; needed where there
FR = ["fr_hip", "fr_thigh", "fr_calf"]  # are other joints, or legs in no clear corner
[feet]                                  # the geom each leg stands on
FR = "fr_toe"
[home]                                  # rad; the pose to stand in
FR = [0.0, 0.8, -1.6]
[servo]                                 # a number, or one for each of hip, thigh, calf
kp = 35.0                               # N m/rad
kd = 0.5                                # N m s/rad, all the damping there is
torque_limit = [23.7, 23.7, 35.55]      # N m
[joints]                                # what the bearings have, likewise
damping = 0.1                           # N m s/rad, a part of kd
friction = 0.2                          # N m
speed_limit = 30.0                      # rad/s; told to motor drivers, not simulated
```

Every table may be left out; one of legs, feet or home names all four legs.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco

from data.errors import FileError, GaitprefError
from data.features import LEGS
from data.files.files import read_file, read_text
from data.files.limits import ROBOT_BYTES, TEXT_BYTES

_MOST_FILES = 100
"""Of one model, looked through for what is included."""
TEXT_NAME = "gaitpref_hints"
"""The custom text of a flattened model that carries the hints along."""

_SERVO = ("kp", "kd", "torque_limit")
_JOINTS = ("damping", "friction", "speed_limit")


class RobotError(GaitprefError):
    """The model of a robot cannot be used; it says why and what to do."""

    def __init__(self, message: str, lines: str = "") -> None:
        """`lines` are what the file of hints may say to mend it."""
        super().__init__(message)
        self.lines = lines


@dataclass(frozen=True, kw_only=True)
class Hints:
    """The tables of the file; None where one is left out."""

    legs: dict[str, list[str]] | None = None
    """Names of the three joints of every leg."""
    feet: dict[str, str] | None = None
    """Name of the geom every leg stands on."""
    home: dict[str, list[float]] | None = None
    """Angles of the three joints of every leg, rad."""
    servo: dict[str, list[float]] | None = None
    """kp, kd and torque_limit, each for hip, thigh and calf."""
    joints: dict[str, list[float]] | None = None
    """damping, friction and speed_limit, likewise."""


def find_hints(xml: Path) -> Path | None:
    """The hints beside a model, or beside a file that it includes; None without any.

    `go2.toml` is of `go2.xml`, and of the `scene.xml` that includes it.
    """
    seen: set[Path] = set()
    files = [xml]
    while files:
        file = files.pop(0)
        if file in seen or len(seen) == _MOST_FILES:
            continue
        seen.add(file)
        beside = file.with_suffix(".toml")
        if beside.exists():
            return beside
        files += [file.parent / name for name in _included(file)]
    return None


def _included(xml: Path) -> list[str]:
    """The files that a file of MJCF includes or attaches."""
    try:
        root = ElementTree.fromstring(read_file(xml, ROBOT_BYTES))
    except (ElementTree.ParseError, ValueError, LookupError, OSError, FileError):
        return []
    found = [*root.iter("include"), *root.iter("model")]
    return [name for element in found if (name := element.get("file"))]


def read_hints(path: Path) -> Hints:
    """The hints in the file `path`.

    Raises:
        RobotError: the file cannot be read as the tables above.
    """
    try:
        tables = tomllib.loads(read_text(path, TEXT_BYTES))
    except (ValueError, RecursionError) as error:
        raise RobotError(f"{path}: it is no TOML ({error})") from None
    known = [field.name for field in fields(Hints)]
    for name, table in tables.items():
        if name not in known:
            raise RobotError(
                f"{path}: there is no table [{name}]; the tables are {', '.join(known)}"
            )
        if not isinstance(table, dict):
            raise RobotError(f"{path}: {name} must be a table, as in [{name}]")
    return Hints(
        legs=_of_legs(path, "legs", tables, lambda v: _triple(v, str)),
        feet=_of_legs(path, "feet", tables, lambda v: isinstance(v, str)),
        home=_of_legs(path, "home", tables, lambda v: _triple(v, (int, float))),
        servo=_numbers(path, "servo", tables, _SERVO, may_be_zero=("kd",)),
        joints=_numbers(path, "joints", tables, _JOINTS, may_be_zero=_JOINTS[:2]),
    )


def embedded_hints(spec: mujoco.MjSpec) -> Hints:
    """The hints a flattened model carries."""
    text = spec.text(TEXT_NAME)
    return Hints() if text is None else Hints(**json.loads(text.data))


def embed_hints(spec: mujoco.MjSpec, hints: Hints) -> None:
    """Let `spec` carry `hints`, where there are any."""
    told = {name: table for name, table in asdict(hints).items() if name != "joints"}
    if any(told.values()):
        spec.add_text(name=TEXT_NAME, data=json.dumps(told))


def table_of(name: str, legs: Iterable[object]) -> str:
    """The lines of the table `name` with a value of each of the four `legs`."""
    rows = (f"{leg} = {json.dumps(v)}" for leg, v in zip(LEGS, legs, strict=True))
    return "\n".join((f"[{name}]", *rows))


def _triple(value: Any, kind: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(v, kind) and not isinstance(v, bool) for v in value)
    )


def _of_legs(
    path: Path, name: str, tables: dict[str, Any], fits: Callable[[Any], bool]
) -> Any:
    table = tables.get(name)
    if table is None:
        return None
    if set(table) != set(LEGS) or not all(map(fits, table.values())):
        examples = {"legs": ["hip", "thigh", "calf"], "feet": "geom"}
        said = ", ".join(f"{key} = {value!r}" for key, value in table.items())
        raise RobotError(
            f"{path}: [{name}] has {said}; it must have these four lines, "
            "with the names or numbers of the robot",
            table_of(name, [examples.get(name, [0.0, 0.8, -1.6])] * 4),
        )
    return table


def _numbers(
    path: Path,
    title: str,
    tables: dict[str, Any],
    names: tuple[str, ...],
    *,
    may_be_zero: tuple[str, ...],
) -> dict[str, list[float]] | None:
    """A table of numbers for hip, thigh and calf."""
    table = tables.get(title)
    if table is None:
        return None
    found: dict[str, list[float]] = {}
    for name, value in table.items():
        values = value if isinstance(value, list) else [value] * 3
        if (
            name not in names
            or not _triple(values, (int, float))
            or not all(0 < v < 1e6 or (name in may_be_zero and v == 0) for v in values)
        ):
            raise RobotError(
                f"{path}: [{title}] takes {', '.join(names)}, each a positive number "
                f"or a list of three for hip, thigh and calf; it has {name} = {value!r}"
            )
        found[name] = [float(v) for v in values]
    return found
