"""Progress on the terminal (standard error), for everything that takes seconds."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from data.files.telling import Tell

from .terminal import PlainConsole

if TYPE_CHECKING:
    # Only named here: who fits a reward may have no simulator.
    from policy.training.ppo import IterationStats

Item = TypeVar("Item")

console = PlainConsole(stderr=True, soft_wrap=True)
_QUIET_S = 5.0
"""Nobody is left without a word for longer, where nothing can be drawn."""
_BAR_WIDTH = 12
"""Of a training: with its figures it fits a terminal of 80 columns."""


class TrainingBar:
    """A bar with steps/s, time left, return and tracking error.

    Where standard error is no terminal, a line soon and every tenth of the way instead.
    """

    def __init__(self, progress: Progress | None, title: str, steps: int) -> None:
        self._progress, self._title, self._steps = progress, title, max(steps, 1)
        self._tenths, self._begun_s = -1, time.monotonic()
        if progress is not None:
            self._task = progress.add_task(title, total=steps, figures="")

    def __call__(self, stats: IterationStats) -> None:
        """Show one iteration."""
        figures = f"{stats.steps_per_s:,.0f} steps/s  return {stats.mean_return:.2f}"
        # Who takes no step tracks nothing.
        if (error := stats.scalars.get("track/planar_error_m_s")) is not None:
            figures += f"  error {error:.2f} m/s"
        if self._progress is not None:
            self._progress.update(self._task, completed=stats.steps, figures=figures)
            return
        tenths = 10 * stats.steps // self._steps
        soon = 0 if time.monotonic() - self._begun_s >= _QUIET_S else 1
        if tenths >= soon and tenths > self._tenths:
            self._tenths = tenths
            left_s = max(0, self._steps - stats.steps) / max(stats.steps_per_s, 1e-9)
            console.print(
                f"{self._title}: {stats.steps:,} of {self._steps:,} steps, "
                f"{left_told(left_s)}  {figures}"
            )


@contextmanager
def training_bar(title: str, steps: int) -> Iterator[TrainingBar]:
    """A `TrainingBar` for `steps` environment steps."""
    if not console.is_terminal:
        yield TrainingBar(None, title, steps)
        return
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(_BAR_WIDTH),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[figures]}"),
        console=console,
    ) as progress:
        yield TrainingBar(progress, title, steps)


class _Lines(Progress):
    """A bar; where standard error is no terminal, lines while it takes its time."""

    def __init__(self, *columns: ProgressColumn, **settings: Any) -> None:
        super().__init__(*columns, **settings)
        self._said_s = time.monotonic()

    def update(self, task_id: TaskID, **changed: Any) -> None:
        super().update(task_id, **changed)
        self._say(task_id)

    def advance(self, task_id: TaskID, advance: float = 1) -> None:
        super().advance(task_id, advance)
        self._say(task_id)

    def _say(self, task_id: TaskID) -> None:
        now_s = time.monotonic()
        if not self.disable or now_s - self._said_s < _QUIET_S:
            return
        task = next(task for task in self.tasks if task.id == task_id)
        done, of, elapsed_s = task.completed, task.total, task.elapsed
        if not done or not of or not elapsed_s or done >= of:
            return
        self._said_s = now_s
        left = left_told(elapsed_s * (of - done) / done)
        console.print(f"{task.description}: {done:,.0f} of {of:,.0f}, {left}")


def left_told(seconds: float) -> str:
    """How much time is left, for people."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s left"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s left"
    return f"{whole // 3600} h {whole % 3600 // 60} min left"


@contextmanager
def counting_bar(title: str, total: int | None) -> Iterator[Progress]:
    """A bar of `total` parts, or of nobody knows yet how many;
    `progress.advance(progress.task_ids[0])` counts one."""
    with _Lines(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
    ) as progress:
        progress.add_task(title, total=total)
        yield progress


@contextmanager
def each_counted(
    title: str, items: Iterable[Item], total: int
) -> Iterator[Iterator[Item]]:
    """`items`, of which a bar counts every one that is taken."""
    with counting_bar(title, total) as bar:

        def each() -> Iterator[Item]:
            for item in items:
                bar.advance(bar.task_ids[0])
                yield item

        yield each()


@contextmanager
def counted(title: str) -> Iterator[Tell]:
    """A bar for what says itself how much of how much is done: call it with both.

    With 0 it begins, or begins anew; who has not begun is named, as by `working`.
    """
    with counting_bar(title, None) as bar, _named_soon(title) as unsaid:
        (task,) = bar.task_ids

        def tell(done: int, of: int) -> None:
            unsaid.cancel()
            if done == 0:
                bar.reset(task, total=of)
            else:
                bar.update(task, completed=done, total=of)

        yield tell


@contextmanager
def _named_soon(title: str) -> Iterator[threading.Timer]:
    """Say what is done if it takes its time, where standard error is no terminal."""
    timer = threading.Timer(_QUIET_S, lambda: console.print(f"{title} ..."))
    timer.daemon = True
    if not console.is_terminal:
        timer.start()
    try:
        yield timer
    finally:
        timer.cancel()


@contextmanager
def working(title: str) -> Iterator[None]:
    """A spinner and the time it has taken, where nothing says how much is left; where
    standard error is no terminal, one line if it takes its time."""
    if not console.is_terminal:
        with _named_soon(title):
            yield
        return
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
    ) as progress:
        progress.add_task(title, total=None)
        yield
