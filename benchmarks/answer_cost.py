"""What one answer costs, however many pairs and answers there are.

`python -m benchmarks.answer_cost [--pairs 200 20000] [--json FILE]`: raters answer in
turn at desks without a page, so that queue and data base are all there is. What counts
is processor time, of this process and of the server of PostgreSQL, which other work on
the machine changes little; nothing waits for the disk, which is the same for all.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from data.answers.address import Address
from data.answers.answer_records import Answer, Pair
from data.answers.question_board import QuestionBoard
from data.answers.store import AnswerStore
from data.episodes.clips import Clip
from labeling_ui.questions.judgement import Judgement
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.rater_session import QueueCfg, RaterSession
from tests.helpers import postgres

from .harness import Figure, publish

Database = Literal["sqlite", "postgresql"]

RATERS = 8
WARM = 12
"""Answers of each rater before: as many as a page tells of, and one more block."""
MEASURED = 12
GOAL = 1.5
"""Times the cheapest answer of its data base."""
QUEUE = QueueCfg(guard=GuardCfg(min_shown_s=0, repeat_gap_s=0, same_verdict_s=0))


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure the processor time of an answer, ms."""

    pairs: tuple[int, ...] = (200, 20_000, 200_000)
    """How many pairs there are."""
    answered: tuple[int, ...] = (0, 20_000)
    """How many of them are answered before; of fewer pairs, only 0 is measured."""
    databases: tuple[Database, ...] = ("sqlite", "postgresql")
    json: Path | None = None
    """File for the figures."""


def main(options: Options) -> dict[str, Figure]:
    """Measure, print and write the figures."""
    figures: dict[str, Figure] = {}
    for database in options.databases:
        costs = {
            f"{database}_{pairs}_pairs_{answered}_answers": _cost_ms(
                database, pairs, answered
            )
            for pairs in options.pairs
            for answered in options.answered
            if answered <= pairs
        }
        figures |= {f"{name}_ms": round(cost, 2) for name, cost in costs.items()}
        over = max(costs.values()) / min(costs.values())
        figures[f"{database}_most_over_least"] = round(over, 2)
    goals = {name: f"at most {GOAL}" for name in figures if name.endswith("_least")}
    publish("processor time of an answer", figures, goals, options.json)
    return figures


def _cost_ms(database: Database, pairs: int, answered: int) -> float:
    clips = [Clip(f"{index:064x}", 0, 50) for index in range(2 * int(pairs**0.5) + 2)]
    with empty_store(database) as (address, used_s), AnswerStore.open(address) as store:
        if database == "sqlite":
            store.query("PRAGMA synchronous = OFF")
        names = [f"rater{index}" for index in range(RATERS)]
        fill(store, clips, names, pairs=pairs, answered=answered)
        board = QuestionBoard(store, QUEUE.plan.overlap)
        board.follow()
        rng = np.random.default_rng(0)
        sessions = [
            RaterSession(store, name, cfg=QUEUE, board=board, rng=rng) for name in names
        ]
        for _ in range(WARM):
            for session in sessions:
                answer_once(session)
        before_s = used_s()
        for _ in range(MEASURED):
            for session in sessions:
                answer_once(session)
        return 1000 * (used_s() - before_s) / (MEASURED * RATERS)


def answer_once(session: RaterSession) -> None:
    """What a page asks of a queue for one answer."""
    question = session.current()
    assert question is not None
    outcome = session.answer(
        Judgement(question_id=question.question_id, verdict="left")
    )
    assert outcome.accepted
    session.current()
    session.progress()
    session.history()
    session.upcoming()


@contextmanager
def empty_store(database: Database) -> Iterator[tuple[Address, Callable[[], float]]]:
    """Where an empty store of answers is, and what tells the processor time, s, that
    this process and the server have used."""
    with ExitStack() as stack:
        if database == "sqlite":
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            yield Path(folder) / "preferences.sqlite", time.process_time
            return
        url = postgres.new_schema(stack.enter_context(postgres.server()))
        with AnswerStore.open(url) as store:
            backend = store.query("SELECT pg_backend_pid()")[0][0]
            server = int(_stat(Path(f"/proc/{backend}"))[1])
        yield url, lambda: time.process_time() + _family_s(server)


def fill(
    store: AnswerStore,
    clips: Sequence[Clip],
    raters: Sequence[str],
    *,
    pairs: int,
    answered: int,
) -> None:
    """Add that many pairs of these clips in five rounds, those that are asked first
    answered by the raters in turn."""
    width = len(clips)
    chosen = [
        Pair.make(
            clips[index % width],
            clips[(index + 1 + index // width) % width],
            strategy="uniform",
            round=index % 5,
        )
        for index in range(pairs)
    ]
    added = store.add_pairs(chosen)
    assert added == pairs, f"{len(clips)} clips make {added} pairs only"
    for name in raters:
        store.add_rater(name, "human")
    asked = sorted(chosen, key=lambda pair: -pair.round)[:answered]
    with store.transaction():
        for index, pair in enumerate(asked):
            store.add_answer(
                Answer(
                    answer_id=f"answer {index}",
                    pair_id=pair.pair_id,
                    rater_id=raters[index % len(raters)],
                    choice="a",
                    shown_left="a",
                    created_utc="2030-01-31T12:00:00Z",
                )
            )


def _family_s(pid: int) -> float:
    """Processor time of a process and its children, also of those that ended, s."""
    ticks = sum(map(int, _stat(Path(f"/proc/{pid}"))[11:15]))
    for child in Path("/proc").glob("[0-9]*"):
        try:
            fields = _stat(child)
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(fields[1]) == pid:
            ticks += sum(map(int, fields[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def _stat(process: Path) -> list[str]:
    """The fields behind the name, which may hold spaces."""
    return (process / "stat").read_text().rpartition(")")[2].split()


if __name__ == "__main__":
    main(tyro.cli(Options))
