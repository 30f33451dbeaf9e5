"""How fast the labeling page is: `python -m benchmarks.page [--quick] [--json FILE]`.

The server runs in a process of its own; every visitor decodes every frame.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import tempfile
import time
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from data.datasets.dataset import Dataset
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.page.page_access import Desk
from labeling_ui.page.store_thread import Worker
from labeling_ui.questions.judgement import Judgement, Outcome
from labeling_ui.web.tokens import TokenStore

from .visitor import Visitor
from .walks import walking_dataset

RATERS = 8
CLIP_STEPS = 60
LONG_STEPS = 1500
"""Half a minute, so that no clip ends, and rests, while poses are counted."""
KEYS = ("A better", "B better", "Equally good")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure the labeling page."""

    quick: bool = False
    """A third of the time."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What is measured."""

    cores_8_raters: float
    """Share of a core that server and proxy use while eight raters watch."""
    cores_1_rater: float
    poses_per_second_min: float
    """Delivered to the worst served of eight raters."""
    commit_p99_ms: float
    """From the key press to the committed row."""
    commit_median_ms: float
    fsync_ms: float
    """What one bare fsync takes in the same folder, median: a commit holds one."""
    processor_wait_share: float
    """While raters answer: of the time that threads of the server could have run, the
    part they waited for a processor. On a machine without other work it is near 0."""
    next_pair_ms: float
    """From the committed row to the first pose of the next pair, 95th percentile."""
    first_pair_s: float
    """From opening the page to the first pose, the slowest of eight at once."""


def main(options: Options) -> Figures:
    """Measure, print and write the figures."""
    watch_s, answers = (4.0, 6) if options.quick else (12.0, 40)
    one = asyncio.run(_measured(1, watch_s, 0, LONG_STEPS))
    eight = asyncio.run(_measured(RATERS, watch_s, 0, LONG_STEPS))
    busy = asyncio.run(_measured(RATERS, 0.0, answers, CLIP_STEPS))
    figures = Figures(
        cores_8_raters=round(eight.cores, 3),
        cores_1_rater=round(one.cores, 3),
        poses_per_second_min=round(eight.poses_per_second_min, 1),
        commit_p99_ms=round(float(np.percentile(busy.commits_ms, 99)), 1),
        commit_median_ms=round(float(np.median(busy.commits_ms)), 1),
        fsync_ms=round(busy.fsync_ms, 1),
        processor_wait_share=round(busy.processor_wait_share, 2),
        next_pair_ms=round(float(np.percentile(busy.next_ms, 95)), 1),
        first_pair_s=round(busy.first_pair_s, 2),
    )
    print(json.dumps(asdict(figures), indent=1))
    if options.json is not None:
        options.json.write_text(json.dumps(asdict(figures)) + "\n")
    return figures


@dataclass(frozen=True, kw_only=True)
class _Run:
    """One server and its visitors."""

    cores: float
    poses_per_second_min: float
    commits_ms: list[float]
    fsync_ms: float
    processor_wait_share: float
    next_ms: list[float]
    first_pair_s: float


