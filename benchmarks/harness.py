"""What the benchmarks share: commands as processes, a table, a JSON file."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from data.files.files import write_atomically

Figure = float | int | str | bool | None


@dataclass(frozen=True)
class Run:
    """A command that ran to its end."""

    wall_s: float
    cpu_s: float
    """Time of a processor that it took."""
    peak_mb: float
    """Largest resident memory of the process itself."""
    stdout: str


def gaitpref(*args: str | Path, well: Sequence[int] = (0,)) -> Run:
    """Run a `gaitpref` command in a process of its own, that ends `well` with one of
    these codes.

    Raises:
        RuntimeError: it failed.
    """
    command = [sys.executable, "-m", "gaitpref", *map(str, args)]
    start_s = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process.stdout:
        stdout = process.stdout.read()
    # `wait4` tells the memory of this one process, not of all children so far.
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    wall_s = time.perf_counter() - start_s
    if process.returncode not in well:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    took_s = usage.ru_utime + usage.ru_stime
    return Run(wall_s, took_s, usage.ru_maxrss / 1024, stdout)


def publish(
    title: str,
    figures: Mapping[str, Figure],
    goals: Mapping[str, str],
    path: Path | None,
) -> None:
    """Print the figures beside their goals, and write them as one flat JSON object."""
    table = Table("figure", "value", "goal", title=title)
    for name, value in figures.items():
        shown = f"{value:,.3f}" if isinstance(value, float) else str(value)
        table.add_row(name, shown, goals.get(name, ""))
    Console().print(table)
    if path is not None:
        write_atomically(path, (json.dumps(dict(figures), indent=1) + "\n").encode())


def median(values: Sequence[float]) -> float:
    """The middle value, or the mean of the two middle ones."""
    ordered = sorted(values)
    half = len(ordered) // 2
    if len(ordered) % 2:
        return ordered[half]
    return (ordered[half - 1] + ordered[half]) / 2


def others_at_work() -> float:
    """How many processes wanted a processor in the last minute: what else was running,
    where it is asked before anything is measured."""
    return round(os.getloadavg()[0], 1)


def cpu_s(pid: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
