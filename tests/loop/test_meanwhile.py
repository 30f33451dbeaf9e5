"""What people are asked between two rounds, and what the rounds know of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.walks import walking_dataset
from data.answers.answer_records import Answer, Pair
from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from data.files.plain import to_plain
from gaitpref.loop.between_rounds import keep_asked
from gaitpref.loop.presets import loop_cfg
from gaitpref.loop.run_dir import Round
from gaitpref.method.meanwhile import Meanwhile
from rewardmodel.asking.asked_meanwhile import (
    answered_before,
    asked_and_left,
    open_before,
)
from tests.helpers.small_loop import human_cfg


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Path, Dataset]:
    """A run that has recorded its first round and asked three questions."""
    run = tmp_path / "run"
    dataset = walking_dataset(run / "dataset", pairs=3)
    names = sorted(entry.sha256 for entry in dataset.entries())
    (run / "rounds/00").mkdir(parents=True)
    Round(run, 0).recorded.write_text(json.dumps(names))
    with dataset.answers() as store:
        store.add_rater("ann", "human")
    return run, dataset


def answered(store: AnswerStore, pair: Pair) -> None:
    store.add_answer(
        Answer(
            answer_id=f"answer to {pair.pair_id}",
            pair_id=pair.pair_id,
            rater_id="ann",
            choice="a",
            shown_left="a",
            created_utc="2030-01-31T12:00:00Z",
        )
    )


def test_a_round_counts_only_what_it_asked_itself(
    recorded: tuple[Path, Dataset],
) -> None:
    """Pairs asked meanwhile say for which round, and change no round's own count."""
    run, dataset = recorded
    assert keep_asked(run, human_cfg(), dataset, 1) == 4
    with dataset.answers() as store:
        asked = [pair for pair in store.pairs() if pair.meanwhile is not None]
        assert [pair.meanwhile for pair in asked] == 4 * [1]
        assert [pair.info["meanwhile"]["answers"] for pair in asked] == 4 * [0]
        assert {pair.round for pair in asked} == {0}
        assert asked_and_left(store, 0) == (3, 3)
        for pair in asked[:2]:
            answered(store, pair)
        assert asked_and_left(store, 0) == (3, 3)
        assert answered_before(store, 1) == 2
        assert answered_before(store, 2) == 0


def test_more_is_asked_only_where_little_is_open(
    recorded: tuple[Path, Dataset],
) -> None:
    """What is open after a restart is asked first, and no pair comes twice."""
    run, dataset = recorded
    keep_asked(run, human_cfg(), dataset, 1)
    assert keep_asked(run, human_cfg(), dataset, 1) == 0
    with dataset.answers() as store:
        first = [pair for pair in store.pairs() if pair.meanwhile == 1]
        for pair in first[:2]:
            answered(store, pair)
        assert open_before(store) == 2
    assert keep_asked(run, human_cfg(), dataset, 1) == 4
    with dataset.answers() as store:
        pairs = store.pairs()
    assert len({frozenset((pair.a, pair.b)) for pair in pairs}) == 3 + 8
    assert [pair.info["meanwhile"]["answers"] for pair in pairs[-4:]] == 4 * [2]


def test_answers_before_a_round_spare_it_some_of_its_own() -> None:
    """Half of its own it asks in any case."""
    decision = Meanwhile()
    assert decision.still_asked(10, 0) == 10
    assert decision.still_asked(10, 3) == 7
    assert decision.still_asked(10, 99) == 5
    assert decision.still_asked(5, 99) == 3


def test_who_is_asked_by_a_program_is_asked_as_before() -> None:
    """A run without people has the configuration it always had."""
    simulated = to_plain(loop_cfg(), whole=True)["method"]
    people = to_plain(loop_cfg(rater="human"), whole=True)["method"]
    assert "meanwhile" not in simulated
    assert people.pop("meanwhile") == {"batch": 4, "own_share": 0.5}
    assert people == simulated
