"""Every command meets every fault with one line, exit code 2, and nothing lost."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import gaitpref
import gaitpref.cli.commands.label
import gaitpref.cli.commands.looking.play
import gaitpref.cli.commands.looking.watch
from gaitpref.cli.main import main
from gaitpref.cli.usage import commands

pytest.importorskip("mcap_ros2.writer", reason="needs the extra `view`")
pytest.importorskip("h5py", reason="needs the extra `export`")
pytest.importorskip("onnxscript", reason="needs the extra `onnx`")

from tests.helpers.command_table import TABLE, Typed, make_world
from tests.helpers.faulty_places import IN_PLACE, PLACES

LINES = [typed.line for typed in TABLE]
READ_NOTHING = ("data verify", "data recover")
"""Exit with 1 where something is damaged: that is what they are asked."""


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Everything the commands of the table read."""
    made = tmp_path_factory.mktemp("commands") / "world"
    made.mkdir()
    make_world(made)
    return made


@pytest.fixture(scope="module")
def found(
    world: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, dict[str, dict[str, Any]] | None]:
    """What became of every command in every place."""
    root = tmp_path_factory.mktemp("found")
    command = [
        sys.executable,
        "-m",
        "tests.helpers.faulty_places",
        str(world),
        str(root),
    ]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[2],
        env=drawing(),
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return {place: json.loads((root / f"{place}.json").read_text()) for place in PLACES}


def drawing() -> dict[str, str]:
    """The environment of commands that may draw, as other tests may not."""
    return {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}


def test_no_command_is_left_out() -> None:
    """Who adds a command adds it to the table of those that are broken here."""
    assert {typed.words for typed in TABLE} == set(commands())


@pytest.mark.parametrize("place", PLACES)
def test_a_fault_is_told_in_one_line(
    place: str, found: dict[str, dict[str, dict[str, Any]] | None]
) -> None:
    """No traceback, no hang, nothing changed or half-made, and a line that helps."""
    outcomes = found[place]
    if outcomes is None:
        pytest.skip(f"this machine lets nobody try {place!r}")
    assert len(outcomes) > len(TABLE) // 2
    for name, outcome in outcomes.items():
        number, *where = name.split("|")
        case = f"{place} {where}: {LINES[int(number)]}: {outcome}"
        assert "Traceback" not in outcome["out"] + outcome["err"], case
        allowed = (0, 1, 2) if LINES[int(number)].startswith(READ_NOTHING) else (0, 2)
        assert outcome["code"] in allowed, case
        if outcome["code"] == 2:
            (line,) = outcome["err"].splitlines()
            assert line.startswith("gaitpref: "), case
            assert "move it away" not in line, case
            assert outcome["unchanged"], case


@pytest.mark.parametrize("kind", IN_PLACE)
def test_what_is_no_file_is_refused(
    kind: str, found: dict[str, dict[str, dict[str, Any]] | None]
) -> None:
    """Where the very thing a command is given is something else, it says which."""
    outcomes = found["inputs"] or {}
    own = {"cut.mcap", "train/policy.pt", "set.zip", "walk.mcap", "map.toml", "go1.xml"}
    seen = 0
    for name, outcome in outcomes.items():
        number, part, of_kind = name.split("|")
        # An empty map says that everything is called as usual.
        usual = (part, kind) == ("map.toml", "empty file")
        if of_kind == kind and part in own and not usual:
            seen += 1
            salvaged = LINES[int(number)].startswith("data recover")
            assert outcome["code"] in ((1, 2) if salvaged else (2,)), (name, outcome)
            if outcome["code"] == 2:
                # The message may cut a long path short.
                assert Path(part).name in outcome["err"], (name, outcome)
    assert seen == len(own) - (kind == "empty file")


@pytest.mark.parametrize("place", ["read-only", "full"])
def test_who_writes_says_why_it_cannot(
    place: str, found: dict[str, dict[str, dict[str, Any]] | None]
) -> None:
    """The line names the cause; nobody is told to throw a sound store away."""
    outcomes = found[place]
    if outcomes is None:
        pytest.skip(f"this machine lets nobody try {place!r}")
    for number, typed in enumerate(TABLE):
        outcome = outcomes[str(number)]
        looks_only = typed.words == ("data", "recover") and not typed.writes_out
        if (typed.writes_out or typed.writes_set) and not looks_only:
            assert outcome["code"] == 2, (typed.line, outcome)
            assert place in outcome["err"], (typed.line, outcome)
    of_train = next(n for n, line in enumerate(LINES) if line.startswith("train"))
    resumed = "with --resume" in outcomes[str(of_train)]["err"]
    assert resumed == (place == "full")


