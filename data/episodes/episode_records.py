"""An episode in memory, checked once when it is built.

Shapes: T steps of the episode, F columns of the feature row.
"""

from __future__ import annotations

import json
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

import numpy as np

from .schema import STEP_FIELDS, body_dtype

EndReason = Literal["terminated", "truncated", "aborted"]
"""`terminated`: by a fall. `truncated`: by the time limit. `aborted`: the simulation
went bad, or recording stopped; such an episode is kept but never shown."""
END_REASONS: tuple[EndReason, ...] = get_args(EndReason)

_EXTRA_PREFIX = "extra."


COMMAND_CHANGE = "command_change_steps"
"""Name in `EpisodeMeta.extra` of the steps from one command to the next."""
TEAM_TASK = "team"
"""`EpisodeMeta.task` of two robots that walk in formation."""
ROBOTS = "robots"
"""Name in `EpisodeMeta.extra` of how many robots there are, where not one alone."""


@dataclass(frozen=True, kw_only=True)
class EpisodeMeta:
    """Where an episode comes from.

    Raises:
        TypeError: a field is not what its annotation says.
        ValueError: a field cannot be true of an episode; the message names it.
    """

    task: str
    """What the robot was to do, such as `walk`; `hardware` in what a robot logged."""
    seed: int
    """Seed of the run that recorded the episode."""
    env_index: int
    """Which of the parallel environments."""
    command: tuple[float, float, float]
    """Forward in m/s, left in m/s, yaw in rad/s; constant over the episode, or the
    first of those of a manoeuvre."""
    policy_sha256: str
    """Hash of the checkpoint that acted."""
    policy_step: int
    """Environment steps the policy had been trained for."""
    stochastic: bool
    """Actions were sampled with exploration noise."""
    control_dt_s: float
    """Time between two actions."""
    physics_dt_s: float
    """Time step of the simulator."""
    robot: str
    """Name of the robot model."""
    model_sha256: str
    """Hash of the robot model."""
    round: int = 0
    """Round of the loop that recorded the episode."""
    extra: dict[str, str] = field(default_factory=dict, hash=False)
    """Anything else worth knowing later, as text."""

    def __post_init__(self) -> None:
        # Numbers out of an array become plain ones, which JSON can spell.
        for name, kind in _META_FIELDS.items():
            object.__setattr__(self, name, _CASTS[kind](getattr(self, name)))
        if len(self.command) != 3 or not all(map(math.isfinite, self.command)):
            raise ValueError(f"command must be 3 finite numbers, got {self.command}")
        for name in ("control_dt_s", "physics_dt_s"):
            seconds = getattr(self, name)
            if not (math.isfinite(seconds) and seconds > 0):
                raise ValueError(f"{name} must be positive, got {seconds}")
        for name in ("seed", "env_index", "policy_step", "round"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative: {getattr(self, name)}")
        for key, value in self.extra.items():
            if not (isinstance(key, str) and isinstance(value, str)):
                raise ValueError(f"extra holds text only, got {key!r}: {value!r}")
        object.__setattr__(self, "extra", dict(self.extra))

    @property
    def command_change_steps(self) -> int:
        """Control steps from one command of a manoeuvre to the next; 0 without one."""
        text = self.extra.get(COMMAND_CHANGE, "")
        return int(text) if text.isdecimal() and len(text) < 10 else 0

    @property
    def is_team(self) -> bool:
        """Whether two robots are in the world; the file of one holds the other."""
        return self.extra.get(ROBOTS) == "2"

    def to_strings(self) -> dict[str, str]:
        """Spell every field as text, the only thing MCAP metadata holds."""
        strings: dict[str, str] = {}
        for name, kind in _META_FIELDS.items():
            value = getattr(self, name)
            strings[name] = value if kind == "str" else json.dumps(value)
        extra = {_EXTRA_PREFIX + key: self.extra[key] for key in sorted(self.extra)}
        return strings | extra

    @staticmethod
    def from_strings(strings: Mapping[str, str]) -> EpisodeMeta:
        """The inverse of `to_strings`; other keys are ignored.

        Raises:
            KeyError: a field is missing.
            ValueError: a field does not hold what its type says.
        """
        values: dict[str, Any] = {}
        for name, kind in _META_FIELDS.items():
            text = strings[name]
            values[name] = text if kind == "str" else _parse(name, kind, text)
        values["extra"] = {
            key.removeprefix(_EXTRA_PREFIX): value
            for key, value in strings.items()
            if key.startswith(_EXTRA_PREFIX)
        }
        return EpisodeMeta(**values)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"expected text, got {value!r}")
    return value


_CASTS: dict[str, Callable[[Any], Any]] = {
    "str": _text,
    "int": operator.index,
    "float": float,
    "bool": bool,
    "tuple[float, float, float]": lambda values: tuple(float(v) for v in values),
}
_META_FIELDS = {f.name: str(f.type) for f in fields(EpisodeMeta) if f.name != "extra"}


