"""What a rater sees when something goes wrong, as a websocket client sees it."""

import asyncio
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from benchmarks.visitor import Visitor
from benchmarks.walks import walking_dataset
from labeling_ui.guard import GuardCfg
from labeling_ui.queue import QueueCfg
from labeling_ui.server import LabelCfg, LabelServer

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