def test_who_reads_needs_no_right_to_write(
    found: dict[str, dict[str, dict[str, Any]] | None],
) -> None:
    """A data set on a read-only disk is read by all who do not write into it."""
    outcomes = found["read-only source"]
    if outcomes is None:
        pytest.skip("this machine lets nobody mount a disk")
    for number, outcome in outcomes.items():
        typed = TABLE[int(number)]
        writes = typed.writes_set or typed.words == ("report",)
        if not writes:
            assert outcome["code"] == 0, (typed.line, outcome)
    for name in ("raters --dataset {dataset} stats", "data info --dataset {dataset}"):
        assert outcomes[str(LINES.index(name))]["out"]


@pytest.fixture
def own_world(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A world that may be changed; pages are closed as soon as they are open."""
    monkeypatch.chdir(tmp_path)
    for module in (
        gaitpref.cli.commands.label,
        gaitpref.cli.commands.looking.play,
        gaitpref.cli.commands.looking.watch,
    ):
        monkeypatch.setattr(module, "wait_until_stopped", lambda _: None)
    return Path(shutil.copytree(world, tmp_path / "wörld"))


def _quick(typed: Typed) -> bool:
    """Whether it takes less than a second where nothing is wrong."""
    return typed.words[0] not in ("loop", "sweep", "train", "export", "explain")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_an_output_of_few_letters(
    encoding: str, own_world: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it has no letter for is spelled otherwise, in every command and its help."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    lines = [typed for typed in TABLE if _quick(typed) and encoding == "ascii"]
    runs = [typed.args(own_world, own_world / f"{n}•") for n, typed in enumerate(lines)]
    runs += [[*words, "--help"] for words in commands()]
    for args in runs:
        out, err = (
            io.TextIOWrapper(io.BytesIO(), encoding, write_through=True)
            for _ in range(2)
        )
        with monkeypatch.context() as patched:
            patched.setattr(sys, "stdout", out)
            patched.setattr(sys, "stderr", err)
            try:
                code = main(args)
            except SystemExit as left:
                code = left.code
        said = err.buffer.getvalue().decode(encoding)
        assert code == 0, (args, said)
        assert "Traceback" not in said
        # An arena of people says on standard output who answers next.
        ends = "--help" in args or args[0] == "arena"
        assert ends or "next: " in said, (args, said)


@pytest.mark.parametrize("redirected", [">/dev/full", ">&-"])
def test_an_output_that_takes_nothing(redirected: str, world: Path) -> None:
    """Standard output that is full or closed is an error that is told, in one line."""
    program = [sys.executable, "-m", "gaitpref"]
    for args in (
        Typed("data info --dataset {dataset}").args(world, world),
        ["--help"],
        ["--version"],
    ):
        done = subprocess.run(
            ["sh", "-c", f'exec "$@" {redirected}', "sh", *program, *args],
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert line.startswith("gaitpref: ")


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("trian --out x", "did you mean `gaitpref train`?"),
        ("data pakc --dataset x", "did you mean `gaitpref data pack`?"),
        ("train --ouut x --reward task", "did you mean --out instead of --ouut?"),
        ("pairs --dataset d --count 3 --strategy unifrom", "--strategy uniform"),
        (
            "data labels --dataset x --format=cvs",
            "did you mean --format csv instead of cvs?",
        ),
        ("raters revok ada --dataset x", "did you mean revoke instead of revok?"),
    ],
)
def test_what_was_meant(
    line: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The nearest command, option or choice is named; the exit code is 2."""
    try:
        code = main(line.split())
    except SystemExit as left:
        code = left.code
    assert code == 2
    assert meant in capsys.readouterr().err


def test_which_version_this_is(capsys: pytest.CaptureFixture[str]) -> None:
    """One line, exit code 0."""
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"gaitpref {gaitpref.__version__}\n"