async def _measured(raters: int, watch_s: float, answers: int, clip_steps: int) -> _Run:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "set"
        walking_dataset(
            root,
            pairs=60 + raters * answers * 2,
            clip_steps=clip_steps,
            steps=max(300, clip_steps + 100),
        )
        store = TokenStore(root)
        names = [f"rater{index}" for index in range(raters)]
        tokens = [store.add(name) for name in names]
        here, there = multiprocessing.Pipe()
        context = multiprocessing.get_context("spawn")
        server = context.Process(target=_serve, args=(root, there))
        server.start()
        assert server.pid is not None
        visitors = [Visitor(url, token) for url in [here.recv()] for token in tokens]
        tasks = [asyncio.create_task(visitor.run()) for visitor in visitors]
        for visitor in visitors:
            await visitor.until_moving()
            await visitor.press("Close the dialog")
        await asyncio.sleep(1.0)

        begin, used = time.monotonic(), _cpu_s(server.pid)
        await asyncio.sleep(watch_s)
        span, used = time.monotonic() - begin, _cpu_s(server.pid) - used
        rates = [
            0.0
            if watch_s == 0
            else sum(begin <= at < begin + span for at in visitor.pose_times) / span
            for visitor in visitors
        ]
        fsync_ms = _fsync_ms(root)
        ran, waited = _scheduled_s(server.pid)
        presses = await asyncio.gather(
            *(
                _answer(visitor, index, answers)
                for index, visitor in enumerate(visitors)
            )
        )
        ran, waited = np.subtract(_scheduled_s(server.pid), (ran, waited))
        for task in tasks:
            task.cancel()
        here.send("stop")
        commits: dict[str, list[float]] = here.recv()
        server.join()
        commit_ms, next_ms = [], []
        for name, moments in zip(names, presses, strict=True):
            for (pressed, moving), done in zip(
                moments, commits.get(name, []), strict=True
            ):
                commit_ms.append(1000 * (done - pressed))
                next_ms.append(1000 * (moving - done))
        return _Run(
            cores=used / max(span, 1e-9),
            poses_per_second_min=min(rates),
            commits_ms=commit_ms,
            fsync_ms=fsync_ms,
            processor_wait_share=float(waited / max(ran + waited, 1e-9)),
            next_ms=next_ms,
            first_pair_s=max(visitor.first_pose_s or np.inf for visitor in visitors),
        )


async def _answer(
    visitor: Visitor, index: int, answers: int
) -> list[tuple[float, float]]:
    """Press and first-pose times of `answers` answers."""
    moments = []
    for number in range(answers):
        await asyncio.sleep(1.2 + 0.13 * index)
        pressed = await visitor.press(KEYS[number % len(KEYS)])
        shown = await visitor.until_answered(number + 1)
        while visitor.pose_times[-1] < shown:
            await asyncio.sleep(0.002)
        moments.append((pressed, visitor.pose_times[-1]))
    return moments


def _serve(root: Path, pipe: Connection) -> None:
    """Serve until told to stop; then tell when each rater's answers were committed."""
    commits: dict[str, list[float]] = {}
    fresh: list[str] = []
    answer, store_all = Desk.answer, Worker.store_all

    def noted(desk: Desk, judgement: Judgement) -> Outcome:
        outcome = answer(desk, judgement)
        if outcome.accepted:
            fresh.append(desk.rater_id)
        return outcome

    def timed(worker: Worker, stores: list[Any]) -> None:
        store_all(worker, stores)
        for rater_id in fresh:
            commits.setdefault(rater_id, []).append(time.monotonic())
        fresh.clear()

    # The two places that know whose row is stored, and when it is on the disk.
    setattr(Desk, "answer", noted)  # noqa: B010
    setattr(Worker, "store_all", timed)  # noqa: B010
    with LabelServer(Dataset.open(root), LabelCfg(port=0)) as server:
        pipe.send(server.url)
        pipe.recv()
    pipe.send(commits)


def _fsync_ms(folder: Path) -> float:
    """Median time to write what an answer takes and wait for the disk, ms."""
    times_ms = []
    with (folder / "bare").open("wb", buffering=0) as file:
        for _ in range(50):
            begin = time.monotonic()
            file.write(bytes(16384))
            os.fsync(file.fileno())
            times_ms.append(1000 * (time.monotonic() - begin))
    return float(np.median(times_ms))


def _scheduled_s(pid: int) -> tuple[float, float]:
    """Time that the threads of a process ran, and that they waited to run, s."""
    stats = [
        (task / "schedstat").read_text().split()
        for task in Path(f"/proc/{pid}/task").iterdir()
    ]
    ran, waited = np.array(stats, dtype=float)[:, :2].sum(axis=0) / 1e9
    return float(ran), float(waited)


def _cpu_s(pid: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main(tyro.cli(Options))
