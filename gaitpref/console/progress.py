"""Progress on the terminal (standard error), for everything that takes seconds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from .terminal import PlainConsole

if TYPE_CHECKING:
    # Only named here: who fits a reward may have no simulator.
    from policy.training.ppo import IterationStats

console = PlainConsole(stderr=True, soft_wrap=True)


class TrainingBar:
    """A bar with steps/s, time left, return and tracking error.

    Where standard error is no terminal, a line every tenth of the way instead.
    """

    def __init__(self, progress: Progress | None, title: str, steps: int) -> None:
        self._progress, self._title, self._steps = progress, title, max(steps, 1)
        self._tenths = 0
        if progress is not None:
            self._task = progress.add_task(title, total=steps, figures="")

    def __call__(self, stats: IterationStats) -> None:
        """Show one iteration."""
        error = stats.scalars["track/planar_error_m_s"]
        figures = (
            f"{stats.steps_per_s:,.0f} steps/s  return {stats.mean_return:.2f}  "
            f"tracking error {error:.2f} m/s"
        )
        if self._progress is not None:
            self._progress.update(self._task, completed=stats.steps, figures=figures)
            return
        tenths = 10 * stats.steps // self._steps
        if tenths > self._tenths:
            self._tenths = tenths
            console.print(f"{self._title}: {stats.steps:,} steps  {figures}")


@contextmanager
def training_bar(title: str, steps: int) -> Iterator[TrainingBar]:
    """A `TrainingBar` for `steps` environment steps."""
    if not console.is_terminal:
        yield TrainingBar(None, title, steps)
        return
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[figures]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    ) as progress:
        yield TrainingBar(progress, title, steps)


@contextmanager
def counting_bar(title: str, total: int) -> Iterator[Progress]:
    """A bar of `total` parts; `progress.advance(progress.task_ids[0])` counts one."""
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
    ) as progress:
        progress.add_task(title, total=total)
        yield progress


@contextmanager
def working(title: str) -> Iterator[None]:
    """A spinner and the time it has taken, where nothing says how much is left."""
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        progress.add_task(title, total=None)
        yield
