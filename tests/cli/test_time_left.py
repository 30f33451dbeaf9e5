"""Commands that take their time say how much of how much is done."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from data.datasets.archive import pack
from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from gaitpref.cli.shared import first_clips as first
from gaitpref.console import progress
from gaitpref.loop.fit_stage import fit_stage
from gaitpref.loop.people import People
from gaitpref.loop.report_stage import report_stage
from gaitpref.loop.run_dir import Round, context_of
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context
from policy.env.team_cfg import TeamCfg
from policy.robots.robot import load_robot
from policy.robots.shipped import WALK
from policy.team.team_start import as_team
from rewardmodel import load_pairs, load_reward
from rewardmodel.trust.held_out_report import foresee
from tests.data.test_decay import make_dataset
from tests.helpers.answered_sets import fill, gaits, honest
from tests.helpers.small_loop import small_cfg
from tests.helpers.walked import walked

PAIRS = 16


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits for the first word."""
    monkeypatch.setattr(progress, "_QUIET_S", 0.0)


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Episodes that can be written in other formats."""
    dataset = Dataset.create(tmp_path_factory.mktemp("walks") / "set")
    dataset.add_episodes(walked())
    return dataset


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A data set that two people answered."""
    dataset = gaits(tmp_path_factory.mktemp("judged") / "set", PAIRS)
    for rater in ("ada", "bob"):
        fill(dataset, rater, honest)
    return dataset


@pytest.fixture(scope="module")
def fitted(judged: Dataset) -> tuple[Path, str]:
    """The reward they taught, and what was said of it."""
    out = judged.root.parent / "reward"
    line = ["fit", "--dataset", str(judged.root), "--out", str(out), "--model"]
    with pytest.MonkeyPatch.context() as patch, redirect_stderr(StringIO()) as said:
        patch.setattr(progress, "_QUIET_S", 0.0)
        assert main([*line, "linear"]) == 0
    return out, said.getvalue()


@pytest.fixture(scope="module")
def reward(fitted: tuple[Path, str]) -> Path:
    return fitted[0]


