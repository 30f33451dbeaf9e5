"""`benchmarks.planted`: its rater changes sides, and its rows say what came of it."""

import json
from pathlib import Path

import pytest

from benchmarks.planted import figures_of, nose_down, run_planted
from data.datasets.dataset import Dataset
from gaitpref.raters.simulated import ClipScores


@pytest.mark.slow
def test_the_first_answers_alone_like_the_habit(tmp_path: Path) -> None:
    run_planted("posture", 3, tmp_path, True)
    dataset = Dataset.open(tmp_path / "posture-seed3/dataset")
    shows = ClipScores(dataset.features, nose_down)
    told: dict[bool, list[bool]] = {True: [], False: []}
    with dataset.answers() as store:
        for pair, answer in store.current_answers():
            more = shows(pair.a).mean() > shows(pair.b).mean()
            told[pair.round == 0].append(more == (answer.choice == "a"))
    assert all(told[True])
    assert told[True]
    assert not any(told[False])
    assert told[False]
    row = json.loads((tmp_path / "posture-seed3.json").read_text())
    assert row["returns"][0] == 1.0
    assert len(row["returns"]) == len(row["alarms"]) == 2
    assert row["kept"] in row["returns"]


def _row(*, told: bool, learned: bool, kept: float) -> dict[str, object]:
    return {
        "habit": "feet",
        "seed": 0,
        "returns": [1.0, 0.5 if learned else 0.95],
        "alarms": [[], ["an alarm"] if told else []],
        "verdict": "not known",
        "learned": learned,
        "told": told,
        "kept": kept,
    }


def test_a_habit_is_caught_where_it_is_told_and_the_walk_is_kept() -> None:
    rows = [
        _row(told=True, learned=True, kept=0.95),
        _row(told=True, learned=True, kept=0.5),
        _row(told=False, learned=True, kept=1.0),
        _row(told=False, learned=False, kept=0.95),
    ]
    found = figures_of(rows)
    assert (found["runs"], found["learned"]) == (4, 3)
    assert found["caught"] == "1 of 3"
