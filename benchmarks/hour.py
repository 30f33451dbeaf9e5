"""An hour of answering, as fast as the page goes: `python -m benchmarks.hour`.

Eight raters, or `--raters 32`, answer as often as people do in an hour at six seconds a
pair, but each as soon as the next pair is there. Then the answers their pages counted
are looked for in the store, and the memory of the server at the end is held against
what it was early.
"""

from __future__ import annotations

import asyncio
import itertools
import multiprocessing
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import tyro

from data.datasets.dataset import Dataset
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.rater_session import QueueCfg
from labeling_ui.web.tokens import TokenStore

from .harness import cpu_s, publish
from .visitor import Visitor
from .walks import walking_dataset

RATERS = 8
ANSWERS = 600
WARM_UP = 0.3
"""Part of the answers after which caches are full: from there on memory is watched."""
KEYS = ("A better", "B better", "Equally good", "A much better", "B much better")
AT_ONCE = GuardCfg(min_shown_s=0.0, repeat_gap_s=0.0, same_verdict_s=0.0)
GOALS = {
    "hour_lost": "0",
    "hour_doubled": "0",
    "hour_memory_growth_mb": "flat",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Let raters answer for an hour, in short."""

    raters: int = RATERS
    """How many at once."""
    answers: int = ANSWERS
    """Answers each rater gives."""
    quick: bool = False
    """A tenth of the answers."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What came of the hour."""

    hour_answers: int
    """Counted by the pages of all raters."""
    hour_lost: int
    """Counted by a page, and not in the store."""
    hour_doubled: int
    """In the store, and counted by no page, or twice for one question."""
    hour_memory_mb: float
    """Resident memory of the server when its caches are full."""
    hour_memory_growth_mb: float
    """Resident memory the server had more at the end."""
    hour_wall_s: float
    hour_cores: float
    """Processors the server used."""


def main(options: Options) -> Figures:
    """Measure, print and write the figures."""
    answers = options.answers // 10 if options.quick else options.answers
    figures = measured(answers, options.raters)
    publish("An hour of answering", asdict(figures), GOALS, options.json)
    return figures


def measured(answers: int, raters: int = RATERS) -> Figures:
    """Let so many raters give that many answers each."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "set"
        # What a rater is shown next is kept from the others: two more for each.
        walking_dataset(root, pairs=raters * (answers + 2), episodes=40)
        tokens = TokenStore(root)
        names = [f"rater{index}" for index in range(raters)]
        visitors = {name: tokens.add(name) for name in names}
        here, there = multiprocessing.Pipe()
        server = multiprocessing.get_context("spawn").Process(
            target=_serve, args=(root, raters, there)
        )
        server.start()
        assert server.pid is not None
        url, begin, used_s = here.recv(), time.monotonic(), cpu_s(server.pid)
        counted, early_mb, late_mb = asyncio.run(
            _answered(url, visitors, answers, server.pid)
        )
        wall_s, used_s = time.monotonic() - begin, cpu_s(server.pid) - used_s
        here.send("stop")
        server.join()
        stored, twice = _stored(root)
        missing = {name: counted[name] - stored[name] for name in names}
        return Figures(
            hour_answers=sum(counted.values()),
            hour_lost=sum(max(count, 0) for count in missing.values()),
            hour_doubled=twice + sum(max(-count, 0) for count in missing.values()),
            hour_memory_mb=round(early_mb, 1),
            hour_memory_growth_mb=round(late_mb - early_mb, 1),
            hour_wall_s=round(wall_s, 1),
            hour_cores=round(used_s / wall_s, 2),
        )


async def _answered(
    url: str, tokens: dict[str, str], answers: int, pid: int
) -> tuple[Counter[str], float, float]:
    """Answers each page counted; the server's memory early and at the end, MB."""
    visitors = {name: Visitor(url, token) for name, token in tokens.items()}
    pages = [asyncio.create_task(visitor.run()) for visitor in visitors.values()]
    early_mb: list[float] = []

    async def work(visitor: Visitor) -> None:
        await visitor.until_moving()
        await visitor.press("Close the dialog")
        for number, key in zip(range(answers), itertools.cycle(KEYS), strict=False):
            while not visitor.open:
                await asyncio.sleep(0.01)
            await visitor.press(key)
            await visitor.until_answered(number + 1)
            if number >= WARM_UP * answers and not early_mb:
                early_mb.append(_memory_mb(pid))

    work_of_all = asyncio.gather(*map(work, visitors.values()))
    await asyncio.wait({work_of_all, *pages}, return_when=asyncio.FIRST_COMPLETED)
    for page in pages:
        if page.done():
            raise RuntimeError(f"a page ended: {page}")
    await work_of_all
    late_mb = _memory_mb(pid)
    for page in pages:
        page.cancel()
    counted = Counter({name: v.answered or 0 for name, v in visitors.items()})
    return counted, early_mb[0], late_mb


def _stored(root: Path) -> tuple[Counter[str], int]:
    """Current answers of every rater, and how many answer a question again."""
    with Dataset.open(root).answers() as store:
        answers = [answer for _, answer in store.current_answers()]
    asked = Counter((a.rater_id, a.pair_id, a.role) for a in answers)
    twice = sum(count - 1 for count in asked.values())
    return Counter(answer.rater_id for answer in answers), twice


def _serve(root: Path, raters: int, pipe: Connection) -> None:
    """Serve until told to stop, without the pauses that tell people from held keys."""
    cfg = LabelCfg(port=0, most_raters=raters, queue=QueueCfg(guard=AT_ONCE))
    with LabelServer(Dataset.open(root), cfg) as server:
        pipe.send(server.url)
        pipe.recv()


def _memory_mb(pid: int) -> float:
    """Resident memory of a process."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise RuntimeError(f"process {pid} is gone")


if __name__ == "__main__":
    main(tyro.cli(Options))
