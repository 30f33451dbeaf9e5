"""When a run was started, with what, and when each of its rounds was done.

It decides nothing, and differs between runs that are equal otherwise.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from data.errors import FileError
from data.files.files import read_file, write_atomically

JOURNAL_NAME = "journal.jsonl"
_MOST_BYTES = 2**20
_VERSIONS = ("gaitpref", "torch", "mujoco", "rsl-rl-lib")
_DECIDING = ("rewardmodel", "policy", "gaitpref/method", "gaitpref/training")
"""Packages whose code and constants decide how a run goes."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """A command that began the run, or went on with it."""

    at: datetime
    command: str
    """As it was typed, with what differs from the defaults; empty from a program."""
    versions: Mapping[str, str]
    """Of Python and packages; of gaitpref also what its code is, in eight letters."""
    processes: int = 1
    """That train together."""


@dataclass(frozen=True, kw_only=True)
class Journal:
    """What a run's journal tells; nothing of a run that has none."""

    starts: tuple[Start, ...] = ()
    done: Mapping[int, datetime]
    """When each round was."""

    def took_s(self, number: int) -> float | None:
        """How long a round took, from its last start on; None where that is not
        known."""
        if number not in self.done or not self.starts:
            return None
        end = self.done[number]
        begun = [start.at for start in self.starts if start.at <= end]
        begun += [at for of, at in self.done.items() if of < number and at <= end]
        return (end - max(begun)).total_seconds() if begun else None


def note_start(run: Path, command: str, processes: int = 1) -> str:
    """Add that the run is begun or gone on with; gives what is not as it was when it
    was begun, of all that decides and that no setting tells."""
    versions = {"python": platform.python_version()}
    for name in _VERSIONS:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    if "gaitpref" in versions:
        versions["gaitpref"] += f"+{_code()}"
    begun = read_journal(run).starts[:1]
    told = {"command": command, "versions": versions, "processes": processes}
    _add(run, {"what": "start", **told})
    now = {**versions, "processes": processes}
    return ", ".join(
        f"{name} {old} -> {now[name]}"
        for start in begun
        for name, old in {**start.versions, "processes": start.processes}.items()
        if now.get(name, old) != old
    )


@cache
def _code() -> str:
    """Eight letters that are others where the code is that decides."""
    root = Path(__file__).parents[2]
    files = sorted(file for part in _DECIDING for file in (root / part).rglob("*.py"))
    code = hashlib.sha256()
    for file in files:
        code.update(file.relative_to(root).as_posix().encode() + file.read_bytes())
    return code.hexdigest()[:8]


def note_round(run: Path, number: int) -> None:
    """Add that a round is done, if that does not stand there yet."""
    if number not in read_journal(run).done:
        _add(run, {"what": "round", "round": number})


def read_journal(run: Path) -> Journal:
    """The journal of a run; lines that cannot be read are passed over."""
    starts, done = [], {}
    for line in _lines(run):
        try:
            entry = json.loads(line)
            at = datetime.fromisoformat(entry["utc"]).astimezone(UTC)
            if entry["what"] == "start":
                start = Start(
                    at=at,
                    command=str(entry["command"]),
                    versions=entry["versions"],
                    processes=int(entry.get("processes", 1)),
                )
                starts.append(start)
            else:
                done.setdefault(int(entry["round"]), at)
        except (ArithmeticError, LookupError, TypeError, ValueError):
            continue
    return Journal(starts=tuple(starts), done=done)


def _lines(run: Path) -> list[bytes]:
    try:
        return read_file(run / JOURNAL_NAME, _MOST_BYTES).splitlines()
    except (FileError, OSError):
        return []


def _add(run: Path, entry: dict[str, Any]) -> None:
    utc = datetime.now(UTC).isoformat(timespec="seconds")
    lines = [*_lines(run), json.dumps({"utc": utc, **entry}).encode()]
    write_atomically(run / JOURNAL_NAME, b"\n".join(lines) + b"\n")
