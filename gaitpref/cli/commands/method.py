"""`gaitpref method`: what the loop decides, and what a run decided on the way."""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from data.files.files import read_json
from data.files.plain import to_plain
from gaitpref.cli.options import options
from gaitpref.cli.shared.by_hand import METHODS
from gaitpref.cli.shared.next_of_run import next_of_run
from gaitpref.console.progress import console
from gaitpref.console.terminal import say
from gaitpref.loop.drift import deserves_training, why_not_trained
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.run_config import read_config
from gaitpref.loop.run_dir import Round, context_of
from gaitpref.method.method import Method
from policy.training.checkpoint import load_policy
from policy.training.training_dir import POLICY_NAME
from rewardmodel.cfg import FitCfg
from rewardmodel.models.kinds import KINDS

_WIDTH = 88


@dataclass(frozen=True)
class Setting:
    """One number of a method, or that a decision is left out."""

    path: str
    """Names of the decision and of its settings, joined by dots."""
    value: str
    about: str
    """First sentence of its docstring."""


def run(command: options.Method) -> int:
    """Run the command; gives the exit code."""
    if command.run is None:
        _print_both(command)
    else:
        _print_run(command.run, as_json=command.json)
    if not command.json:
        console.next(
            "`gaitpref loop --run DIR` decides by `style`, with --base none `scratch`"
            if command.run is None
            else next_of_run(command.run)
        )
    return 0


def _print_both(command: options.Method) -> None:
    if command.json:
        plain = {name: to_plain(each, whole=True) for name, each in METHODS.items()}
        say(json.dumps(plain, indent=1))
        return
    columns = {
        name: {setting.path: setting for setting in settings_of(each)}
        for name, each in METHODS.items()
    }
    paths = list(dict.fromkeys(path for column in columns.values() for path in column))
    say(_row("", *columns))
    for path in sorted(paths, key=_decision_order):
        found = [column.get(path) for column in columns.values()]
        say(_row(path, *(each.value if each else "-" for each in found)))
        about = next(each.about for each in found if each)
        for line in textwrap.wrap(about, _WIDTH - 4):
            say(f"    {line}")


def _print_run(run: Path, *, as_json: bool) -> None:
    cfg = read_config(run)
    decided = list(_decided_in(run, cfg))
    if as_json:
        plain = {"method": to_plain(cfg.method, whole=True), "decided": decided}
        say(json.dumps(plain, indent=1))
        return
    for setting in settings_of(cfg.method):
        say(_row(setting.path, setting.value))
    say()
    say("What it decided on the way:")
    for line in decided or ["nothing yet"]:
        say(f"  {line}")


def _decided_in(run: Path, cfg: LoopCfg) -> Iterator[str]:
    """What the finished rounds of a run decided, in words."""
    for number in range(cfg.rounds + 1):
        round = Round(run, number)
        if number and round.report.exists():
            yield f"round {number}: {_trained_in(round)}"
        if round.standstill.exists():
            speed = read_json(round.standstill)["speed_m_s"]
            yield f"round {number}: trained to leave a standstill ({speed:.2f} m/s)"
        if round.decided.exists():
            yield f"round {number}: {read_json(round.decided)['told']}"
        if round.approval.exists():
            found = read_json(round.approval)
            begins = "the new policy" if found["approved"] else "the one before"
            yield (
                f"round {number}: {found['for_new']} answers for the new policy, "
                f"{found['for_old']} against: training went on from {begins}"
            )
        if round.verdict.exists():
            kept = cfg.method.labels_kept(context_of(cfg, round))
            yield f"round {number}: {kept} answers were kept to judge its policy"
            yield f"the run: {read_json(round.verdict)['sentence']}"


def _trained_in(round: Round) -> str:
    """How the policy of a finished round was trained, or why it was not."""
    if not deserves_training(round.before):
        return (
            f"nothing was trained, because the answers {why_not_trained(round.before)}"
        )
    candidate = round.candidate / POLICY_NAME
    policy = load_policy(candidate if candidate.exists() else round.policy)
    too = "counted" if policy.info.ppo.mirror else "did not count"
    noise = f"its noise ended at a deviation of {float(policy.std.mean()):.2f}"
    return f"steps {too} in the mirror too, and {noise}"


def settings_of(method: Method) -> Iterator[Setting]:
    """Every setting of `method`, in the order of its decisions."""
    yield from _leaves(method, "")


def _leaves(record: Any, prefix: str) -> Iterator[Setting]:
    about = field_docstrings(type(record))
    for field in fields(record):
        value, path = getattr(record, field.name), f"{prefix}{field.name}"
        if (
            isinstance(record, FitCfg)
            and field.name in KINDS
            and field.name != record.kind
        ):
            # Settings of a model that is not fitted decide nothing.
            continue
        if is_dataclass(value):
            if not fields(value):
                yield Setting(path, type(value).__name__, about[field.name])
            yield from _leaves(value, f"{path}.")
        else:
            yield Setting(path, _told(value), about[field.name])


def _told(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)


def field_docstrings(cls: type) -> dict[str, str]:
    """First sentence of the docstring of every field of a dataclass, inherited ones
    included."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if not is_dataclass(base):
            continue
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(tree, ast.ClassDef)
        for line, after in zip(tree.body, [*tree.body[1:], None], strict=True):
            if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name):
                own = _text_of(after)
                if own or line.target.id not in found:
                    found[line.target.id] = own
    return found


def _text_of(statement: ast.stmt | None) -> str:
    match statement:
        case ast.Expr(value=ast.Constant(value=str() as text)):
            return " ".join(text.split()).split(". ")[0].rstrip(".") + "."
    return ""


def _decision_order(path: str) -> int:
    names = [field.name for field in fields(Method)]
    return names.index(path.partition(".")[0])


def _row(path: str, *values: str) -> str:
    return f"{path:<36}" + "".join(f"{value:<16}" for value in values).rstrip()
