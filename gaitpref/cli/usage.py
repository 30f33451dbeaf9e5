"""What can be typed after `gaitpref`, and what was meant by what cannot."""

from __future__ import annotations

import difflib
import inspect
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

import tyro

from data.errors import GaitprefError
from gaitpref.cli.options import data_options, options, team_options

GROUPS = {"data": data_options.Action, "team": team_options.TeamAction}
"""Commands of which the next word says what they do, and what there is of them."""
WELCOME = """\
gaitpref turns preferences between gaits into a better policy. Three ways in:

  answer in the browser     gaitpref loop --run runs/ours --preset quick --rater human \
--no-auth --open
  let a program answer      gaitpref loop --run runs/demo --preset quick --criterion \
high_step
  reuse a data set offline  gaitpref fit --dataset DIR --out runs/reward

`gaitpref doctor` says whether all that takes is here, `gaitpref --help` lists every
command, `gaitpref COMMAND --help` its options."""
"""What is said to who types no command."""

WAYS: dict[str, tuple[str, ...]] = {
    "Answer in the browser": ("label", "raters", "play", "arena", "film"),
    "Let a program answer, in a loop or stage by stage": (
        "loop", "sweep", "method", "watch", "report",
        "record", "pairs", "answer", "train", "evaluate",
    ),
    "Reuse a data set offline": ("data", "fit", "trust", "explain", "relabel"),
    "Bring robots and policies, and take them away": (
        "robot", "policy", "export", "options", "team",
    ),
    "Look whether all is here": ("doctor",),
}  # fmt: skip
"""Every command, under what it is mostly for."""
_WIDE, _NAME = 80, 10


class UsageError(GaitprefError):
    """A command that does not exist."""


def overview() -> str:
    """Every command in a sentence, by what it is for."""
    about = {name: _sentence(cls) for name, cls in _named(options.Command)}
    lines = [
        "usage: gaitpref [--version] COMMAND [OPTIONS]",
        "",
        "Turns preferences between gaits into a better policy. `gaitpref` alone says",
        "where to begin, `gaitpref COMMAND --help` which options there are.",
    ]
    for way, names in WAYS.items():
        lines += ["", f"{way}:"]
        for name in names:
            beside = f"  {name:{_NAME}}"
            indent = " " * len(beside)
            lines += textwrap.wrap(
                beside + about[name], _WIDE, subsequent_indent=indent
            )
    return "\n".join(lines)


def _sentence(cls: type) -> str:
    """The first one of what a command's options say of it."""
    paragraph, _, _ = inspect.cleandoc(cls.__doc__ or "").partition("\n\n")
    return " ".join(paragraph.split())


def commands() -> dict[tuple[str, ...], type]:
    """The options of every command by its words."""
    found = {(name,): cls for name, cls in _named(options.Command)}
    for group, actions in GROUPS.items():
        del found[(group,)]
        found |= {(group, name): cls for name, cls in _named(actions)}
    return found


def require_command(args: Sequence[str]) -> None:
    """Make sure that the first words are a command.

    Raises:
        UsageError: they are none; the message names the nearest one.
    """
    known = [name for name, _ in _named(options.Command)]
    _require_one(args[:1], known, "gaitpref")
    for group, actions in GROUPS.items():
        if list(args[:1]) == [group]:
            known = [name for name, _ in _named(actions)]
            _require_one(args[1:2], known, f"gaitpref {group}")


def did_you_mean(args: Sequence[str]) -> str:
    """What an option or a choice nearly is; empty where nothing comes near."""
    for words, cls in commands().items():
        if tuple(args[: len(words)]) == words:
            return _nearest_option(args[len(words) :], _choices(cls))
    return ""


def _named(union: Any) -> Iterable[tuple[str, type]]:
    for member in get_args(union):
        cls, subcommand = get_args(member)
        yield subcommand.name, cls


def _require_one(word: Sequence[str], known: list[str], program: str) -> None:
    if not word or word[0].startswith("-") or word[0] in known:
        return
    near = difflib.get_close_matches(word[0], known, 1)
    meant = f"did you mean `{program} {near[0]}`? " if near else ""
    raise UsageError(
        f"there is no command {word[0][:60]!r}; {meant}`{program} --help` lists "
        f"{', '.join(known)}"
    )


def _choices(cls: type) -> dict[str, tuple[str, ...]]:
    """Options of a command and what each can be chosen from; nothing if anything goes.

    What has no name but a place is under the empty name.
    """
    hints = get_type_hints(cls, include_extras=True)
    found: dict[str, tuple[str, ...]] = {}
    for field in fields(cls):
        if is_dataclass(hint := hints[field.name]) and isinstance(hint, type):
            found |= _choices(hint)
        else:
            typed = tyro.conf.Positional not in getattr(hint, "__metadata__", ())
            name = f"--{field.name.replace('_', '-')}" if typed else ""
            found[name] = found.get(name, ()) + tuple(_literals(hint))
    return found


def _literals(hint: Any) -> Iterable[str]:
    if get_origin(hint) is Literal:
        yield from map(str, get_args(hint))
    for part in get_args(hint):
        yield from _literals(part)


def _nearest_option(args: Sequence[str], known: dict[str, tuple[str, ...]]) -> str:
    for index, arg in enumerate(args):
        name, _, value = arg.partition("=")
        if name.startswith("--") and name not in known:
            near = difflib.get_close_matches(name.replace("_", "-"), list(known), 1)
            if near:
                return f"did you mean {near[0]} instead of {name}?"
        elif known.get(name):
            value = value or "".join(args[index + 1 : index + 2])
            near = difflib.get_close_matches(value, known[name], 1)
            if near and value not in known[name]:
                return f"did you mean {name} {near[0]} instead of {value}?"
    first, places = "".join(args[:1]), known.get("", ())
    near = difflib.get_close_matches(first, places, 1)
    if near and first not in places:
        return f"did you mean {near[0]} instead of {first}?"
    return ""
