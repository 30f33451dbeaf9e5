"""What is said where answers prefer nothing, or a rater does not look."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from data.answers.answer_records import Choice, Side
from data.answers.rater_habits import Sides, guesses
from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from rewardmodel import FitCfg, fit_reward, load_pairs, load_reward, save_reward
from rewardmodel.answers.answered_pairs import MIN_ANSWERS, count_evidence
from rewardmodel.cfg import KIND_NAMES
from tests.helpers.answered_sets import Say, at_random, fill, gaits, honest
from tests.rewardmodel.test_fit import answered

PAIRS = 40
"""All held out, as few as can say that answers do not agree."""


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set whose pairs nobody answered."""
    return gaits(tmp_path_factory.mktemp("asked") / "set", PAIRS).root


@pytest.fixture
def dataset(asked: Path, tmp_path: Path) -> Dataset:
    """A copy of it."""
    shutil.copytree(asked, tmp_path / "set")
    return Dataset.open(tmp_path / "set")


def on_left(number: int, better: bool, left: Side) -> Choice:
    return left


def equal(number: int, better: bool, left: Side) -> Choice:
    return "equal"


def in_turn(number: int, better: bool, left: Side) -> Choice:
    return "a" if number % 2 else "b"


@pytest.mark.parametrize(
    ("says", "times", "besides"),
    [(equal, 1, "40 call both clips equal"), (in_turn, 2, "40 call both clips equal")],
)
def test_answers_that_prefer_nothing_are_refused_in_one_line(
    dataset: Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    says: Say,
    times: int,
    besides: str,
) -> None:
    """Only ties, and every pair answered both ways by one person; by `trust` too, of a
    reward that others made."""
    out = str(tmp_path / "reward")
    fill(dataset, "ann", honest)
    assert main(["fit", "--dataset", str(dataset.root), "--out", out]) == 0
    other = gaits(tmp_path / "other", PAIRS)
    fill(other, "ann", says, times=times)
    capsys.readouterr()
    on = ["--dataset", str(other.root)]
    for command in (["fit", "--out", out + "2"], ["trust", "--reward", out]):
        assert main([*command, *on]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert f"0 of {times * PAIRS} answers prefer a clip" in told
        assert besides in told
        assert f"needs at least {MIN_ANSWERS}" in told
    assert not Path(out + "2").exists()


def test_two_people_who_contradict_each_other_prefer_nothing(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of every pair one says a and one b; a third who agrees with one of them makes it
    count."""
    fill(dataset, "ann", honest)
    fill(dataset, "bob", lambda n, better, left: "b" if better else "a")
    fit = ["fit", "--dataset", str(dataset.root), "--out", str(tmp_path / "reward")]
    assert main(fit) == 2
    assert f"0 of {2 * PAIRS} answers prefer a clip" in capsys.readouterr().err
    fill(dataset, "cyd", honest)
    with dataset.answers() as store:
        assert count_evidence(store) == PAIRS
    assert load_pairs([dataset]).num_preferences == PAIRS


def test_ties_do_not_count_towards_what_a_fit_needs(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Seven preferences among forty answers are too few, eight do."""
    fit = ["fit", "--dataset", str(dataset.root), "--out", str(tmp_path / "reward")]

    def some(count: int) -> Say:
        return lambda n, better, left: honest(n, better, left) if n < count else "equal"

    seven = shutil.copytree(dataset.root, tmp_path / "seven")
    fill(Dataset.open(seven), "ann", some(7))
    fit[2] = str(seven)
    assert main(fit) == 2
    assert "collect 1 more" in capsys.readouterr().err
    fill(dataset, "ann", some(8))
    fit[2] = str(dataset.root)
    assert main(fit) == 0


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_a_reward_that_no_answer_speaks_for_is_nothing(
    kind: str, tmp_path: Path
) -> None:
    """Of ties alone, whatever the model, and as it is saved and read again."""
    pairs = answered(20, seed=0)
    ties = replace(pairs, target=torch.full_like(pairs.target, 0.5))
    model, report = fit_reward(ties, FitCfg(kind=kind), seed=0)  # type: ignore[arg-type]
    save_reward(model, tmp_path / "reward")
    model = load_reward(tmp_path / "reward")
    steps, sure = model.clip_rewards(ties.left)
    assert (report.ties, report.held_out_pairs) == (20, 0)
    assert (steps == 0.0).all()
    assert (sure == 0.0).all()


def told_of(
    dataset: Dataset, reward: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, str]:
    """What fit, trust and `raters stats` print of a data set."""
    on = ["--dataset", str(dataset.root)]
    assert main(["fit", *on, "--out", str(reward)]) == 0
    read = capsys.readouterr()
    told = {"fit": " ".join((read.out + read.err).split())}
    assert main(["trust", *on, "--reward", str(reward)]) == 0
    told["trust"] = capsys.readouterr().out
    assert main(["raters", *on, "stats"]) == 0
    told["stats"] = capsys.readouterr().out
    return told


def as_json(
    dataset: Dataset, reward: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, Any]:
    """The same of `trust`, for programs."""
    on = ["--dataset", str(dataset.root), "--reward", str(reward)]
    assert main(["trust", *on, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_who_always_takes_the_left_clip_is_told_by_all_three(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(dataset, "ann", on_left)
    told = told_of(dataset, tmp_path / "reward", capsys)
    line = f"ann preferred the clip on the left in {PAIRS} of {PAIRS} answers"
    assert all(line in told[name] for name in ("fit", "trust", "stats"))
    trust = as_json(dataset, tmp_path / "reward", capsys)
    assert line in trust["alarm"]
    assert "no alarm" not in told["fit"] + told["trust"] + trust["sentence"]


def test_who_answers_at_random_is_told(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Alone, and beside people who look; who answered is compared with two others."""
    fill(dataset, "ann", at_random)
    alone = told_of(dataset, tmp_path / "alone", capsys)
    assert "look before you trust it: held-out accuracy" in alone["fit"]
    assert "as of answers at random" in alone["fit"]
    assert "ALARM: the answers do not agree" in alone["trust"]
    assert "as if given at random" in alone["trust"]
    fill(dataset, "bob", honest)
    beside = told_of(dataset, tmp_path / "beside", capsys)
    fill(dataset, "cyd", honest)
    assert main(["raters", "--dataset", str(dataset.root), "stats"]) == 0
    beside["stats"] = capsys.readouterr().out
    for name in ("fit", "trust", "stats"):
        assert "ann answers as if at random" in beside[name]
        assert "bob answers" not in beside[name]
        assert "cyd answers" not in beside[name]


def test_of_who_looks_nothing_is_said(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Forty answers that agree: no alarm, and nothing that speaks against it."""
    fill(dataset, "ann", honest)
    told = told_of(dataset, tmp_path / "reward", capsys)
    assert "no alarm: nothing says that the learned reward misleads" in told["trust"]
    for name in ("fit", "trust", "stats"):
        assert "ann" not in told[name].replace("\nann    ", "\n")
        assert "look before" not in told[name]
    trust = as_json(dataset, tmp_path / "reward", capsys)
    assert trust["alarms"] == trust["raters"] == []


def test_an_alarm_that_few_answers_cannot_raise_is_no_all_clear(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Twelve answers at random."""
    few = gaits(tmp_path / "few", 12)
    fill(few, "ann", at_random)
    told = told_of(few, tmp_path / "reward", capsys)
    assert as_json(few, tmp_path / "reward", capsys)["alarm"] is None
    for name in ("fit", "trust"):
        assert "no alarm" not in told[name]
        assert "too few answers to tell: 12 held-out answers prefer a clip, 40" in (
            " ".join(told[name].split())
        )


def test_people_who_look_are_hardly_ever_blamed() -> None:
    """Of raters whose answers have nothing to do with sides, at most two in a thousand;
    who always says left is found from eleven answers on; and sides that were not drawn
    by lot say nothing."""
    rng = np.random.default_rng(0)
    blamed = 0
    for number in range(5000):
        count = (12, 40, 100, 400)[number % 4]
        left = int(rng.binomial(count, 0.5))
        blamed += Sides("ann", left, count - left, shuffled=True).one_sided
    assert blamed <= 10
    assert Sides("ann", 11, 0, shuffled=True).one_sided
    assert not Sides("ann", 10, 0, shuffled=True).one_sided
    assert not Sides("ann", 40, 0, shuffled=False).one_sided
    wrongly = sum(
        guesses(int(rng.binomial(count, 0.85)), count, 0.8)
        for count in (10, 30, 100)
        for _ in range(1000)
    )
    assert wrongly <= 3
    found = [guesses(int(rng.binomial(30, 0.5)), 30, 0.8) for _ in range(200)]
    assert sum(found) > 100


def test_what_others_recorded_with_one_clip_first_blames_nobody(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Imported answers all name clip a as the left one: that is no habit of a rater."""
    dataset = gaits(tmp_path / "set", 30)
    fill(dataset, "ann", lambda n, better, left: "a")
    with dataset.answers() as store:
        store.add_rater("imported", "human")
        for pair, answer in list(store.current_answers()):
            store.add_answer(
                replace(
                    answer,
                    answer_id=f"i-{answer.answer_id}",
                    rater_id="imported",
                    shown_left="a",
                )
            )
            assert pair.gold is None
    assert main(["raters", "--dataset", str(dataset.root), "stats"]) == 0
    assert "though sides are drawn by lot" not in capsys.readouterr().out
