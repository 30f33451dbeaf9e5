"""What the page of a run says of the run: when, with what, and where things are."""

from __future__ import annotations

import html
from pathlib import Path

from .journal import Journal, read_journal

_LINKS = (
    ("config.yaml", "all settings"),
    ("dataset", "the episodes and answers"),
    ("rounds", "policies, rewards and TensorBoard files of each round"),
)


def about_section(run: Path, *, commands: tuple[tuple[str, str], ...]) -> str:
    """When the run was, with which command and versions, and what shows more of it.

    Args:
        run: The run's directory.
        commands: What each does, and the command.
    """
    journal = read_journal(run)
    rows = [*_times(journal), *_started(journal)]
    listed = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in rows)
    links = "".join(
        f'<li><a href="../{name}">{name}</a>: {meaning}</li>'
        for name, meaning in _LINKS
        if (run / name).exists()
    )
    typed = "".join(
        f"<li>{meaning}: <code>{html.escape(command)}</code></li>"
        for meaning, command in commands
    )
    return (
        f'<h2>About this run</h2><dl class="about">{listed}</dl><ul>{typed}{links}</ul>'
    )


def took_told(seconds: float) -> str:
    """A duration, as people say it."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _times(journal: Journal) -> list[tuple[str, str]]:
    if not journal.starts or not journal.done:
        return []
    began, ended = journal.starts[0].at, max(journal.done.values())
    rounds = [
        f"round {number}: {took_told(took_s)}"
        for number in sorted(journal.done)
        if (took_s := journal.took_s(number)) is not None
    ]
    again = len(journal.starts) - 1
    resumed = f", started again {again} times" if again > 1 else ""
    if again == 1:
        resumed = ", started again once"
    return [
        ("begun", f"{began:%Y-%m-%d %H:%M} UTC"),
        ("newest round", f"{ended:%Y-%m-%d %H:%M} UTC"),
        ("took", f"{took_told((ended - began).total_seconds())}{resumed}"),
        ("of that", ", ".join(rounds)),
    ]


def _started(journal: Journal) -> list[tuple[str, str]]:
    if not journal.starts:
        return []
    last = journal.starts[-1]
    versions = ", ".join(f"{name} {version}" for name, version in last.versions.items())
    rows = [("versions", html.escape(versions))]
    if last.command:
        rows.insert(0, ("command", f"<code>{html.escape(last.command)}</code>"))
    return rows
