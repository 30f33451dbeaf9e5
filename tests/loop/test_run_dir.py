"""A run directory: one writer, whole settings, and inputs told by their contents."""

from __future__ import annotations

import copy
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import reduce
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import yaml

from data.files.lock import LOCK_NAME
from data.files.plain import from_plain, to_plain
from gaitpref.cli.main import main
from gaitpref.cli.options.options import Loop
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.loop.loop_cfg import LoopCfg, RunError
from gaitpref.loop.run_config import CONFIG_NAME, INPUTS_NAME, claim, read_config
from gaitpref.loop.run_dir import Round
from gaitpref.method.budget import FrontLoaded
from gaitpref.method.exploration import Descending, PutBack
from gaitpref.method.method import FROM_SCRATCH, STYLE, Method
from gaitpref.method.paid import AsFitted
from gaitpref.method.unstick import Optimism
from policy.offpolicy.sac_cfg import SacCfg
from tests.data.test_lock import HOLDER

INPUTS = {"base": None, "robot": "sha256 of a model", "criterion": {"source": "s"}}


@pytest.fixture
def cfg() -> LoopCfg:
    return resolve(Loop(run=Path("run"), base="none"))


@pytest.fixture
def trained(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A real training into `out`, that has begun and takes its time."""
    command = [sys.executable, "-m", "gaitpref", "train", "--reward", "task"]
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
    ("held", "args"),
    [
        ("run", ["loop", "--run", "{}/run", "--preset", "quick"]),
        (
            "reward",
            ["fit", "--dataset", "tests/stored/dataset_v1", "--out", "{}/reward"],
        ),
    ],
)
def test_a_second_loop_or_fit_stops_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], held: str, args: list[str]
) -> None:
    """And leaves nothing behind."""
    # A reward is replaced as a whole, so its lock is beside it.
    told = "print, replaced=True)" if held == "reward" else "print)"
    code = HOLDER.replace("print)", told)
    command = [sys.executable, "-c", code, str(tmp_path / held)]
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
    method = written["method"]
    assert {"paid", "unstick", "exploration", "tracking"} <= method.keys()
    assert {"sure", "caution"} < method["paid"].keys()
    assert read_config(tmp_path / "run") == cfg
    claim(tmp_path / "run", cfg, INPUTS)


METHODS = {
    "from scratch": FROM_SCRATCH,
    "style": STYLE,
    "from scratch, no hope": replace(FROM_SCRATCH, unstick=None),
    "from scratch, unjudged": replace(FROM_SCRATCH, accept=None),
    "from scratch, keeps its noise": replace(FROM_SCRATCH, exploration=None),
    "style, keeps its noise": replace(STYLE, exploration=None),
    "style, unjudged": replace(STYLE, accept=None),
    "style, no limit": replace(STYLE, tracking=None),
    "as much in every round": replace(
        FROM_SCRATCH, budget=FrontLoaded(first_share=0.3)
    ),
    "front-loaded style": replace(STYLE, budget=FrontLoaded(first_share=0.5)),
    "as fitted": replace(STYLE, paid=AsFitted()),
    "noise back": replace(FROM_SCRATCH, exploration=PutBack()),
    "noise descends": replace(STYLE, exploration=Descending()),
    "off-policy": replace(STYLE, learner=SacCfg(), exploration=None),
}
"""Both that ship, each with every decision it may lack left out, and every union with
each of its classes."""


def test_every_decision_that_may_be_left_out_is() -> None:
    """In one of the methods above, of those that have it."""
    optional = {
        name
        for name, hint in get_type_hints(Method).items()
        if type(None) in get_args(hint)
    }
    decided = ("exploration", "unstick", "accept", "tracking", "meanwhile", "learner")
    assert optional == {*decided}
    for shipped in (FROM_SCRATCH, STYLE):
        for name in optional:
            changed = replace(shipped, **{name: None})
            assert changed in METHODS.values(), name


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_method_is_read_as_it_was_written(
    tmp_path: Path, cfg: LoopCfg, method: Method
) -> None:
    """Of its decisions that may be of several classes, the class too; and no other
    method may go on with the run."""
    run, own = tmp_path / "run", replace(cfg, method=method)
    claim(run, own, INPUTS)
    found = read_config(run).method
    assert found == method
    for decision in ("budget", "paid", "exploration"):
        assert type(getattr(found, decision)) is type(getattr(method, decision))
    claim(run, own, INPUTS)
    for other in METHODS.values():
        if other != method:
            with pytest.raises(RunError, match=r"with other settings \(method\."):
                claim(run, replace(cfg, method=other), INPUTS)


def test_no_value_of_a_decision_may_change(tmp_path: Path, cfg: LoopCfg) -> None:
    """Every number, name and truth in the methods that ship, one by one."""
    for index, method in enumerate((FROM_SCRATCH, STYLE)):
        run = tmp_path / str(index)
        claim(run, replace(cfg, method=method), INPUTS)
        path, tried = run / CONFIG_NAME, 0
        whole = yaml.safe_load(path.read_text())
        for place in places_of(whole["method"]):
            changed = copy.deepcopy(whole)
            *parents, name = place
            holder = reduce(lambda part, key: part[key], parents, changed["method"])
            holder[name] = other_than(holder[name])
            path.write_text(yaml.safe_dump(changed))
            told = re.escape(f"method.{'.'.join(place)} ")
            with pytest.raises(RunError, match=rf"with other settings \({told}"):
                claim(run, replace(cfg, method=method), INPUTS)
            tried += 1
        assert tried > 50


def places_of(values: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """Where the leaves of `values` are."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from (
                (name, *rest) for rest in places_of(value) if rest != ("class",)
            )
        else:
            yield (name,)


