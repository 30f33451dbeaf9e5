"""What a rater sees when something goes wrong, as a websocket client sees it."""

import asyncio
import sqlite3
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from benchmarks.visitor import Visitor
from benchmarks.walks import walking_dataset
from data.answers.answer_records import Answer
from data.files.limits import NOTE_CHARS
from gaitpref.report.page_pictures import answer_picture
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.page.at_desk import REFRESH_S
from labeling_ui.page.page_access import Picture
from labeling_ui.page.store_thread import Worker
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.rater_session import QueueCfg
from rewardmodel import FitCfg, fit_reward, save_reward
from tests.rewardmodel.test_fit import answered

AT_ONCE = GuardCfg(min_shown_s=0.0, repeat_gap_s=0.0, same_verdict_s=0.0)


async def until(condition: Callable[[], bool]) -> None:
    """Wait; a busy machine takes long."""
    async with asyncio.timeout(90):
        while not condition():
            await asyncio.sleep(0.02)


def test_an_answer_that_cannot_be_stored_is_said_so(tmp_path: Path) -> None:
    """It is not counted, and once the data base works again the same one is."""
    dataset = walking_dataset(tmp_path / "set", pairs=3)
    file = tmp_path / "set" / "preferences.sqlite"

    def change(statement: str) -> None:
        with closing(sqlite3.connect(file)) as connection:
            connection.execute(statement)

    async def scenario(url: str) -> None:
        visitor = Visitor(url, None)
        page = asyncio.create_task(visitor.run())
        await visitor.until_moving()
        await visitor.press("Close the dialog")
        change(
            "CREATE TRIGGER full BEFORE INSERT ON answer "
            "BEGIN SELECT RAISE(ABORT, 'the disk is full'); END"
        )
        await visitor.press("A better")
        await until(
            lambda: any("could not be stored" in t for t in visitor.texts.values())
        )
        assert visitor.answered == 0
        change("DROP TRIGGER full")
        await visitor.press("A better")
        await visitor.until_answered(1)
        assert not any("could not be stored" in t for t in visitor.texts.values())
        page.cancel()

    cfg = LabelCfg(port=0, auth=False, queue=QueueCfg(guard=AT_ONCE))
    with LabelServer(dataset, cfg) as server:
        asyncio.run(scenario(server.url))
    with dataset.answers() as store:
        assert store.count() == 1


@pytest.mark.parametrize("task", ["walk", "getup"])
def test_it_asks_for_what_the_robots_were_to_do(tmp_path: Path, task: str) -> None:
    """Who lies was given no command."""
    dataset = walking_dataset(tmp_path / "set", pairs=1, task=task)

    async def scenario(url: str) -> str:
        visitor = Visitor(url, None)
        page = asyncio.create_task(visitor.run())
        await visitor.until_moving()
        page.cancel()
        return " ".join(visitor.texts.values())

    with LabelServer(dataset, LabelCfg(port=0, auth=False)) as server:
        told = asyncio.run(scenario(server.url))
    assert ("Which one walks better?" in told) == (task == "walk")
    assert ("Which one gets up better?" in told) == (task == "getup")
    assert ("asked for:" in told) == (task == "walk")


