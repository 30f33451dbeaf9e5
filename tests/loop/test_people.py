"""The loop with people: one page over all rounds, answers at any time, patience."""

from __future__ import annotations

import asyncio
import itertools
import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks.visitor import Visitor
from data.answers.overlap import Overlap
from data.answers.question_board import QuestionBoard
from data.datasets.dataset import Dataset
from data.features import column
from gaitpref.loop.run_config import claim
from gaitpref.loop.run_inputs import inputs_of
from labeling_ui.web.tokens import TokenStore
from rewardmodel.answers.answered_pairs import count_evidence
from tests.helpers.local_host import free_port
from tests.helpers.small_loop import human_cfg

LIMIT_S = 180.0
"""For anything to come: the machine may be busy."""

Part = Callable[[Visitor], Coroutine[None, None, None]]


@contextmanager
def running(run: Path, port: int, *options: str) -> Iterator[subprocess.Popen[bytes]]:
    """The small loop as a process, once its page is up; killed at the end."""
    command = [
        sys.executable,
        "-m",
        "tests.helpers.small_loop",
        str(run),
        "--port",
        str(port),
    ]
    log = run.with_suffix(".log")
    with log.open("wb") as file:
        process = subprocess.Popen([*command, *options], stderr=file)
    try:
        deadline_s = time.monotonic() + LIMIT_S
        while "the labeling page is at" not in log.read_text():
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        yield process
    finally:
        process.kill()
        process.wait()


async def _visit(port: int, token: str, part: Part) -> None:
    """Do a part of the work at the page."""
    async with asyncio.timeout(LIMIT_S):
        visitor = Visitor(f"http://127.0.0.1:{port}", token)
        page = asyncio.create_task(visitor.run())
        work = asyncio.create_task(part(visitor))
        await asyncio.wait({page, work}, return_when=asyncio.FIRST_COMPLETED)
        page.cancel()
        assert work.done(), f"the page ended: {page}, {visitor.close_code}"
        await work


async def until(condition: Callable[[], bool]) -> None:
    """Wait for something that will come."""
    while not condition():
        await asyncio.sleep(0.02)


async def answer(run: Path, visitor: Visitor, enough: Callable[[], bool]) -> None:
    """Answer until it is enough, never twice in a row with the same key."""
    for much in itertools.cycle(("", "much ")):
        if enough():
            return
        before = visitor.answered
        if visitor.open:
            await visitor.press(f"{preferred(run)} {much}better")
        for _ in range(20):
            if visitor.answered != before:
                break
            await asyncio.sleep(0.05)


def preferred(run: Path) -> str:
    """Which of both shown robots stands higher: what agrees is trained on."""
    dataset = Dataset.open(run / "dataset")
    with dataset.answers() as store:
        shown = QuestionBoard(store, Overlap()).shown("ann")
        if not shown:
            return "A"
        pair = store.pair(shown[-1].pair_id)
    a, b = (
        dataset.clip_features(clip)[:, column("base_height")].mean()
        for clip in (pair.a, pair.b)
    )
    return "A" if (a > b) == (shown[-1].shown_left == "a") else "B"


def evidence(run: Path) -> int:
    """Preferences a fit would use."""
    with Dataset.open(run / "dataset").answers() as store:
        return count_evidence(store)


def fitted(run: Path, round: int) -> int:
    """Preferences the reward of a round was fitted to."""
    report = json.loads((run / f"rounds/{round:02d}/report.json").read_text())
    return report["fit"]["answers"] - report["fit"]["ties"]


def answered_meanwhile(run: Path) -> list[str]:
    """Ids of the answers to pairs that round 1 did not ask itself."""
    with Dataset.open(run / "dataset").answers() as store:
        given = [answer for pair, answer in store.all_answers() if pair.meanwhile == 1]
    return [answer.answer_id for answer in given]


@pytest.mark.slow
def test_people_answer_when_they_like(tmp_path: Path) -> None:
    """Killed while it waits and while it trains, patient for a while, answered while it
    trains, and asked then."""
    run, port = tmp_path / "run", free_port()
    claim(run, human_cfg(), inputs_of(human_cfg()).contents)
    token = TokenStore(Dataset.create(run / "dataset").root).add("ann")

    async def first_three(visitor: Visitor) -> None:
        await until(lambda: visitor.dialog_shown)
        await visitor.press("Close the dialog")
        # Somebody may come before there is a pair.
        await until(lambda: visitor.open > 0)
        await answer(run, visitor, lambda: evidence(run) >= 3)

    with running(run, port) as loop:
        asyncio.run(_visit(port, token, first_three))
        loop.send_signal(signal.SIGKILL)
        loop.wait()
    assert evidence(run) == 3

    late: list[int] = []

    async def while_training(visitor: Visitor) -> None:
        await until(lambda: visitor.open > 0)
        await answer(run, visitor, lambda: evidence(run) >= 8)
        # Nobody answers any more, so the loop goes on when its patience is over.
        await until(lambda: any("2 of 2: training" in words for words in visitor.loop))
        assert any("1 of 2: waiting for" in words for words in visitor.loop)
        assert any("pairs of earlier clips" in words for words in visitor.loop)
        before = evidence(run)
        await answer(run, visitor, lambda: len(answered_meanwhile(run)) >= 1)
        late.append(evidence(run) - before)
        assert not (run / "rounds/01/policy/policy.pt").exists()

    with running(run, port, "--patience", "10") as loop:
        asyncio.run(_visit(port, token, while_training))
        loop.send_signal(signal.SIGKILL)
        loop.wait()
    given = answered_meanwhile(run)
    assert given

    async def the_rest(visitor: Visitor) -> None:
        ended = run / "rounds/01/reward/reward.json"
        await answer(run, visitor, ended.exists)

    with running(run, port, "--patience", "10") as loop:
        asyncio.run(_visit(port, token, the_rest))
        assert loop.wait(LIMIT_S) == 0
    assert fitted(run, 0) == 8
    # What was answered before the kill is there once, and counted in the next fit.
    assert answered_meanwhile(run)[: len(given)] == given
    assert fitted(run, 1) >= 8 + late[0]
    with Dataset.open(run / "dataset").answers() as store:
        of_first_round = [
            pair for pair, answer in store.current_answers(round=0) if not pair.gold
        ]
    assert len({pair.pair_id for pair in of_first_round}) >= 10
    assert fitted(run, 1) > 10


def test_a_busy_port_is_refused_before_anything_is_trained(tmp_path: Path) -> None:
    """One line that names the port."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        command = [
            sys.executable,
            "-m",
            "gaitpref",
            "loop",
            "--rater",
            "human",
        ]
        done = subprocess.run(
            [*command, "--run", tmp_path / "run", "--port", str(port), "--no-auth"],
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert f"port {port} on 127.0.0.1 cannot be opened" in line
    assert not list(tmp_path.glob("run/rounds/*/policy*"))