def other_than(value: object) -> object:
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int | float) else "other"


@pytest.mark.parametrize(
    ("absent", "change", "inputs", "told"),
    [
        (
            (),
            {"exploration": PutBack(calm_from=0.75)},
            {},
            r"method\.exploration\.calm_from 0\.85 -> 0\.75",
        ),
        ((), {"exploration": Descending()}, {}, "exploration PutBack -> Descending"),
        ((), {"budget": FrontLoaded(first_share=0.5)}, {}, "first_share 0.65 -> 0.5"),
        ((), {"unstick": Optimism()}, {}, r"unstick None -> {'deviations': 2\.0"),
        ((), {"weight": 2.0}, {}, "method.weight 3.0 -> 2.0"),
        (
            (("exploration", "calm_from"), ("exploration", "later")),
            {},
            {},
            r"2 of today's.*\(method\.exploration\.calm_from, .*later\)",
        ),
        ((), {}, {"robot": "another"}, "robot sha256 of a model -> another"),
        ((), {}, {"criterion": {"source": "t"}}, "criterion.source s -> t"),
        ((), {}, {"base": "b"}, "base None -> b"),
    ],
)
def test_a_run_begun_under_other_values_says_so(
    tmp_path: Path,
    cfg: LoopCfg,
    absent: tuple[tuple[str, str], ...],
    change: dict[str, Any],
    inputs: dict[str, object],
    told: str,
) -> None:
    """Also where only a file behind a name has changed, or an earlier version did not
    write what it ran under."""
    run, cfg = tmp_path / "run", replace(cfg, method=STYLE)
    claim(run, cfg, INPUTS)
    written = yaml.safe_load((run / CONFIG_NAME).read_text())
    for decision, name in absent:
        del written["method"][decision][name]
    (run / CONFIG_NAME).write_text(yaml.safe_dump(written))
    with pytest.raises(RunError, match=told):
        claim(run, replace(cfg, method=replace(STYLE, **change)), INPUTS | inputs)
    # What only looks at it still reads it.
    assert read_config(run) == cfg


EARLIER = """\
rounds: 4
labels: 100
rater: simulated
criterion: task
base: none
robot: null
seed: 0
base_steps: 0
round_steps: 600000
last_round_steps: 800000
learned_weight: 1.0
caution: 1.0
approval_labels: 7
exploration: {early: 0.7, late: 0.5, last: 0.4, final: 0.1}
far_limit: null
first_share: 0.48
batch_labels: 10
fit: {kind: grow, error_share: 0.3}
"""
"""From the configuration of a run before there were methods."""


