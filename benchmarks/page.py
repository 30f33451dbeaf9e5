"""How fast the labeling page is: `python -m benchmarks.page [--quick] [--json FILE]`.

The server runs in a process of its own; every visitor decodes every frame. With
`--crowd 24 --pairs 200000 --answered 20000 --database postgresql`, that many people
answer at their own pace, and what they wait for is measured.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from data.answers.address import Address
from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.page.page_access import Desk
from labeling_ui.page.store_thread import Worker
from labeling_ui.questions.judgement import Judgement, Outcome
from labeling_ui.web.tokens import TokenStore

from .answer_cost import Database, empty_store, fill
from .harness import cpu_s
from .visitor import Visitor
from .walks import walking_clips, walking_dataset

RATERS = 8
CROWD_EPISODES = 40
"""Clips of these make more than 200,000 pairs."""
PACE_S = (3.0, 9.0)
"""Between two answers of a person in a crowd: some 600 an hour."""
CLIP_STEPS = 60
LONG_STEPS = 1500
"""Half a minute, so that no clip ends, and rests, while poses are counted."""
KEYS = ("A better", "B better", "Equally good")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure the labeling page."""

    quick: bool = False
    """A third of the time."""
    crowd: int = 0
    """Raters who answer at human pace; 0 measures single pages instead."""
    pairs: int = 20_000
    """Pairs a crowd finds."""
    answered: int = 0
    """Pairs that are answered before a crowd comes."""
    database: Database = "sqlite"
    """Where a crowd's answers go; a server of PostgreSQL is started for it."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True, kw_only=True)
class CrowdFigures:
    """What is measured of a crowd."""

    raters: int
    answers: int
    commit_median_ms: float
    """From the key press to the committed row."""
    commit_p99_ms: float
    next_page_median_ms: float
    """From the key press to the first pose of the next pair."""
    next_page_p99_ms: float
    cores: float
    """Share of a core that server and proxy use."""
    processor_wait_share: float
    """As of `Figures`."""


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


def main(options: Options) -> Figures | CrowdFigures:
    """Measure, print and write the figures."""
    figures = _of_crowd(options) if options.crowd else _of_pages(options)
    print(json.dumps(asdict(figures), indent=1))
    if options.json is not None:
        options.json.write_text(json.dumps(asdict(figures)) + "\n")
    return figures


def _of_crowd(options: Options) -> CrowdFigures:
    names = [f"rater{index}" for index in range(options.crowd)]
    answers = 4 if options.quick else 25
    with (
        tempfile.TemporaryDirectory() as folder,
        empty_store(options.database) as (address, _),
    ):
        root = Path(folder) / "set"
        dataset = walking_dataset(root, pairs=0, episodes=CROWD_EPISODES)
        clips = walking_clips(dataset.entries(), CLIP_STEPS)
        with AnswerStore.open(address) as store:
            count, answered = options.pairs, options.answered
            fill(store, clips, names, pairs=count, answered=answered)
        run = asyncio.run(
            _visited(root, address, names, watch_s=0.0, answers=answers, pace_s=PACE_S)
        )
    waits_ms = np.add(run.commits_ms, run.next_ms)
    return CrowdFigures(
        raters=options.crowd,
        answers=len(waits_ms),
        commit_median_ms=round(float(np.median(run.commits_ms)), 1),
        commit_p99_ms=round(float(np.percentile(run.commits_ms, 99)), 1),
        next_page_median_ms=round(float(np.median(waits_ms)), 1),
        next_page_p99_ms=round(float(np.percentile(waits_ms, 99)), 1),
        cores=round(run.cores, 3),
        processor_wait_share=round(run.processor_wait_share, 2),
    )


def _of_pages(options: Options) -> Figures:
    watch_s, answers = (4.0, 6) if options.quick else (12.0, 40)
    one = asyncio.run(_measured(1, watch_s, 0, LONG_STEPS))
    eight = asyncio.run(_measured(RATERS, watch_s, 0, LONG_STEPS))
    busy = asyncio.run(_measured(RATERS, 0.0, answers, CLIP_STEPS))
    return Figures(
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
        names = [f"rater{index}" for index in range(raters)]
        return await _visited(root, None, names, watch_s=watch_s, answers=answers)


async def _visited(
    root: Path,
    address: Address | None,
    names: list[str],
    *,
    watch_s: float,
    answers: int,
    pace_s: tuple[float, float] | None = None,
) -> _Run:
    """A server of the data set at `root`, visited by raters of these names.

    Args:
        root: The data set.
        address: Where its answers are; None takes its own file.
        names: Who comes.
        watch_s: How long they only watch.
        answers: How many each of them gives then.
        pace_s: Time between two answers, drawn between these; None is as fast as it
            may be, in turn.
    """
    store = TokenStore(root)
    tokens = [store.add(name) for name in names]
    here, there = multiprocessing.Pipe()
    context = multiprocessing.get_context("spawn")
    server = context.Process(target=_serve, args=(root, address, len(names), there))
    server.start()
    assert server.pid is not None
    visitors = [Visitor(url, token) for url in [here.recv()] for token in tokens]
    tasks = [asyncio.create_task(visitor.run()) for visitor in visitors]
    for visitor in visitors:
        await visitor.until_moving()
        await visitor.press("Close the dialog")
    await asyncio.sleep(1.0)

    begin, used = time.monotonic(), cpu_s(server.pid)
    await asyncio.sleep(watch_s)
    span, used = time.monotonic() - begin, cpu_s(server.pid) - used
    rates = [
        0.0
        if watch_s == 0
        else sum(begin <= at < begin + span for at in visitor.pose_times) / span
        for visitor in visitors
    ]
    fsync_ms = _fsync_ms(root)
    ran, waited = _scheduled_s(server.pid)
    answering, answered_s = cpu_s(server.pid), time.monotonic()
    presses = await asyncio.gather(
        *(
            _answer(visitor, answers, _pauses_s(index, pace_s))
            for index, visitor in enumerate(visitors)
        )
    )
    if watch_s == 0.0:
        span = time.monotonic() - answered_s
        used = cpu_s(server.pid) - answering
    ran, waited = np.subtract(_scheduled_s(server.pid), (ran, waited))
    for task in tasks:
        task.cancel()
    here.send("stop")
    commits: dict[str, list[float]] = here.recv()
    server.join()
    commit_ms, next_ms = [], []
    for name, moments in zip(names, presses, strict=True):
        for (pressed, moving), done in zip(moments, commits.get(name, []), strict=True):
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


def _pauses_s(index: int, pace_s: tuple[float, float] | None) -> Iterator[float]:
    """What a rater waits before each answer, s."""
    rng = np.random.default_rng(index)
    while True:
        yield 1.2 + 0.13 * index if pace_s is None else rng.uniform(*pace_s)


async def _answer(
    visitor: Visitor, answers: int, pauses_s: Iterator[float]
) -> list[tuple[float, float]]:
    """Press and first-pose times of `answers` answers."""
    moments = []
    before = visitor.answered or 0
    for number, pause_s in zip(range(answers), pauses_s, strict=False):
        await asyncio.sleep(pause_s)
        pressed = await visitor.press(KEYS[number % len(KEYS)])
        shown = await visitor.until_answered(before + number + 1)
        while visitor.pose_times[-1] < shown:
            await asyncio.sleep(0.002)
        moments.append((pressed, visitor.pose_times[-1]))
    return moments


def _serve(root: Path, address: Address | None, raters: int, pipe: Connection) -> None:
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
    cfg = LabelCfg(port=0, most_raters=raters)
    with LabelServer(Dataset.open(root, answers=address), cfg) as server:
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


if __name__ == "__main__":
    main(tyro.cli(Options))