def test_what_nobody_waits_for_does_not_pile_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the worker is busy with answers, one look and one load of a page wait."""
    starved = threading.Event()
    workers: list[Worker] = []

    def answers_only(worker: Worker) -> None:
        workers.append(worker)
        while not worker._stopping:
            if starved.is_set() and not worker._waiting.empty():
                worker.store_all(worker._taken())
            elif starved.is_set():
                time.sleep(0.01)
            else:
                worker.store_all(worker._taken())
            works = worker._told or (() if starved.is_set() else worker._reads)
            if works and not worker._stopping:
                works.popleft()()

    monkeypatch.setattr(Worker, "_run", answers_only)
    dataset = walking_dataset(tmp_path / "set", pairs=8)

    async def scenario(url: str) -> None:
        visitor = Visitor(url, None)
        page = asyncio.create_task(visitor.run())
        await visitor.until_moving()
        await visitor.press("Close the dialog")
        starved.set()
        for number in range(4):
            await visitor.press("A better")
            await visitor.until_answered(number + 1)
            await asyncio.sleep(1.3 * REFRESH_S)
        assert len(workers[0]._reads) <= 2
        starved.clear()
        await visitor.press("A better")
        await visitor.until_answered(5)
        await until(lambda: not workers[0]._reads)
        page.cancel()

    cfg = LabelCfg(port=0, auth=False, queue=QueueCfg(guard=AT_ONCE))
    with LabelServer(dataset, cfg) as server:
        asyncio.run(scenario(server.url))


def at_the_page(
    root: Path,
    part: Callable[[Visitor], Awaitable[None]],
    *,
    picture: Picture | None = None,
) -> list[Answer]:
    """Have a rater do something; gives the answers that were stored."""
    dataset = walking_dataset(root, pairs=4)

    async def scenario(url: str) -> None:
        visitor = Visitor(url, None)
        page = asyncio.create_task(visitor.run())
        await visitor.until_moving()
        await visitor.press("Close the dialog")
        await part(visitor)
        page.cancel()

    cfg = LabelCfg(port=0, auth=False, queue=QueueCfg(guard=AT_ONCE))
    with LabelServer(dataset, cfg, picture=picture) as server:
        asyncio.run(scenario(server.url))
    with dataset.answers() as store:
        return [answer for _, answer in store.current_answers()]


def told(visitor: Visitor, words: str) -> bool:
    """Whether something on the page says so."""
    return any(words in text for text in visitor.texts.values())


def test_what_is_typed_has_a_limit_that_is_told(tmp_path: Path) -> None:
    """Too long a text is not stored, nor cut, nor lost; a shorter one is taken."""
    longest = "x" * NOTE_CHARS
    other = f"in words, up to {NOTE_CHARS:,} characters"

    async def part(visitor: Visitor) -> None:
        for length in (900_000, NOTE_CHARS + 1):
            await visitor.set("note", "x" * length)
            await visitor.press("A better")
            await until(partial(told, visitor, f"The note has {length:,} characters"))
        assert visitor.answered == 0
        await visitor.set("note", f"\x1b[31m{longest[8:]}\0\nb")
        await visitor.press("A better")
        await visitor.until_answered(1)
        await visitor.press("Bad clip")
        await until(lambda: other in visitor.elements)
        await visitor.set(other, longest + "x")
        await visitor.set("Send other reason", True)
        await until(lambda: told(visitor, "The reason has 1,001 characters, 1,000 at"))
        assert visitor.answered == 1
        await visitor.set(other, longest)
        await visitor.set("Send other reason", True)
        await visitor.until_answered(2)

    first, second = at_the_page(tmp_path / "set", part)
    assert first.note == f"[31m{longest[8:]}\nb"
    assert (second.choice, second.reason) == ("bad", longest)


def test_two_bad_gaits_are_equal_and_why_is_kept(tmp_path: Path) -> None:
    """The words written in the dialog go with the button."""

    async def part(visitor: Visitor) -> None:
        words = f"in words, up to {NOTE_CHARS:,} characters"
        await visitor.press("Bad clip")
        await until(lambda: words in visitor.elements)
        await visitor.set(words, "all drag their feet")
        await visitor.set("Both walk badly, neither better [5]", True)
        await visitor.until_answered(1)

    (answer,) = at_the_page(tmp_path / "set", part)
    assert answer.reason == "Both walk badly, neither better: all drag their feet"
    assert (answer.choice, answer.target) == ("equal", 0.5)


def test_a_late_answer_is_none_behind_a_dialog(tmp_path: Path) -> None:
    """It waits for the last letters of a note, and a dialog may open meanwhile."""

    async def part(visitor: Visitor) -> None:
        await visitor.set("note", "drags a foot")
        await visitor.press("A better")
        await visitor.press("Bad clip")
        await until(lambda: told(visitor, "Close the dialog first."))
        assert visitor.answered == 0

    assert at_the_page(tmp_path / "set", part) == []


def test_what_moved_a_reward_is_drawn_after_the_answer(tmp_path: Path) -> None:
    """On demand, of a reward that was given; a damaged one costs the picture alone."""
    reward = tmp_path / "reward"
    save_reward(fit_reward(answered(12, seed=5), FitCfg(), seed=0)[0], reward)
    drawn: list[bool] = []

    async def part(visitor: Visitor) -> None:
        await visitor.press("A better")
        await visitor.until_answered(1)
        await visitor.press("What differed before")
        # By chance they differ or do not.
        either = ("You had these two", "They differ in nothing")
        await until(lambda: any(told(visitor, words) for words in either))
        await asyncio.sleep(0.1)
        drawn.append(told(visitor, "data:image/svg+xml;base64,"))

    draw = partial(answer_picture, tmp_path / "set", reward)
    at_the_page(tmp_path / "set", part, picture=draw)
    gone = partial(answer_picture, tmp_path / "other", tmp_path / "gone")
    at_the_page(tmp_path / "other", part, picture=gone)
    assert drawn == [True, False]