def _parse(name: str, kind: str, text: str) -> Any:
    """Read a JSON value that must be of the annotated kind."""
    value = json.loads(text)
    if kind.startswith("tuple"):
        fits = isinstance(value, list) and all(type(v) in (int, float) for v in value)
        return tuple(value) if fits else _refuse(name, kind, text)
    allowed = {"int": (int,), "float": (int, float), "bool": (bool,)}[kind]
    return value if type(value) in allowed else _refuse(name, kind, text)


def _refuse(name: str, kind: str, text: str) -> None:
    raise ValueError(f"{name} should be {kind}, got {text[:80]!r}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Episode:
    """One episode, from its reset to its end.

    Owns its arrays: they become read-only. A writable view of another array is copied,
    because its owner could still change it.

    Raises:
        TypeError: an array has the wrong dtype.
        ValueError: an array has an impossible shape; the message names it.
    """

    qpos: np.ndarray
    """[T + 1, 19] float64, state before each action; the last row is the final state.
    Base position in m, attitude wxyz, joints in rad."""
    qvel: np.ndarray
    """[T + 1, 18] float64, m/s and rad/s, rows as in `qpos`."""
    obs: np.ndarray
    """[T + 1, 48] float32, what the policy sees, rows as in `qpos`."""
    action: np.ndarray
    """[T, 12] float32, policy output after clipping."""
    ctrl: np.ndarray
    """[T, 12] float32, what the actuators were told."""
    features: np.ndarray
    """[T, F] float32 in the order of `data.features.FEATURES`, after each step."""
    reward: np.ndarray
    """[T] float32, hand-written task reward."""
    end_reason: EndReason
    meta: EpisodeMeta
    mjcf: str
    """The robot and its world as one self-contained MJCF text."""
    mate: Episode | None = None
    """The other robot of a team, which did its steps at the same time in the same
    world; None where the robot is alone."""

    def __post_init__(self) -> None:
        if self.mate is not None:
            _require_together(self, self.mate)
        if self.end_reason not in END_REASONS:
            known = ", ".join(END_REASONS)
            raise ValueError(f"end_reason must be one of {known}: {self.end_reason!r}")
        num_steps = len(self.action)
        if num_steps < 1:
            raise ValueError("action has no rows, an episode has at least one step")
        for name, (dtype, row_shape, extra_rows) in _ARRAYS.items():
            array = getattr(self, name)
            if not isinstance(array, np.ndarray) or array.dtype != dtype:
                found = getattr(array, "dtype", type(array).__name__)
                raise TypeError(f"{name} must be a {dtype} array, got {found}")
            shape = (num_steps + extra_rows, *row_shape)
            if array.shape != shape:
                raise ValueError(
                    f"{name} must have shape {shape} in an episode of "
                    f"{num_steps} steps, got {array.shape}"
                )
            if array.base is not None and array.flags.writeable:
                array = array.copy()
                object.__setattr__(self, name, array)
            array.setflags(write=False)

    @property
    def num_steps(self) -> int:
        """Control steps T."""
        return len(self.action)

    @property
    def robots(self) -> tuple[Episode, ...]:
        """This robot, and behind it the other one of a team."""
        return (self,) if self.mate is None else (self, self.mate)

    @property
    def world_qpos(self) -> np.ndarray:
        """[T + 1, nq] float64, positions of the whole world of `mjcf`: as `qpos`, of
        one robot after the other."""
        return np.concatenate([robot.qpos for robot in self.robots], axis=1)

    @property
    def duration_s(self) -> float:
        """Simulated time from the reset to the final state."""
        return self.num_steps * self.meta.control_dt_s

    @property
    def time_s(self) -> np.ndarray:
        """[T + 1] seconds since the reset, for the rows of `qpos`."""
        return np.arange(self.num_steps + 1) * self.meta.control_dt_s


def _require_together(episode: Episode, mate: Episode) -> None:
    """
    Raises:
        ValueError: both were not in one world at the same time.
    """
    if not episode.meta.is_team:
        raise ValueError(f"the extra {ROBOTS!r} of a robot with a mate must be '2'")
    if mate.mate is not None:
        raise ValueError("the mate of a robot has no mate of its own beside it")
    for name, ours, theirs in (
        ("steps", len(episode.action), len(mate.action)),
        ("an end", episode.end_reason, mate.end_reason),
        ("a world", episode.mjcf, mate.mjcf),
        ("a control step", episode.meta.control_dt_s, mate.meta.control_dt_s),
    ):
        if ours != theirs:
            raise ValueError(
                f"both robots of a team share {name}, these have {str(ours)[:40]!r} "
                f"and {str(theirs)[:40]!r}"
            )


def _array_table() -> dict[str, tuple[np.dtype, tuple[int, ...], int]]:
    """Dtype, shape of a row and rows beyond T of each array of an episode."""
    body = body_dtype(STEP_FIELDS)
    table: dict[str, tuple[np.dtype, tuple[int, ...], int]] = {}
    for name in ("qpos", "qvel", "obs", "action", "ctrl", "features", "reward"):
        member = body[name]
        extra_rows = 1 if name in ("qpos", "qvel", "obs") else 0
        table[name] = (member.base, member.shape, extra_rows)
    return table


_ARRAYS = _array_table()
