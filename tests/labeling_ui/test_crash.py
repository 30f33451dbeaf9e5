"""A server dies by SIGKILL while raters answer; nothing counted is lost."""

import asyncio
import itertools
import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from benchmarks.visitor import Visitor
from benchmarks.walks import walking_dataset
from data.answers.overlap import Overlap
from data.datasets.dataset import Dataset
from labeling_ui.web.tokens import TokenStore

RATERS = 8
KEYS = ("A better", "B better", "Equally good", "A much better", "B much better")


class Server:
    """`gaitpref label` in a process of its own."""

    def __init__(self, root: Path, *more: str) -> None:
        command = [sys.executable, "-m", "gaitpref", "label"]
        self.process = subprocess.Popen(
            [*command, "--dataset", str(root), "--port", "0", *more],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        lines = iter(self.process.stdout.readline, "")
        self.url = next(line for line in lines if "page is at" in line).split()[-1]

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *error: object) -> None:
        if self.process.poll() is None:
            self.end(signal.SIGKILL)

    def end(self, number: signal.Signals) -> int:
        """Send a signal and wait."""
        os.kill(self.process.pid, number)
        code = self.process.wait(timeout=30)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return code


async def answering(
    places: Sequence[tuple[str, str]], enough: Callable[[list[Visitor]], bool]
) -> list[Visitor]:
    """All raters, each at a page with a token, answer as fast as they may until
    `enough` says so."""
    visitors = [Visitor(url, token) for url, token in places]
    pages = [asyncio.create_task(visitor.run()) for visitor in visitors]
    tasks = [*pages]

    async def work(visitor: Visitor) -> None:
        await visitor.until_moving()
        await visitor.press("Close the dialog")
        for key in itertools.cycle(KEYS):
            await visitor.press(key)
            await asyncio.sleep(0.35)

    tasks += [asyncio.create_task(work(visitor)) for visitor in visitors]
    async with asyncio.timeout(120):
        while not enough(visitors):
            for page in pages:
                if page.done():
                    page.result()
            await asyncio.sleep(0.01)
    # What the dying server still sent is read, as a browser would.
    await asyncio.sleep(0.5)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return visitors


def stored(root: Path, answers: str | None = None) -> Counter[str]:
    """Current answers of every rater; none twice.

    A pair that somebody was shown is nobody else's, but those meant for several.
    """
    with Dataset.open(root, answers=answers).answers() as store:
        found = [answer for _, answer in store.current_answers()]
    keys = [(answer.rater_id, answer.pair_id) for answer in found]
    assert len(set(keys)) == len(keys)
    given, overlap = Counter(answer.pair_id for answer in found), Overlap()
    for pair_id, times in given.items():
        assert times <= (overlap.raters if overlap.takes(pair_id) else 1)
    return Counter(answer.rater_id for answer in found)


@pytest.mark.slow
def test_sigkill_loses_no_acknowledged_answer(tmp_path: Path) -> None:
    """What a rater's page counted is in the data base, and everybody goes on."""
    root = tmp_path / "set"
    walking_dataset(root, pairs=200)
    store = TokenStore(root)
    names = [f"rater{index}" for index in range(RATERS)]
    tokens = [store.add(name) for name in names]

    with Server(root) as doomed:

        def killed(visitors: list[Visitor]) -> bool:
            enough = all((visitor.answered or 0) >= 3 for visitor in visitors)
            if enough:
                doomed.end(signal.SIGKILL)
            return enough

        places = [(doomed.url, token) for token in tokens]
        visitors = asyncio.run(answering(places, killed))
    before = stored(root)
    for name, visitor in zip(names, visitors, strict=True):
        assert before[name] >= (visitor.answered or 0) >= 3

    def went_on(visitors: list[Visitor]) -> bool:
        return all(
            (visitor.answered or 0) >= before[name] + 2
            for name, visitor in zip(names, visitors, strict=True)
        )

    with Server(root) as server:
        asyncio.run(answering([(server.url, token) for token in tokens], went_on))
        assert server.end(signal.SIGTERM) == 0
    after = stored(root)
    assert all(after[name] >= before[name] + 2 for name in names)


@pytest.mark.slow
def test_one_of_two_hosts_is_killed_and_the_other_has_every_answer(
    postgres_answers: str, tmp_path: Path
) -> None:
    """Each has a copy of the data set, and PostgreSQL the answers: who was at the one
    that died goes on at the other, and nothing is asked or counted twice."""
    here, there = tmp_path / "here", tmp_path / "there"
    with walking_dataset(here, pairs=200).answers() as store:
        pairs = store.pairs()
    with Dataset.open(here, answers=postgres_answers).answers() as store:
        store.add_pairs(pairs)
    names = ["ann", "bob", "cem", "dia"]
    tokens = [TokenStore(here).add(name) for name in names]
    shutil.copytree(here, there)
    server = ("--answers", postgres_answers)
    at_kill: list[int] = []

    def went_on(visitors: list[Visitor]) -> bool:
        counts = [visitor.answered or 0 for visitor in visitors]
        if not at_kill and min(counts) >= 2:
            doomed.end(signal.SIGKILL)
            at_kill.extend(counts)
        return bool(at_kill) and min(counts[2:]) >= max(at_kill[2:]) + 1

    with Server(there, *server) as left, Server(here, *server) as doomed:
        urls = 2 * [doomed.url] + 2 * [left.url]
        places = list(zip(urls, tokens, strict=True))
        visitors = asyncio.run(answering(places, went_on))
        before = stored(there, postgres_answers)
        for name, visitor in zip(names, visitors, strict=True):
            assert before[name] >= (visitor.answered or 0) >= 2

        def moved(visitors: list[Visitor]) -> bool:
            return all(
                (visitor.answered or 0) >= before[name] + 1
                for name, visitor in zip(names, visitors, strict=False)
            )

        asyncio.run(answering([(left.url, token) for token in tokens[:2]], moved))
        assert left.end(signal.SIGTERM) == 0
    after = stored(there, postgres_answers)
    assert all(after[name] >= before[name] for name in names)
    assert all(after[name] >= before[name] + 1 for name in names[:2])