def test_a_run_of_an_earlier_version_is_left_to_that(
    tmp_path: Path, cfg: LoopCfg, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever goes on with it or only looks at it is told what to do, and nothing of it
    changes."""
    run = tmp_path / "run"
    run.mkdir()
    (run / CONFIG_NAME).write_text(EARLIER)
    (run / INPUTS_NAME).write_text(json.dumps(INPUTS))
    before = {path: path.read_bytes() for path in run.iterdir()}
    told = "started by an earlier gaitpref.*go on with that version, or give another"
    with pytest.raises(RunError, match=told):
        claim(run, cfg, INPUTS)
    with pytest.raises(RunError, match=told):
        read_config(run)
    asked = ["loop", "--run", str(run), "--base", "none"]
    for command in (asked, ["report", "--run", str(run)]):
        assert main(command) == 2
        said = " ".join(capsys.readouterr().err.split())
        assert re.search(told, said)
        assert str(run) in said
    assert {path: path.read_bytes() for path in run.iterdir()} == before


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
        ("rounds", "three", "rounds must be a whole number, got 'three'"),
        ("rounds", 2.5, "rounds must be a whole number, got 2.5"),
        ("seed", True, "seed must be a whole number, got True"),
        ("criterion", 5, "criterion must be a text, got 5"),
        ("robot", ["a"], "robot must be a text, got"),
        ("env", 5, "env must hold settings, got 5"),
        ("method", 5, "method must hold settings, got 5"),
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


@pytest.mark.parametrize(
    ("decision", "value", "told"),
    [
        ("questions", {"strategy": "best"}, "one of .*disagreement.*; got 'best'"),
        ("questions", {"batch": 0}, "batch must be at least 1, got 0"),
        ("questions", {"uniform_share": 1.5}, r"uniform_share must lie in \[0, 1\]"),
        ("mirror", "no", "mirror must be true or false, got 'no'"),
        ("weight", "much", "weight must be a number, got 'much'"),
        ("exploration", 0.5, "exploration must hold settings, got 0.5"),
        (
            "budget",
            {"first_share": 0.0},
            r"first_share must lie in \(0, 1\), got 0",
        ),
        ("budget", {}, "FrontLoaded: .*'first_share'"),
        ("budget", None, "must hold settings, got None"),
        (
            "paid",
            {"class": "Nothing"},
            "paid must be one of SurelyLiked, AsFitted; got 'Nothing'",
        ),
        ("paid", {"class": ["a"]}, "Method: unhashable"),
        ("paid", {"class": "AsFitted", "beyond": 0.5}, "AsFitted has no field beyond"),
        ("starts", {}, "Method has no field starts"),
    ],
)
def test_a_decision_of_the_wrong_kind_is_refused(
    tmp_path: Path, cfg: LoopCfg, decision: str, value: object, told: str
) -> None:
    claim(tmp_path / "run", cfg, INPUTS)
    path = tmp_path / "run" / CONFIG_NAME
    written = yaml.safe_load(path.read_text())
    written["method"][decision] = value
    path.write_text(yaml.safe_dump(written))
    with pytest.raises(RunError, match=told):
        read_config(tmp_path / "run")


def test_a_setting_may_be_one_of_two_kinds() -> None:
    """`auto` is of the second of them, `gp` of the first."""
    fit = STYLE.reward
    for kind in ("gp", "auto"):
        plain = json.loads(json.dumps(to_plain(replace(fit, kind=kind))))
        assert from_plain(type(fit), plain).kind == kind
    # What grew by itself never did.
    assert from_plain(type(fit), {**to_plain(fit), "kind": "grow"}).kind == "linear"
    with pytest.raises(ValueError, match=r"kind must be one of .* got 'best'"):
        from_plain(type(fit), {**to_plain(fit), "kind": "best"})


def test_a_run_has_few_settings_beside_its_method() -> None:
    """A decision is a field of `Method`."""
    assert len(fields(LoopCfg)) <= 16


def test_before_the_first_round_there_is_none(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="before round 0"):
        _ = Round(tmp_path, 0).before
