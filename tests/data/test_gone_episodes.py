"""Episodes that answers are about and that are gone: left out, counted, and gone on."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from rewardmodel import load_pairs
from tests.helpers.answered_sets import EPISODES, fill, gaits, honest
from tests.helpers.motion import trotting_dataset

PAIRS = 40


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty pairs, all answered."""
    dataset = gaits(tmp_path_factory.mktemp("answered") / "set", PAIRS)
    fill(dataset, "ann", honest)
    return dataset.root


@pytest.fixture
def lost(answered: Path, tmp_path: Path) -> Dataset:
    """A copy of which a file was removed that answers are about."""
    dataset = Dataset.open(shutil.copytree(answered, tmp_path / "set"))
    dataset.path_of(dataset.entry(_asked_about(dataset))).unlink()
    return Dataset.open(dataset.root)


def _asked_about(dataset: Dataset) -> str:
    with dataset.answers_copy() as store:
        return store.pairs()[0].a.rollout


def _about(dataset: Dataset, sha256: str) -> int:
    with dataset.answers_copy() as store:
        pairs = [pair for pair, _ in store.current_answers()]
    return sum(sha256 in (pair.a.rollout, pair.b.rollout) for pair in pairs)


def test_a_file_that_is_listed_and_missing_is_damage(
    lost: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line that names the command which goes on without it."""
    out = str(tmp_path / "reward")
    assert main(["fit", "--dataset", str(lost.root), "--out", out]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "is missing, the manifest promises" in told
    assert f"`gaitpref data recover --dataset {lost.root}`" in told


def test_the_answers_about_other_episodes_stay(
    lost: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every command that reads answers leaves the same ones out, counts them, and names
    the command that makes a clean copy; that copy is fitted to the same."""
    gone = _about(lost, _asked_about(lost))
    assert 0 < gone < PAIRS - 8
    root, reward = str(lost.root), str(tmp_path / "reward")
    main(["data", "recover", "--dataset", root])
    on = ["--dataset", root]

    def told(*command: str) -> str:
        capsys.readouterr()
        assert main([*command]) == 0
        read = capsys.readouterr()
        return " ".join((read.out + read.err).split())

    left_out = (
        f"{gone} of {PAIRS} answers are about episodes that are gone and are left out; "
        f"`gaitpref data subset --dataset {root} --out NEW` makes a clean copy"
    )
    assert left_out in told("fit", *on, "--out", reward)
    assert left_out in told("trust", *on, "--reward", reward)
    assert left_out in told("pairs", *on, "--count", "2", "--clip-s", "0.2")
    as_json = json.loads(told("fit", *on, "--out", reward, "--json"))
    assert (as_json["answers"], as_json["answers_gone"]) == (PAIRS - gone, gone)
    assert json.loads(told("trust", *on, "--reward", reward, "--json"))[
        "answers_are_those_fitted"
    ]
    # What asks about steps or clips, and not about answers, has nothing to leave out.
    clip = ("--clip", lost.entries()[0].sha256)
    explain = ("explain", *on, "--reward", reward, "--out", reward)
    assert "gone" not in told(*explain, *clip)
    pytest.importorskip("pyarrow", reason="needs the extra `parquet`")
    table = str(tmp_path / "reward.parquet")
    relabelled = told("relabel", *on, "--reward", reward, "--out", table)
    assert f"of {EPISODES - 1} episodes" in relabelled

    clean = str(tmp_path / "clean")
    assert "stayed behind" in told("data", "subset", *on, "--out", clean)
    copied = told("fit", "--dataset", clean, "--out", reward + "2")
    assert "gone" not in copied
    both = [load_pairs([Dataset.open(Path(path))]) for path in (root, clean)]
    assert both[0].answers_sha256 == both[1].answers_sha256


@pytest.mark.parametrize("rater", [[], ["--rater", "stochastic", "--equal", "0.1"]])
def test_a_simulated_rater_leaves_pairs_about_them_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rater: list[str]
) -> None:
    """And answers the others, by a scale that knows nothing of those either."""
    dataset = trotting_dataset(tmp_path / "set")
    with dataset.answers_copy() as store:
        pairs = store.pairs()
    sha256 = pairs[1].b.rollout
    dataset.path_of(dataset.entry(sha256)).unlink()
    main(["data", "recover", "--dataset", str(dataset.root)])
    capsys.readouterr()
    answer = ["answer", "--dataset", str(dataset.root), "--criterion", "smooth"]
    assert main([*answer, *rater]) == 0
    read = capsys.readouterr()
    told = " ".join((read.out + read.err).split())
    assert "2 pairs of" in told
    assert "2 of 6 answers are about episodes that are gone and are left out" in told
    with dataset.answers_copy() as store:
        left = store.unanswered("simulated:smooth")
    assert [sha256 in (pair.a.rollout, pair.b.rollout) for pair in left] == [True] * 2


def test_an_episode_that_lies_in_another_data_set_is_not_gone(
    answered: Path, lost: Dataset, tmp_path: Path
) -> None:
    """Given both, all answers count; given none that has it, no other one is lost."""
    gone = _about(lost, _asked_about(lost))
    main(["data", "recover", "--dataset", str(lost.root)])
    alone = load_pairs([Dataset.open(lost.root)])
    assert (len(alone), alone.num_gone) == (PAIRS - gone, gone)
    both = load_pairs([Dataset.open(lost.root), Dataset.open(answered)])
    assert (len(both), both.num_gone) == (PAIRS, 0)
