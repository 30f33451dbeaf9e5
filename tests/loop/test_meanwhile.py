"""What people are asked between two rounds, and what the rounds know of it."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks.walks import walking_dataset
from data.answers.answer_records import Answer, Pair
from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from data.features import column
from data.files.files import read_json, sha256_file
from data.files.plain import to_plain
from gaitpref.loop.between_rounds import keep_asked
from gaitpref.loop.people import People
from gaitpref.loop.policy_stage import partial_of
from gaitpref.loop.presets import loop_cfg
from gaitpref.loop.record_stage import recorded_on_the_way
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_dir import Round
from gaitpref.method.meanwhile import Meanwhile
from policy.robots.shipped import WALK
from rewardmodel.answers.answered_pairs import load_pairs
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
        # Nobody answered: no reward has chosen them.
        facts = {"for_round": 1, "answers": 0}
        assert [pair.info["meanwhile"] for pair in asked] == 4 * [facts]
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


def kept_on_the_way(round: Round, count: int) -> None:
    """What a training of the round has left by now: `count` checkpoints."""
    folder = partial_of(round) / "checkpoints"
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(1, count + 1):
        shutil.copy(WALK, folder / f"step_{number:010d}.pt")


def all_answered(dataset: Dataset) -> None:
    with dataset.answers() as store:
        for pair in store.unanswered():
            answered(store, pair)


def test_checkpoints_of_the_training_are_asked_about(
    recorded: tuple[Path, Dataset],
) -> None:
    """Half of the questions, once somebody answers; every second checkpoint, once."""
    run, dataset = recorded
    coming, before = Round(run, 1), set(dataset.entries())
    kept_on_the_way(coming, 2)
    keep_asked(run, human_cfg(), dataset, 1)
    assert set(dataset.entries()) == before
    assert recorded_on_the_way(coming) == []
    all_answered(dataset)
    assert keep_asked(run, human_cfg(), dataset, 1) == 4
    new = {e.sha256: e for e in set(dataset.entries()) - before}
    assert sorted(new) == sorted(recorded_on_the_way(coming))
    assert len(new) == 10
    assert {e.meta.policy_sha256 for e in new.values()} == {sha256_file(WALK)}
    assert {e.meta.round for e in new.values()} == {1}
    with dataset.answers() as store:
        asked = [pair for pair in store.pairs() if pair.meanwhile == 1][-4:]
    shown = [bool({pair.a.rollout, pair.b.rollout} & set(new)) for pair in asked]
    assert shown == [True, True, False, False]
    # Seven were asked and answered before.
    assert [pair.info["meanwhile"]["answers"] for pair in asked] == 4 * [7]
    assert {pair.round for pair in asked} == {0}

    for checkpoints, recorded_ones in ((3, 1), (4, 2)):
        kept_on_the_way(coming, checkpoints)
        all_answered(dataset)
        judged = load_pairs([dataset])
        keep_asked(run, human_cfg(), dataset, 1)
        assert len(read_json(coming.on_the_way)) == recorded_ones
        with dataset.answers() as store:
            asked_under = [pair.info["meanwhile"] for pair in store.pairs()[-4:]]
        assert {each["answers"] for each in asked_under} == {len(judged)}
        label_sets = {each["answers_sha256"] for each in asked_under}
        assert label_sets == {judged.answers_sha256}


def test_what_was_recorded_on_the_way_is_asked_about_when_the_training_is_done(
    recorded: tuple[Path, Dataset],
) -> None:
    """Its directory has another name then, and a restart finds what is there."""
    run, dataset = recorded
    coming = Round(run, 1)
    kept_on_the_way(coming, 2)
    keep_asked(run, human_cfg(), dataset, 1)
    all_answered(dataset)
    keep_asked(run, human_cfg(), dataset, 1)
    names = set(recorded_on_the_way(coming))
    partial_of(coming).rename(coming.policy.parent)
    all_answered(dataset)
    count = len(dataset.entries())
    keep_asked(run, human_cfg(), Dataset.open(dataset.root), 1)
    assert len(dataset.entries()) == count
    with dataset.answers() as store:
        asked = store.unanswered()
    assert any({pair.a.rollout, pair.b.rollout} & names for pair in asked)


def higher(dataset: Dataset, pair: Pair) -> Answer:
    """The answer of somebody who wants robots to stand high."""
    a, b = (
        dataset.clip_features(clip)[:, column("base_height")].mean()
        for clip in (pair.a, pair.b)
    )
    return Answer(
        answer_id=f"answer to {pair.pair_id}",
        pair_id=pair.pair_id,
        rater_id="ann",
        choice="a" if a > b else "b",
        shown_left="a",
        created_utc="2030-01-31T12:00:00Z",
    )


@contextmanager
def answering(dataset: Dataset, wanted: Callable[[Pair], bool]) -> Iterator[People]:
    """Somebody who answers what is `wanted` as soon as it is asked."""
    done = threading.Event()

    def answer() -> None:
        own = Dataset.open(dataset.root)
        with own.answers() as store:
            store.add_rater("ann", "human")
            while not done.wait(0.05):
                for pair in filter(wanted, store.unanswered()):
                    store.add_answer(higher(own, pair))

    person = threading.Thread(target=answer)
    person.start()
    try:
        yield People()
    finally:
        done.set()
        person.join()


@pytest.mark.slow
def test_answers_about_a_training_that_goes_on_are_in_the_next_fit(
    tmp_path: Path,
) -> None:
    """Somebody answers all that is asked of two rounds, and what is asked meanwhile up
    to the first about a checkpoint."""
    run = tmp_path / "run"
    about: list[Pair] = []
    trained: list[bool] = []

    def wanted(pair: Pair) -> bool:
        if pair.meanwhile is None:
            return True
        if about or pair.meanwhile != 1:
            return False
        if {pair.a.rollout, pair.b.rollout} & set(recorded_on_the_way(Round(run, 1))):
            about.append(pair)
            trained.append(partial_of(Round(run, 1)).exists())
        return True

    run_loop(run, human_cfg(), open_page=lambda dataset: answering(dataset, wanted))
    dataset = Dataset.open(run / "dataset")
    (pair,) = about
    assert trained == [True]
    played = {dataset.entry(c.rollout).meta.policy_sha256 for c in (pair.a, pair.b)}
    kept = Round(run, 1).policy.parent.glob("checkpoints/*.pt")
    assert played & set(map(sha256_file, kept))
    assert pair.info["meanwhile"]["for_round"] == 1
    assert (
        pair.info["meanwhile"]["answers"]
        >= read_json(Round(run, 0).report)["fit"]["answers"]
    )
    clips = load_pairs([dataset]).clips
    assert (pair.a.key, pair.b.key) in clips
    # Those of the last round are about policies, and come after the last fit.
    with dataset.answers() as store:
        given = [p for p, _ in store.current_answers() if p.round < 2 and not p.gold]
    assert read_json(Round(run, 1).report)["fit"]["answers"] == len(given)


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
