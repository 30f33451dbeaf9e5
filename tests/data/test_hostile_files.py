"""Files of strangers: what they claim is not believed, what they say does not act."""

from __future__ import annotations

import csv
import io
import json
import os
import resource
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from benchmarks import attack_files
from data.answers.answer_records import Answer
from data.datasets.dataset import Dataset
from data.files.limits import EPISODE_CHUNK_BYTES
from gaitpref.cli.main import main
from tests.helpers.motion import trotting_dataset

ROOT = Path(__file__).parents[2]
NAUGHTY = "=cmd|'/C calc'!A0\x1b[31m\x9b\u202e[red]\nada: 1,000 answers"


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set with a few episodes and answers."""
    root = tmp_path_factory.mktemp("hostile") / "set"
    trotting_dataset(root)
    return root


@pytest.fixture(scope="module")
def archive(sound: Path) -> Path:
    """The same in one file."""
    packed = sound.parent / "set.zip"
    assert main(["data", "pack", "--dataset", str(sound), "--out", str(packed)]) == 0
    return packed


def _episode(sound: Path) -> bytes:
    return next((sound / "rollouts").glob("*/*.mcap")).read_bytes()


@pytest.mark.parametrize("told", [True, False])
def test_a_bomb_takes_no_memory(told: bool, sound: Path, tmp_path: Path) -> None:
    """3 GB in 100 kB: no process gets beyond what it needs without it."""
    bomb = tmp_path / "bomb.mcap"
    attack_files.bombed(b"zstd", 1000, told=told)(bomb, _episode(sound))
    assert bomb.stat().st_size < 300_000
    args = ["data", "recover", "--dataset", str(tmp_path / "new"), "--file", str(bomb)]
    code = (
        "import sys\nfrom gaitpref.cli.main import main\n"
        "code = main(sys.argv[1:])\n"
        "status = open('/proc/self/status').read()\n"
        "print(status.partition('VmHWM:')[2].split()[0])\nsys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *args], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 1
    assert "no whole chunk of steps is left" in done.stdout
    most_bytes = int(done.stdout.split()[-1]) * 1024
    assert most_bytes < 100 * 2**20 + 2 * EPISODE_CHUNK_BYTES


@pytest.mark.parametrize("name", [*attack_files.ARCHIVES, *attack_files.PAIRS])
def test_nothing_is_unpacked_of_a_bad_archive(
    name: str, archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, and not a file anywhere."""
    bad = tmp_path / "bad.zip"
    make = (attack_files.ARCHIVES | attack_files.PAIRS)[name]
    make(bad, archive.read_bytes())
    (tmp_path / "sound.zip").unlink(missing_ok=True)
    new = tmp_path / "new"
    code = main(["data", "unpack", "--dataset", str(new), "--archive", str(bad)])
    (line,) = capsys.readouterr().err.splitlines()
    assert code == 2
    assert "bad.zip" in line
    assert [path.name for path in tmp_path.iterdir()] == ["bad.zip"]


def test_a_sound_archive_is_unpacked_whole(archive: Path, tmp_path: Path) -> None:
    """What the checks let through is all that was packed, and verifies."""
    new = str(tmp_path / "new")
    unpack = ["data", "unpack", "--archive", str(archive)]
    assert main([*unpack, "--dataset", new]) == 0
    assert main(["data", "verify", "--dataset", new]) == 0
    assert main(["data", "pack", "--dataset", new, "--out", f"{new}.zip"]) == 0
    assert Path(f"{new}.zip").read_bytes() == archive.read_bytes()


def _with_naughty_text(root: Path) -> Dataset:
    dataset = trotting_dataset(root)
    with dataset.answers() as store:
        store.add_rater(NAUGHTY, "human")
        pair = store.pairs()[0]
        store.add_answer(
            Answer(
                answer_id="naughty",
                pair_id=pair.pair_id,
                rater_id=NAUGHTY,
                choice="a",
                shown_left="a",
                note=NAUGHTY,
                created_utc="2030-01-31T12:00:00Z",
            )
        )
    return dataset


@pytest.mark.parametrize(
    "words",
    [
        "data info",
        "raters stats",
        "data labels --format csv",
        "data labels --format jsonl",
        "data card --out /dev/fd/1",
        "data subset --rater [red]\x1b --out none",
    ],
)
def test_text_of_people_never_acts(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No control character reaches a terminal, no line is forged, no markup is read."""
    dataset = _with_naughty_text(tmp_path / "set")
    first, second, *more = words.split(" ")
    main([first, second, "--dataset", str(dataset.root), *more])
    captured = capsys.readouterr()
    said = captured.out + captured.err
    assert all(letter.isprintable() for letter in said.replace("\n", ""))
    assert not any(line.startswith("ada: 1,000") for line in said.splitlines())
    if more[:1] == ["--format"] or first == "raters":
        assert "[red]" in said


def test_a_spreadsheet_runs_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No cell begins as a formula; JSON lines hold the text to the letter."""
    dataset = _with_naughty_text(tmp_path / "set")
    label = ["data", "labels", "--dataset", str(dataset.root), "--format"]
    assert main([*label, "csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    cells = [cell for row in rows for cell in row.values()]
    assert not any(cell.startswith(tuple("=+-@\t\r")) for cell in cells)
    (naughty,) = (row for row in rows if row["answer_id"] == "naughty")
    assert naughty["note"].startswith("'=cmd|")
    assert main([*label, "jsonl"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["note"] for row in lines if row["answer_id"] == "naughty"] == [NAUGHTY]


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "a;=1", "\uff1d1"])
def test_every_beginning_of_a_formula(text: str) -> None:
    """Also behind a semicolon, and in the wide letters of Japanese keyboards."""
    from data.datasets.labels import LABEL_TYPES, to_csv

    row = dict.fromkeys(LABEL_TYPES) | {"note": text}
    (cells,) = csv.DictReader(io.StringIO(to_csv([row])))
    assert cells["note"] != text
    assert cells["note"].replace("'", "", 1) == text


def test_an_output_never_takes_the_place_of_a_device(
    sound: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--out /dev/null` would be replaced by a file, by somebody with the rights."""
    link = tmp_path / "null"
    link.symlink_to("/dev/null")
    out = ["--dataset", str(sound), "--out", str(link)]
    for words in ("card", "pack", "labels"):
        assert main(["data", words, *out]) == 2
        assert "null is a device" in capsys.readouterr().err
    assert link.is_symlink()


def test_a_lock_that_is_a_pipe_is_not_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever would write says so at once; whoever reads needs no lock."""
    dataset = trotting_dataset(tmp_path / "set")
    (dataset.root / ".lock").unlink()
    os.mkfifo(dataset.root / ".lock")
    root = ["--dataset", str(dataset.root)]
    assert main(["data", "info", *root]) == 0
    capsys.readouterr()
    assert main(["data", "merge", *root, "--source", str(dataset.root)]) == 2
    assert ".lock is a named pipe" in capsys.readouterr().err


def test_a_compressed_policy_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A gigabyte of weights in a megabyte is not unpacked."""
    policy = tmp_path / "policy.pt"
    with zipfile.ZipFile(policy, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("archive/data/0", bytes(2**28))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert main(["evaluate", "--policy", str(policy)]) == 2
    assert "not a policy file" in capsys.readouterr().err
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown * 1024 < 2**27


def test_a_sample_of_all_attacks_is_held() -> None:
    """Each eleventh of those the benchmark tries, by the real commands."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.attack_files", "--every", "11"],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
