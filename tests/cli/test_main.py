"""The command line: it parses, it teaches, and it meets bad input with one line."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import is_dataclass
from pathlib import Path
from types import UnionType
from typing import Union, get_args, get_origin, get_type_hints

import pytest

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main, parse
from gaitpref.cli.options import options
from gaitpref.console import progress
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

COMMANDS = {
    "loop": (["--run", "r"], options.Loop(run=Path("r"))),
    "sweep": (["--out", "o"], options.Sweep(out=Path("o"))),
    "train": (
        ["--out", "o", "--reward", "task"],
        options.Train(out=Path("o"), reward="task"),
    ),
    "options": (
        ["--policy", "a=p", "--policy", "b=q", "--out", "o"],
        options.Options(policy=("a=p", "b=q"), out=Path("o")),
    ),
    "record": (
        ["--policy", "p", "--dataset", "d"],
        options.Record(policy=Path("p"), dataset=Path("d")),
    ),
    "pairs": (
        ["--dataset", "d", "--count", "3"],
        options.Pairs(dataset=Path("d"), count=3),
    ),
    "answer": (
        ["--dataset", "d", "--criterion", "task"],
        options.Answer(dataset=Path("d"), criterion="task"),
    ),
    "fit": (
        ["--dataset", "d", "--dataset", "e", "--out", "o"],
        options.Fit(dataset=[Path("d"), Path("e")], out=Path("o")),
    ),
    "evaluate": (["--policy", "p"], options.Evaluate(policy=Path("p"))),
    "report": (["--run", "r"], options.Report(run=Path("r"))),
    "robot": (
        ["inspect", "m.xml"],
        options.Robot(action="inspect", xml=Path("m.xml")),
    ),
    "export": (
        ["--policy", "p", "--out", "o"],
        options.Export(policy=Path("p"), out=Path("o")),
    ),
    "trust": (
        ["--reward", "w", "--dataset", "d"],
        options.Trust(reward=Path("w"), dataset=Path("d")),
    ),
    "explain": (
        ["--reward", "w", "--dataset", "d", "--out", "o"],
        options.Explain(reward=Path("w"), dataset=Path("d"), out=Path("o")),
    ),
}


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy of one iteration, its checkpoint and all."""
    out = tmp_path_factory.mktemp("policy")
    ppo = PpoCfg(num_envs=4, hidden_sizes=(8,))
    robot = load_robot(physics_dt_s=EnvCfg().physics_dt_s)
    return train(out, robot, TrainCfg(steps=96, env=EnvCfg(), ppo=ppo)).policy


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_parses_with_its_defaults(name: str) -> None:
    """What must be given is given, the rest has a default."""
    arguments, expected = COMMANDS[name]
    assert parse([name, *arguments]) == expected


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """`--help` describes each option and exits 0."""
    with pytest.raises(SystemExit) as caught:
        main([name, "--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    for argument in COMMANDS[name][0]:
        if argument.startswith("--"):
            assert argument in text


def _refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line a command is refused with."""
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.startswith("gaitpref: ")
    return line


def test_the_stages_work_one_by_one(
    policy: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Record, ask, answer, fit, train on it, evaluate: each from its own command."""
    dataset, reward = str(tmp_path / "dataset"), str(tmp_path / "reward")
    record = ["record", "--policy", str(policy), "--dataset", dataset]
    assert main([*record, "--episodes", "40"]) == 0
    assert main(["pairs", "--dataset", dataset, "--count", "12"]) == 0
    answer = ["answer", "--dataset", dataset, "--criterion"]
    assert main([*answer, "crouch", "--mistakes", "0.1"]) == 0
    assert main([*answer, "trot@3", "--rater", "stochastic", "--beta", "3"]) == 0
    capsys.readouterr()
    fit = ["fit", "--dataset", dataset, "--out", reward, "--model", "auto", "--json"]
    assert main(fit) == 0
    fitted = json.loads(capsys.readouterr().out)
    assert fitted["model"] == "linear"
    assert fitted["answers"] == 24
    raters = [name for name, _ in fitted["raters"]]
    assert raters == ["simulated:crouch", "simulated:trot@3"]
    more = ["pairs", "--dataset", dataset, "--count", "4", "--reward", reward]
    for strategy in ("disagreement", "entropy", "bald", "kcenter", "medoids", "dpp"):
        assert main([*more, "--strategy", strategy]) == 0
    with Dataset.open(Path(dataset)).answers() as store:
        asked = {pair.strategy for pair in store.pairs()}
    assert asked >= {"uniform", "bald", "kcenter", "medoids", "dpp"}
    out = str(tmp_path / "out")
    learn = ["train", "--out", out, "--reward", reward, "--steps", "96"]
    assert main([*learn, "--envs", "4"]) == 0
    capsys.readouterr()
    evaluate = ["evaluate", "--policy", f"{out}/policy.pt", "--reward", reward]
    monkeypatch.setattr(progress, "_QUIET_S", 0.0)
    assert main([*evaluate, "--episodes", "8", "--json"]) == 0
    said = capsys.readouterr()
    assert re.search(r"setting off from rest, steps: 1 of [\d,]+, .* left", said.err)
    result = json.loads(said.out)
    assert result["episodes"] == 8
    assert {
        "return_mean",
        "return_ci95",
        "episode_length_s",
        "tracking_error_m_s",
        "falls_per_minute",
    } <= set(result)


def test_missing_and_corrupt_policies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file is named; no data set is begun."""
    bad = tmp_path / "policy.pt"
    record = ["record", "--policy", str(bad), "--dataset", str(tmp_path / "d")]
    assert "there is no policy file" in _refused(record, capsys)
    bad.write_bytes(b"PK\x03\x04 nonsense")
    assert "not a policy file" in _refused(record, capsys)
    assert "not a policy file" in _refused(["evaluate", "--policy", str(bad)], capsys)
    assert not (tmp_path / "d").exists()


def test_a_robot_without_a_free_joint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Said before anything is written."""
    xml = tmp_path / "arm.xml"
    xml.write_text(
        "<mujoco><worldbody><body><joint type='hinge'/><geom size='.1' mass='1'/>"
        "</body></worldbody></mujoco>"
    )
    out = tmp_path / "out"
    for command in (
        ["train", "--out", str(out), "--reward", "task", "--robot", str(xml)],
        ["loop", "--run", str(out), "--robot", str(xml)],
    ):
        line = _refused(command, capsys)
        assert "free" in line
        assert "arm.xml" in line
    assert not out.exists()


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("raise KeyError('base')", "raised KeyError"),
        ("return features[..., 0] / 0 * 0", "NaN"),
        ("return features[0]", "one score per row"),
    ],
)
def test_a_criterion_that_misbehaves_starts_no_loop(
    body: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line, and no run directory."""
    module = f"taste_{abs(hash(body))}"
    (tmp_path / f"{module}.py").write_text(f"def f(features):\n    {body}\n")
    monkeypatch.chdir(tmp_path)
    loop = ["loop", "--run", "run", "--criterion", f"{module}:f"]
    assert message in _refused(loop, capsys)
    assert not Path("run").exists()


def test_too_few_answers(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The number there is, the number needed, and what to run."""
    dataset, reward = tmp_path / "dataset", tmp_path / "reward"
    main(["record", "--policy", str(policy), "--dataset", str(dataset)])
    capsys.readouterr()
    line = _refused(["fit", "--dataset", str(dataset), "--out", str(reward)], capsys)
    assert "answer" in line
    assert not reward.exists()


def test_a_data_set_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The directory is named, and what makes one."""
    line = _refused(["pairs", "--dataset", str(tmp_path), "--count", "1"], capsys)
    assert "gaitpref record" in line
    empty = Dataset.create(tmp_path / "empty").root
    line = _refused(["pairs", "--dataset", str(empty), "--count", "1"], capsys)
    assert "gaitpref record" in line


def test_a_run_with_other_settings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A foreign directory is left alone; no round yet is no report."""
    (tmp_path / "notes.txt").write_text("mine")
    assert "not empty" in _refused(["loop", "--run", str(tmp_path)], capsys)
    assert "gaitpref loop" in _refused(["report", "--run", str(tmp_path)], capsys)
    line = _refused(["loop", "--run", str(tmp_path / "r"), "--labels", "5"], capsys)
    assert "--labels 5" in line
    assert not (tmp_path / "r").exists()


def test_training_goes_on_with_networks_of_another_size(
    policy: Path, tmp_path: Path
) -> None:
    """A policy file says how large its networks are; `--init` follows it."""
    train = ["train", "--out", str(tmp_path), "--reward", "task", "--envs", "4"]
    assert main([*train, "--steps", "96", "--init", str(policy)]) == 0


def test_numbers_that_cannot_be(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The option, its value and the smallest possible one are named."""
    train = ["train", "--out", str(tmp_path / "o"), "--reward", "task"]
    assert "--envs must be at least 1, got 0" in _refused(
        [*train, "--envs", "0"], capsys
    )
    assert "--seed" in _refused([*train, "--seed", "-1"], capsys)
    loop = ["loop", "--run", str(tmp_path / "o"), "--rounds", "0"]
    assert "--rounds must be at least 1, got 0" in _refused(loop, capsys)
    split = ["data", "split", "--dataset", "d", "--out", str(tmp_path / "o")]
    assert "--seed must be at least 0, got -2" in _refused(
        [*split, "--seed", "-2"], capsys
    )
    assert "--patience must be at least 0, got nan" in _refused(
        [*loop[:-2], "--patience", "nan"], capsys
    )
    assert not (tmp_path / "o").exists()


def test_every_whole_number_says_how_small_it_may_be() -> None:
    """Wherever it is declared, also in records of options inside of others."""

    def unbounded(kind: type) -> list[str]:
        found = []
        for name, hint in get_type_hints(kind, include_extras=True).items():
            alternatives = get_origin(hint) in (Union, UnionType)
            kinds = get_args(hint) if alternatives else (hint,)
            found += [f"{kind.__name__}.{name}"] if int in kinds else []
            for part in kinds:
                if isinstance(part, type) and is_dataclass(part):
                    found += unbounded(part)
        return found

    data_actions = get_type_hints(options.Data, include_extras=True)["action"]
    commands = [*get_args(options.Command), *_members(data_actions)]
    kinds = [get_args(command)[0] for command in commands]
    assert len(kinds) > 25
    # A port has a largest value as well, which is looked at where it is opened.
    assert {name for kind in kinds for name in unbounded(kind)} == {
        "Serving.port",
        "Label.port",
        "Play.port",
        "Watch.port",
    }


def _members(hint: object) -> list[object]:
    """The annotated members of a union, however it is wrapped."""
    parts = get_args(hint)
    if parts and isinstance(parts[0], type) and is_dataclass(parts[0]):
        return [hint]
    return [member for part in parts for member in _members(part)]


def test_a_finished_training_is_not_overwritten(
    policy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Training into the directory of another run is refused."""
    before = policy.read_bytes()
    train = ["train", "--out", str(policy.parent), "--reward", "task"]
    assert "--resume goes on" in _refused(train, capsys)
    assert policy.read_bytes() == before


def test_bad_usage_exits_with_2(capsys: pytest.CaptureFixture[str]) -> None:
    """An option that does not exist, a number that is none."""
    for arguments in (["loop", "--no-such"], ["train", "--steps", "many"]):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2


def test_json_is_all_there_is_on_standard_output(policy: Path) -> None:
    """In a process of its own, nothing else is printed there."""
    command = [sys.executable, "-m", "gaitpref", "evaluate", "--json"]
    done = subprocess.run(
        [*command, "--policy", str(policy), "--episodes", "2"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(done.stdout)["episodes"] == 2


@pytest.mark.parametrize("asked", ["data info --json --dataset set", "loop --help"])
def test_a_reader_who_has_had_enough_is_no_error(tmp_path: Path, asked: str) -> None:
    """As with `gaitpref ... | head -0`: no traceback, and no success either."""
    Dataset.create(tmp_path / "set")
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as gone:
        done = subprocess.run(
            [sys.executable, "-m", "gaitpref", *asked.split()],
            stdout=gone,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
        )
    assert (done.returncode, done.stderr) == (141, "")