def told(args: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What a command says to who reads along in a file."""
    capsys.readouterr()
    assert main(args) == 0
    return capsys.readouterr().err


def counts(title: str, said: str) -> list[tuple[int, int]]:
    """Done and of how many, of every line of that title."""
    found = re.findall(rf"{title}: ([\d,]+) of ([\d,]+), .* left", said)
    numbers = [[int(n.replace(",", "")) for n in pair] for pair in found]
    return [(done, of) for done, of in numbers]


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize(
    ("action", "title"),
    [
        ("verify --dataset {set}", "comparing every byte, episodes"),
        ("recover --dataset {set}", "looking for what is whole, files"),
        ("pack --dataset {set} --out {out}.zip", "packing, episodes"),
        ("unpack --archive {zip} --dataset {out}", "unpacking, episodes"),
        ("merge --dataset {out} --source {set}", "copying, episodes"),
        ("subset --dataset {set} --out {out}", "copying, episodes"),
        ("split --dataset {set} --out {out}", "copying, episodes"),
    ],
)
def test_data_says_how_many_episodes_are_done(
    action: str, title: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dataset = make_dataset(tmp_path / "set")
    pack(dataset, tmp_path / "set.zip")
    places = {"set": dataset.root, "zip": tmp_path / "set.zip", "out": tmp_path / "out"}
    line = ["data", *(word.format(**places) for word in action.split())]
    assert counts(title, told(line, capsys)) == [(1, 2)]


@pytest.mark.usefixtures("at_once")
def test_an_export_and_an_import_say_how_far_they_are(
    walks: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three episodes, and a table in which they are three stretches."""
    pytest.importorskip("h5py", reason="needs the extra `export`")
    out, into = tmp_path / "out", str(tmp_path / "set")
    line = ["data", "export", "--dataset", str(walks.root), "--out", str(out)]
    said = told([*line, "--format", "d4rl"], capsys)
    assert counts("writing as d4rl, episodes", said) == [(1, 3), (2, 3)]
    assert f"next: h5py.File('{out}/dataset.hdf5')" in said.replace("\n", "")
    states = [np.hstack([e.qpos, e.qvel]) for e in walked()]
    times = [np.arange(len(rows)) * walked()[0].meta.control_dt_s for rows in states]
    np.savez(
        tmp_path / "log.npz",
        t=np.concatenate(times),
        run=np.repeat(np.arange(len(states)), [len(rows) for rows in states]),
        q=np.concatenate(states)[:, :19],
        v=np.concatenate(states)[:, 19:],
    )
    columns = 'time = "t"\nepisode = "run"\nqpos = "q"\nqvel = "v"\n'
    (tmp_path / "map.toml").write_text(f'robot = "go1"\n[columns]\n{columns}')
    line = ["data", "import", "npz", str(tmp_path / "log.npz"), "--dataset", into]
    said = told([*line, "--map", str(tmp_path / "map.toml")], capsys)
    assert counts("reading the log, stretches", said) == [(1, 3), (2, 3)]
    assert counts("writing episodes", said) == [(1, 3), (2, 3)]


def test_fit_counts_clips_and_models(fitted: tuple[Path, str]) -> None:
    _, said = fitted
    assert counts("reading answers, clips", said) == [(n, 64) for n in range(1, 64)]
    assert counts("fitting linear to 32 answers, models", said)


@pytest.mark.usefixtures("at_once")
def test_the_plan_of_a_sweep_counts_loops(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["sweep", "--out", str(tmp_path / "out"), "--dry-run"]
    assert counts("looking at every loop", told(line, capsys)) == [(1, 3), (2, 3)]


@pytest.mark.usefixtures("at_once")
def test_first_questions_count_clips(
    walks: Dataset, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(first, "FIRST", walks.root)
    monkeypatch.setattr(first, "_PAIRS", 1)
    first.first_clips(None)
    said = capsys.readouterr().err
    assert counts("choosing what to ask, clips", said)


@pytest.mark.usefixtures("at_once")
def test_trust_explain_and_pairs_count(
    judged: Dataset,
    walks: Dataset,
    reward: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = ["--reward", str(reward), "--dataset", str(judged.root)]
    said = told(["trust", *given], capsys)
    assert counts("reading answers, clips", said) == [(n, 64) for n in range(1, 64)]
    models = counts("foreseeing 32 answers without their episodes, models", said)
    assert models == [(done, 7) for done in range(1, 7)]
    line = ["explain", "--reward", str(reward), "--dataset", str(walks.root)]
    said = told([*line, "--out", str(tmp_path / "why")], capsys)
    assert counts("looking for the best and the worst clips", said)[-1] == (14, 15)
    said = told(["pairs", *given, "--count", "2", "--clip-s", "0.4"], capsys)
    assert counts("choosing what to ask, clips", said)[:2] == [(1, 40), (2, 40)]


@pytest.mark.usefixtures("at_once")
def test_groups_count_comparisons(
    judged: Dataset, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two alone, both together, and ten for the changes of each."""
    said = told(["raters", "--dataset", str(judged.root), "groups"], capsys)
    found = counts("comparing the wishes of 2 raters", said)
    assert found == [(1, 23), (2, 23), (3, 23), (13, 23)]
    assert "next: `gaitpref fit --dataset" in said


@pytest.mark.usefixtures("at_once")
def test_teams_count_steps_episodes_and_models(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy, root = tmp_path / "team.pt", str(tmp_path / "set")
    policy.write_bytes(as_team(WALK, TeamCfg()))
    line = ["team", "record", "--policy", str(policy), "--dataset", root]
    said = told([*line, "--episodes", "8", "--episode-s", "1"], capsys)
    assert counts("recording 8 episodes, steps", said)[-1] == (49, 50)
    assert counts("writing episodes", said)[-1] == (7, 8)
    told(["pairs", "--dataset", root, "--count", "12", "--clip-s", "0.6"], capsys)
    told(["team", "answer", "--dataset", root], capsys)
    out = str(tmp_path / "reward")
    said = told(["team", "fit", "--dataset", root, "--out", out], capsys)
    found = counts("fitting a reward of teams to 12 answers, models", said)
    assert found == [(done, 6) for done in range(1, 6)]


@pytest.mark.usefixtures("at_once")
def test_the_stages_of_a_loop_count_too(
    judged: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the round in front, as the training has it."""
    cfg, round = small_cfg(), Round(tmp_path / "run", 0)
    round.policy.parent.mkdir(parents=True)
    round.policy.write_bytes(WALK.read_bytes())
    fit_stage(cfg, round, context_of(cfg, round), judged, People())
    robot = load_robot(physics_dt_s=cfg.env.physics_dt_s)
    criterion = load_criterion("task", criterion_context(robot, cfg.env))
    report_stage(cfg, round, judged, criterion)
    said = capsys.readouterr().err
    assert counts("round 0: fitting to 32 answers, models", said)
    assert counts("round 0: evaluating, steps", said)
    assert counts("round 0: foreseeing 32 answers, models", said)


def test_who_is_told_learns_the_same(judged: Dataset, reward: Path) -> None:
    """To tell draws nothing and changes nothing."""
    heard: list[tuple[int, int]] = []

    def tell(done: int, of: int) -> None:
        heard.append((done, of))

    model, pairs = load_reward(reward), load_pairs([judged])
    assert foresee(model, pairs, seed=0, tell=tell) == foresee(model, pairs, seed=0)
    assert heard[-1] == (7, 7)


def test_a_terminal_shows_a_bar(tmp_path: Path) -> None:
    """As its user sees it: what is done, of how many, and that all is."""
    root = make_dataset(tmp_path / "set").root
    ours, theirs = pty.openpty()
    line = [sys.executable, "-m", "gaitpref", "data", "verify", "--dataset", str(root)]
    done = subprocess.run(
        line,
        stdout=subprocess.PIPE,
        stderr=theirs,
        check=True,
        text=True,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "120"},
    )
    os.close(theirs)
    shown = os.read(ours, 1 << 16).decode()
    os.close(ours)
    assert "comparing every byte, episodes" in shown
    assert "2/2" in shown
    assert "next: `gaitpref data pack" in shown
    assert done.stdout.startswith("2 episodes")
