"""The tables of the reference pages, made of what the code itself knows."""

from __future__ import annotations

import ast
import dataclasses
import inspect
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import MISSING, fields
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

from data.answers.sqlite_file import connect_copy
from data.datasets.labels import LABEL_TYPES
from data.episodes.episode_records import EpisodeMeta
from data.episodes.schema import FINAL_FIELDS, STEP_FIELDS, Field
from data.features import FEATURES, JOINTS, LEGS, Feature
from data.files import limits
from gaitpref.formats.logs.log_map import (
    BaseTopic,
    Columns,
    ContactTopic,
    ImuTopic,
    JointTopic,
    LogMap,
    TwistTopic,
)
from gaitpref.loop.run_dir import Round
from labeling_ui.limits import page_limits
from policy.env.feature_row import OBSERVATION
from policy.training.checkpoint import PolicyInfo
from rewardmodel.descriptors.table import columns_seen, names_seen
from rewardmodel.models.fit_report import FitReport
from rewardmodel.models.kinds import KINDS
from rewardmodel.trust import alarms

_LONG = 40
"""Characters from which on a default is not spelled out."""
_UNITS = (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10))


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(_cell, line))} |" for line in lines)


def _cell(value: object) -> str:
    return str(value).replace("|", "\\|")


def _named_columns(parts: Sequence[Feature]) -> str:
    start = 0
    rows: list[Sequence[object]] = []
    for part in parts:
        end = start + part.width
        columns = str(start) if part.width == 1 else f"{start} to {end - 1}"
        rows.append((columns, f"`{part.name}`", part.unit, part.meaning))
        start = end
    return _table(("columns", "name", "unit", "meaning"), rows)


def _descriptors() -> str:
    def seen_by(name: str) -> str:
        kinds = [k for k, kind in KINDS.items() if name in names_seen(kind.sight)]
        return "all" if len(kinds) == len(KINDS) else ", ".join(kinds)

    rows = (
        (f"`{item.name}`", item.unit, item.meaning, seen_by(item.name))
        for item in columns_seen("legs")
    )
    return _table(("name", "unit", "meaning", "models that see it"), rows)


def _members(message: Sequence[Field]) -> str:
    rows = ((f"`{each.name}`", each.ros_type, each.comment) for each in message)
    return _table(("name", "type", "what"), rows)


def _record(kind: type) -> str:
    """A row for each field of a dataclass, and the text below it."""
    told = _told(ast.parse(inspect.getsource(kind)).body[0])
    rows = (
        (f"`{each.name}`", each.type, told.get(each.name, "")) for each in fields(kind)
    )
    return _table(("name", "type", "what"), rows)


def _settings(kind: type, leave_out: Sequence[str] = ()) -> str:
    """The same for one that a person writes, with what is taken where nothing is."""
    told = _told(ast.parse(inspect.getsource(kind)).body[0])
    rows = (
        (f"`{each.name}`", _default(each), told.get(each.name, ""))
        for each in fields(kind)
        if each.name not in leave_out
    )
    return _table(("name", "default", "what"), rows)


def _default(of: dataclasses.Field[Any]) -> str:
    if of.default is MISSING:
        return "needed"
    if of.default is None:
        return ""
    spelled = repr(of.default)
    return f"`{spelled}`" if len(spelled) < _LONG else f"`{spelled[:_LONG]} ...`"


def _answer_tables() -> str:
    """The statements that make tables and views of the present store, as SQLite keeps
    them."""
    with closing(connect_copy(Path("there is no such file"))) as store:
        made = store.execute(
            "SELECT sql FROM sqlite_master WHERE type IN ('table', 'view') "
            "ORDER BY rowid"
        ).fetchall()
    return "```sql\n" + ";\n\n".join(text for (text,) in made) + ";\n```"


def _label_columns() -> str:
    rows = ((f"`{name}`", kind.__name__) for name, kind in LABEL_TYPES.items())
    return _table(("column", "type"), rows)


def _round_files() -> str:
    """What `Round` calls the files of a round, and what its docstrings say."""
    round = Round(Path("RUN"), 1)
    rows = (
        (f"`{place.relative_to(round.root)}`", inspect.getdoc(found))
        for name, found in vars(Round).items()
        if isinstance(found, property) and name != "root"
        if isinstance(place := getattr(round, name), Path)
    )
    return _table(("file", "what"), rows)


def _constants(module: ModuleType) -> str:
    """A row for each public constant that has a text below it."""
    told = _told(ast.parse(inspect.getsource(module)))
    rows = (
        (f"`{name}`", _spelled(name, getattr(module, name)), text)
        for name, text in told.items()
        if not name.startswith("_")
    )
    return _table(("name", "value", "what"), rows)


def _spelled(name: str, value: Any) -> str:
    if name.endswith("_BYTES"):
        for unit, size in _UNITS:
            if value >= size and value % size == 0:
                return f"{value // size} {unit}"
    if name == "BIGGEST_INTEGER":
        return "2^63 - 1"
    return f"{value:g}" if isinstance(value, float) else f"{value:,}"


def _told(tree: ast.AST) -> dict[str, str]:
    """The text below each assignment of a module or class, on one line."""
    body = getattr(tree, "body", [])
    found: dict[str, str] = {}
    for before, text in pairwise(body):
        if not (isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)):
            continue
        target = (
            before.targets[0]
            if isinstance(before, ast.Assign)
            else getattr(before, "target", None)
        )
        if isinstance(target, ast.Name):
            found[target.id] = " ".join(str(text.value.value).split())
    return found


_TOPICS = {
    "joints": JointTopic,
    "base": BaseTopic,
    "imu": ImuTopic,
    "contacts": ContactTopic,
    "twist": TwistTopic,
    "columns": Columns,
}
"""Tables of the map of a log."""
TABLES: dict[str, Callable[[], str]] = {
    "features": lambda: _named_columns(FEATURES),
    "observation": lambda: _named_columns(OBSERVATION),
    "descriptors": _descriptors,
    "leg order": lambda: ", ".join(LEGS),
    "joint order": lambda: ", ".join(f"`{joint}`" for joint in JOINTS),
    "step": lambda: _members(STEP_FIELDS),
    "final": lambda: _members(FINAL_FIELDS),
    "episode": lambda: _record(EpisodeMeta),
    "policy": lambda: _record(PolicyInfo),
    "fit report": lambda: _record(FitReport),
    "log map": lambda: _settings(LogMap, leave_out=tuple(_TOPICS)),
    **{name: partial(_settings, kind) for name, kind in _TOPICS.items()},
    "answers": _answer_tables,
    "labels": _label_columns,
    "round": _round_files,
    "file limits": lambda: _constants(limits),
    "page limits": lambda: _constants(page_limits),
    "alarm limits": lambda: _constants(alarms),
}
"""By the name that stands in a page, as in `<!-- table: features -->`."""
