"""From the command line and a file to the loops of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from data.files.plain import from_plain, to_plain
from data.files.telling import Tell, silent
from gaitpref.cli.options.bounds import require_bounds
from gaitpref.cli.options.options import Erring, Loop, Sweep
from gaitpref.cli.options.sweep_options import Looping
from gaitpref.executor.pieces import require_share
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.sweep.loop_changes import changed
from gaitpref.sweep.plan_file import read_plan
from gaitpref.sweep.sweep_cell import SweepCell
from gaitpref.sweep.sweep_plan import (
    CRITERION,
    SEED,
    SweepError,
    SweepPlan,
    value_text,
)

from .loop_arguments import resolve

_ERRING = {field.name for field in fields(Erring)}
_OPTIONS = {field.name for field in fields(Looping)} - {"erring"}
_OPTIONS |= {CRITERION, SEED} | _ERRING
"""Options of `gaitpref loop` that can be varied; all else is a path into what they come
to."""


def sweep_cells(command: Sweep, tell: Tell = silent) -> list[SweepCell]:
    """Every loop that a command asks for, in the order of running; `tell` gets how many
    are looked at.

    Raises:
        GaitprefError: an option, the file, or what comes of both cannot be used.
    """
    planned = plan_of(command).cells()
    found = []
    for done, cell in enumerate(planned, start=1):
        cfg = _cfg(command, cell.changes)
        found.append(SweepCell(name=cell.name, settings=cell.settings, cfg=cfg))
        tell(done, len(planned))
    return found


def gpu_share(command: Sweep, cells: Sequence[SweepCell]) -> float:
    """Share of a GPU for each of `cells` that trains on one.

    Raises:
        SweepError: none does, or it would see none.
        PieceError: so much cannot be had.
    """
    if command.gpu is None:
        return 1.0
    if not any(cell.on_gpu for cell in cells):
        raise SweepError(
            f"--gpu {command.gpu:g} is a loop's share of a GPU, and no loop trains on "
            "one: give --device cuda too, or leave --gpu out"
        )
    if command.gpu == 0.0:
        raise SweepError(
            "--gpu 0 with --device cuda: a loop that has no share sees no GPU; give a "
            "share as 0.5, or leave --device out"
        )
    require_share("--gpu", command.gpu)
    return command.gpu


def plan_of(command: Sweep) -> SweepPlan:
    """What is varied: by the file, and by the command line, which counts more.

    Raises:
        GaitprefError: the file cannot be used, or what is asked for cannot be.
    """
    told = SweepPlan(axes={}) if command.plan is None else read_plan(command.plan)
    axes = {_usual_name(name): values for name, values in told.axes.items()}
    given = dict(_assigned(text) for text in command.set)
    if len(given) < len(command.set):
        raise SweepError("--set names one thing twice: give all its values in one")
    for name in (CRITERION, SEED):
        if values := getattr(command, name):
            given[name] = values
    return SweepPlan(
        axes=axes | given,
        variants={
            name: {_usual_name(path): value for path, value in changes.items()}
            for name, changes in told.variants.items()
        },
        fixed={
            name: value
            for path, value in told.fixed.items()
            if (name := _usual_name(path)) not in {*given, *_told_of(command.loop)}
        },
    )


def _told_of(loop: Looping) -> set[str]:
    """Options that the command line gives: those that are not the default."""
    records = ((loop, Looping()), (loop.erring, Erring()))
    return {
        field.name
        for record, usual in records
        for field in fields(record)
        if getattr(record, field.name) != getattr(usual, field.name)
    }


def _assigned(text: str) -> tuple[str, tuple[Any, ...]]:
    """Name and values of NAME=VALUE,VALUE,...; a value is what it is in YAML."""
    name, equals, values = text.partition("=")
    if not (name and equals and values):
        raise SweepError(
            f"--set takes NAME=VALUE,VALUE,... as method.weight=1,3, got {text!r}"
        )
    try:
        found = yaml.safe_load(f"[{values}]")
    except yaml.YAMLError:
        found = None
    if not isinstance(found, list):
        raise SweepError(
            f"--set {text}: {values!r} is no list of values; quote what holds a comma "
            "or a bracket"
        )
    return _usual_name(name), tuple(map(_number, found))


def _number(value: Any) -> Any:
    """YAML takes 1e-3 for a text."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _usual_name(name: str) -> str:
    """An option as it is called in Python; paths as they are."""
    plain = name.replace("-", "_")
    return plain if plain in _OPTIONS else name


def _cfg(command: Sweep, changes: Mapping[str, Any]) -> LoopCfg:
    """The configuration of one loop.

    Raises:
        GaitprefError: a change does not fit.
    """
    options = {name: v for name, v in changes.items() if name in _OPTIONS}
    paths = {name: v for name, v in changes.items() if name not in _OPTIONS}
    cfg = resolve(_loop(command, options))
    if paths:
        cfg = changed(cfg, paths)
    if cfg.rater == "human":
        raise SweepError("people cannot answer a sweep: leave rater=human out")
    if cfg.program is not None:
        raise SweepError(
            f"a sweep has no program answer: leave rater={cfg.program.name} out"
        )
    return cfg


def _loop(command: Sweep, changes: Mapping[str, Any]) -> Loop:
    """`gaitpref loop` as it would be typed for this loop alone."""
    shared = {f.name: getattr(command.loop, f.name) for f in fields(Looping)}
    loop = Loop(run=Path(), **shared)
    if not changes:
        return loop
    plain = to_plain(loop, whole=True)
    for name, value in changes.items():
        (plain["erring"] if name in _ERRING else plain)[name] = value
    try:
        loop = from_plain(Loop, plain)
    except (ValueError, TypeError, OverflowError) as error:
        told = ", ".join(f"{name}={value_text(v)}" for name, v in changes.items())
        raise SweepError(f"{told} cannot be: {error}") from None
    require_bounds(loop)
    return loop
