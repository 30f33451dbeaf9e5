"""A run directory: one writer, whole settings, and inputs told by their contents."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from data.lock import LOCK_NAME
from data.plain import from_plain, to_plain
from gaitpref.cli import main
from gaitpref.loop_cfg import LoopCfg, RunError
from gaitpref.options import Loop
from gaitpref.presets import resolve
from gaitpref.rounds import Round
from gaitpref.run_config import CONFIG_NAME, INPUTS_NAME, claim, read_config

from .test_data_lock import HOLDER

INPUTS = {"base": None, "robot": "sha256 of a model", "criterion": {"source": "s"}}


@pytest.fixture
def cfg() -> LoopCfg:
    return resolve(Loop(run=Path("run"), base="none"))


@pytest.fixture
def trained(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A real training into `out`, that has begun and takes its time."""
    command = [sys.executable, "-m", "gaitpref.cli", "train", "--reward", "task"]
    command += ["--out", str(tmp_path / "out"), "--envs", "16", "--steps", "9000000"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    while not (tmp_path / "out" / LOCK_NAME).exists():
        assert process.poll() is None
    yield process
    process.kill()
    process.communicate()


def test_a_second_training_stops_at_once_and_a_killed_one_holds_nothing(
    tmp_path: Path,
    trained: subprocess.Popen[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    args = ["train", "--reward", "task", "--out", str(tmp_path / "out")]
    args += ["--envs", "16", "--steps", "384"]
    assert main(args) == 2
    said = capsys.readouterr().err
    assert f"pid {trained.pid} on" in said
    assert said.count("\n") == 1
    os.kill(trained.pid, signal.SIGKILL)
    trained.wait()
    assert main([*args, "--resume"]) == 0
    assert not (tmp_path / "out" / LOCK_NAME).exists()


@pytest.mark.parametrize(
    ("lock", "args"),
    [
        ("run", ["loop", "--run", "{}/run", "--preset", "quick"]),
        (
            "fit",
            ["fit", "--dataset", "tests/stored/dataset_v1", "--out", "{}/reward"],
        ),
    ],
)
def test_a_second_loop_or_fit_stops_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lock: str, args: list[str]
) -> None:
    """And leaves nothing behind."""
    code = HOLDER
    if lock == "fit":
        place = "Path(sys.argv[1]) / '.reward.lock'"
        code = HOLDER.replace("print)", f"print, lock={place})")
    target = tmp_path / "run" if lock == "run" else tmp_path
    command = [sys.executable, "-c", code, str(target)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        before = sorted(tmp_path.rglob("*"))
        assert main([arg.format(tmp_path) for arg in args]) == 2
        assert f"pid {process.pid} on" in capsys.readouterr().err
        assert sorted(tmp_path.rglob("*")) == before
        process.kill()


def test_the_configuration_that_is_written_is_whole(
    tmp_path: Path, cfg: LoopCfg
) -> None:
    """Every field of every record in it, so that a default may change."""

    def names(values: object) -> int:
        if isinstance(values, dict):
            return sum(1 + names(entry) for entry in values.values())
        return 0

    claim(tmp_path / "run", cfg, INPUTS)
    written = yaml.safe_load((tmp_path / "run" / CONFIG_NAME).read_text())
    assert names(written) == names(to_plain(cfg, whole=True)) > names(to_plain(cfg))
    assert {"caution", "hurry", "calm_from", "noise_again"} <= written.keys()
    assert read_config(tmp_path / "run") == cfg
    claim(tmp_path / "run", cfg, INPUTS)


@pytest.mark.parametrize(
    ("absent", "changed", "inputs", "told"),
    [
        ((), {"calm_from": 0.75}, {}, "calm_from 0.85 -> 0.75"),
        (("calm_from", "noise_again"), {}, {}, r"2 of today's.*\(calm_from, noise_"),
        ((), {}, {"robot": "another"}, "robot sha256 of a model -> another"),
        ((), {}, {"criterion": {"source": "t"}}, "criterion.source s -> t"),
        ((), {}, {"base": "b"}, "base None -> b"),
    ],
)
def test_a_run_begun_under_other_values_says_so(
    tmp_path: Path,
    cfg: LoopCfg,
    absent: tuple[str, ...],
    changed: dict[str, float],
    inputs: dict[str, object],
    told: str,
) -> None:
    """Also where only a file behind a name has changed, or an earlier version did not
    write what it ran under."""
    run = tmp_path / "run"
    claim(run, cfg, INPUTS)
    written = yaml.safe_load((run / CONFIG_NAME).read_text())
    for name in absent:
        del written[name]
    (run / CONFIG_NAME).write_text(yaml.safe_dump(written))
    with pytest.raises(RunError, match=told):
        claim(run, replace(cfg, **changed), INPUTS | inputs)
    # What only looks at it still reads it.
    assert read_config(run) == cfg


def test_what_a_run_was_started_with_must_be_readable(
    tmp_path: Path, cfg: LoopCfg
) -> None:
    run = tmp_path / "run"
    claim(run, cfg, INPUTS)
    for content in (b"{", b"\xff"):
        (run / INPUTS_NAME).write_bytes(content)
        with pytest.raises(RunError, match=r"inputs\.json cannot be read"):
            claim(run, cfg, INPUTS)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("rater", "humna", "rater must be one of simulated, human; got 'humna'"),
        ("strategy", "best", "strategy must be one of .*disagreement.*; got 'best'"),
        ("rounds", "three", "rounds must be a whole number, got 'three'"),
        ("rounds", 2.5, "rounds must be a whole number, got 2.5"),
        ("mirror", "no", "mirror must be true or false, got 'no'"),
        ("seed", True, "seed must be a whole number, got True"),
        ("caution", "much", "caution must be a number, got 'much'"),
        ("criterion", 5, "criterion must be a text, got 5"),
        ("robot", ["a"], "robot must be a text, got"),
        ("env", 5, "env must hold settings, got 5"),
        ("exploration", 0.5, "exploration must hold settings, got 0.5"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_refused(
    tmp_path: Path, cfg: LoopCfg, name: str, value: object, told: str
) -> None:
    claim(tmp_path / "run", cfg, INPUTS)
    path = tmp_path / "run" / CONFIG_NAME
    written = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump({**written, name: value}))
    with pytest.raises(RunError, match=told):
        read_config(tmp_path / "run")


def test_a_setting_may_be_one_of_two_kinds() -> None:
    """`auto` is of the second of them, `gp` of the first."""
    fit = resolve(Loop(run=Path("run"))).fit
    for kind in ("gp", "auto"):
        plain = json.loads(json.dumps(to_plain(replace(fit, kind=kind))))
        assert from_plain(type(fit), plain).kind == kind
    # What grew by itself never did.
    assert from_plain(type(fit), {**to_plain(fit), "kind": "grow"}).kind == "linear"
    with pytest.raises(ValueError, match=r"kind must be one of .* got 'best'"):
        from_plain(type(fit), {**to_plain(fit), "kind": "best"})


def test_before_the_first_round_there_is_none(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="before round 0"):
        _ = Round(tmp_path, 0).before
