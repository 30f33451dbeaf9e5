"""A reward for segments of any table: read, fitted, measured, without a robot."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from data.datasets.segments import (
    Segments,
    TableAnswer,
    TableError,
    read_answers,
    read_segments,
)
from gaitpref.cli.main import main
from rewardmodel.errors import RewardError
from rewardmodel.fitting.tables import described, fit_table

SEGMENTS, STEPS = 60, 7
NAMES = ("speed", "tilt", "noise")


def made(seed: int = 0) -> np.ndarray:
    """Rows [S, T, F]; segments differ, and some are shorter."""
    rng = np.random.default_rng(seed)
    own = rng.normal(size=(SEGMENTS, 1, len(NAMES)))
    rows = own + 0.3 * rng.normal(size=(SEGMENTS, STEPS, len(NAMES)))
    rows[:10, -2:] = np.nan
    return rows.astype(np.float32)


def worth(rows: np.ndarray) -> np.ndarray:
    """[S] fast is good, and tilt either way bad."""
    mean = np.nanmean(rows, axis=1)
    return mean[:, 0] - np.nanmean(rows[..., 1] ** 2, axis=1)


def write_answers(path: Path, rows: np.ndarray, count: int, *, wrong: float) -> None:
    """Answers of `ada`, who never errs, and of `bob`, who does."""
    rng = np.random.default_rng(1)
    value = worth(rows)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("left", "right", "answer", "rater"))
        for number in range(count):
            left, right = rng.choice(SEGMENTS, 2, replace=False)
            rater = ("ada", "bob")[number % 2]
            better = value[left] > value[right]
            if rater == "bob" and rng.random() < wrong:
                better = not better
            answer = "left" if better else "right"
            writer.writerow((f"s{left}", f"s{right}", answer, rater))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The same segments in three formats, and answers."""
    rows = made()
    ids = [f"s{number}" for number in range(SEGMENTS)]
    np.savez(tmp_path / "s.npz", rows=rows, names=NAMES, ids=ids)
    flat = [
        (name, *step)
        for name, own in zip(ids, rows, strict=True)
        for step in own
        if not np.isnan(step).any()
    ]
    with (tmp_path / "s.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("segment", *NAMES))
        writer.writerows(flat)
    columns = dict(zip(("segment", *NAMES), zip(*flat, strict=True), strict=True))
    table = pa.table({name: pa.array(list(own)) for name, own in columns.items()})
    pq.write_table(table, tmp_path / "s.parquet")
    write_answers(tmp_path / "answers.csv", rows, 240, wrong=0.45)
    return tmp_path


def test_every_format_gives_the_same_segments(folder: Path) -> None:
    npz, *others = (
        read_segments(folder / f"s.{end}") for end in ("npz", "csv", "parquet")
    )
    (folder / "S.CSV").write_bytes((folder / "s.csv").read_bytes())
    for other in (*others, read_segments(folder / "S.CSV")):
        assert (other.ids, other.names) == (npz.ids, npz.names)
        np.testing.assert_allclose(other.rows, npz.rows, atol=1e-5)
    assert npz.valid.sum() == SEGMENTS * STEPS - 20


@pytest.mark.parametrize("kind", ["linear", "gp", "mlp"])
def test_a_reward_of_segments_foresees_answers(folder: Path, kind: str) -> None:
    """About segments it has not seen; who errs half of the time is told apart."""
    segments = read_segments(folder / "s.npz")
    answers = read_answers(folder / "answers.csv", segments)
    reward = fit_table(segments, answers, kind, seed=0)  # type: ignore[arg-type]
    report = reward.report
    assert report.held_out_accuracy is not None
    assert report.held_out_accuracy > 0.65
    shares = dict(report.raters)
    assert shares["ada"] <= 0.2 < 0.4 < shares["bob"]
    found, spread = reward.worth(segments)
    rank = np.corrcoef(found.numpy(), worth(segments.rows))[0, 1]
    assert rank > 0.9
    assert (spread > 0).all()


def test_the_command_writes_what_it_found(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "out"
    command = ["fit", "--segments", str(folder / "s.csv"), "--out", str(out)]
    labels = ["--labels", str(folder / "answers.csv")]
    assert main([*command, *labels]) == 0
    told = capsys.readouterr().err
    assert "fitted 240 answers" in told
    assert "bob: " in told
    with (out / "weights.csv").open() as file:
        weights = {row["column"]: float(row["weight"]) for row in csv.DictReader(file)}
    assert weights["speed"] > 3 * abs(weights["noise"])
    assert weights["tilt squared"] < -3 * abs(weights["noise squared"])
    with (out / "segments.csv").open() as file:
        assert len(list(csv.DictReader(file))) == SEGMENTS
    report = json.loads((out / "report.json").read_text())
    assert report["answers"] == 240
    assert 0.5 < report["agreement"] < 1.0
    assert 0.0 < report["open_share"] < 1.0
    assert "of the segments' pairs is open" in " ".join(told.split())
    assert "prefers the" not in told
    assert main([*command, *labels, "--json", "--for", "ada"]) == 0
    of_ada = json.loads(capsys.readouterr().out)
    assert (of_ada["model"], of_ada["answers"]) == ("linear", 120)
    for wrong, told in (
        (command, "--segments and --labels go together"),
        ([*command, *labels, "--model", "posterior"], "sees a robot's gait"),
        ([*command, *labels, "--method", "style"], "--method is about data sets"),
        ([*command, *labels, "--for", "eve"], "there are ada, bob (groups are of"),
        (["fit", "--out", str(out)], "give --dataset DIR, or --segments"),
    ):
        assert main(wrong) == 2
        assert told in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("s1,s2,better,ada", "line 2: an answer is left, right, equal"),
        ("s1,x,left,ada", "line 2: there is no segment 'x'"),
        ("s1,s1,left,ada", "line 2: left and right are one segment"),
        ("s1,s2,1.5,ada", "line 2: an answer is left"),
        ("", "holds no answers"),
    ],
)
def test_answers_that_are_none_are_refused(folder: Path, line: str, told: str) -> None:
    path = folder / "bad.csv"
    path.write_text(f"left,right,answer,rater\n{line}\n")
    with pytest.raises(TableError, match=told):
        read_answers(path, read_segments(folder / "s.npz"))
    path.write_text("left,right\ns1,s2\n")
    with pytest.raises(TableError, match="line 1: there is no column 'answer'"):
        read_answers(path, read_segments(folder / "s.npz"))


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.txt", "", "segments come as .npz, .csv, .parquet, not '.txt'"),
        ("a.csv", "segment,x\ns1,fast\n", "a cell is no number"),
        ("a.csv", "segment,x\ns1,nan\n", "missing or infinite"),
        ("a.csv", "x\n1\n", "no column 'segment', but x"),
        ("a.csv", "segment,x,x\ns1,1,2\n", "two columns have one name"),
        ("a.csv", "segment,x\ns1,1,2\n", "line 2 has 3 cells, the first 2"),
        ("a.csv", f"segment,x\n{'s' * 200_000},1\n", "field larger than"),
        ("a.csv", "segment,x\n", "there is no row"),
        ("a.npz", "not a zip", "holds no segments"),
        ("a.parquet", "not a table", "holds no segments"),
    ],
)
def test_tables_that_hold_none_are_refused(
    tmp_path: Path, name: str, content: str, told: str
) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(TableError, match=told):
        read_segments(path)


@pytest.mark.parametrize("damage", ["cut", "flipped"])
@pytest.mark.parametrize("end", ["npz", "parquet"])
def test_a_damaged_archive_is_one_line(folder: Path, end: str, damage: str) -> None:
    path = folder / f"s.{end}"
    content = bytearray(path.read_bytes())
    if damage == "cut":
        content = content[: len(content) // 2]
    else:
        content[200:400] = bytes(200)
    path.write_bytes(content)
    with pytest.raises(TableError, match="holds no segments"):
        read_segments(path)


def test_any_byte_of_a_parquet_file_may_be_wrong(folder: Path) -> None:
    """It is read, or refused in our words."""
    content = (folder / "s.parquet").read_bytes()
    refused = 0
    for place in range(0, len(content), max(1, len(content) // 150)):
        damaged = bytearray(content)
        damaged[place] ^= 0x40
        (folder / "s.parquet").write_bytes(damaged)
        try:
            read_segments(folder / "s.parquet")
        except TableError:
            refused += 1
    assert refused > 10


def test_numbers_far_from_zero_keep_what_they_differ_by(folder: Path) -> None:
    """As seconds since 1970, of which a float of 32 bits tells minutes apart."""
    segments, far = read_segments(folder / "s.npz"), folder / "far.npz"
    rows = segments.rows.astype(np.float64)
    rows[..., 2] += 1.7e9
    np.savez(far, rows=rows, names=NAMES, ids=segments.ids)
    steps, there = described(read_segments(far))
    usual, _ = described(segments)
    np.testing.assert_allclose(steps[there], usual[there], atol=1e-3)


def test_ids_are_what_a_table_of_text_calls_them(folder: Path) -> None:
    rows = made()[:2]
    np.savez(folder / "a.npz", rows=rows, ids=np.array([1.0, 2.0]))
    np.savez(folder / "b.npz", rows=rows, ids=np.array([b"1", b"2"]))
    for name in ("a", "b"):
        assert read_segments(folder / f"{name}.npz").ids == ("1", "2")
    flat = {"segment": [b"1", b"2"], "when": np.array([0, 1], dtype="datetime64[s]")}
    pq.write_table(pa.table(flat), folder / "c.parquet")
    with pytest.raises(TableError, match=r"'when' holds timestamp\[.*s\], and no n"):
        read_segments(folder / "c.parquet")


def test_of_a_rater_with_few_answers_nothing_is_said(folder: Path) -> None:
    """One answer that is not foreseen makes nobody careless."""
    segments = read_segments(folder / "s.npz")
    answers = read_answers(folder / "answers.csv", segments)
    once = replace(answers[0], rater="eve", target=1 - answers[0].target)
    report = fit_table(segments, [*answers, once], "linear", seed=0).report
    assert [name for name, _ in report.raters] == ["ada", "bob"]


def test_who_always_says_left_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table does not say whether sides are drawn by lot, so it is no alarm."""
    head, *lines = (folder / "answers.csv").read_text().splitlines()[:61]
    left = [line.replace(",right,", ",left,") for line in lines]
    (folder / "left.csv").write_text("\n".join([head, *left]))
    command = ["fit", "--segments", str(folder / "s.csv"), "--json"]
    command += ["--labels", str(folder / "left.csv"), "--out", str(folder / "out")]
    assert main(command) == 0
    sentence = json.loads(capsys.readouterr().out)["sentence"]
    assert "ada prefers the left segment in 30 of 30 answers: where" in sentence
    assert not sentence.startswith("ALARM")


def test_what_a_spreadsheet_saves_is_read(folder: Path) -> None:
    """A byte-order mark, other line ends and empty lines."""
    text = (folder / "answers.csv").read_text().replace("\n", "\r\n")
    lines = text.splitlines(keepends=True)
    text = "".join([*lines[:5], "\r\n", *lines[5:]])
    path = folder / "saved.csv"
    path.write_bytes(text.encode("utf-8-sig"))
    segments = read_segments(folder / "s.npz")
    assert read_answers(path, segments) == read_answers(
        folder / "answers.csv", segments
    )
    path.write_bytes(b"left,right,answer\n\xff,s1,left\n")
    with pytest.raises(TableError, match="line 1: 'utf-8' codec"):
        read_answers(path, segments)


def test_one_segment_that_is_much_longer_is_refused(tmp_path: Path) -> None:
    """It would be kept as long as that for every other."""
    lines = ["long,0"] * 60_000 + [f"s{n},0" for n in range(2000)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["segment,x", *lines]))
    with pytest.raises(TableError, match="longest segment has 60000 steps, 30 in"):
        read_segments(path)


def test_a_pickle_is_not_read(tmp_path: Path) -> None:
    """An object in an .npz could be anything."""
    np.savez(tmp_path / "a.npz", rows=np.array([{"x": 1}], dtype=object))
    with pytest.raises(TableError, match="allow_pickle"):
        read_segments(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("rows", "ids", "told"),
    [
        (np.zeros((2, 3, 1)), ("a", "a"), "segment 'a' is there twice"),
        (np.zeros((2, 3, 2)), ("a", "b"), r"rows must be \[2, T, 1\]"),
        (np.full((1, 3, 1), np.inf), ("a",), "missing or infinite"),
        (np.full((1, 3, 1), np.nan), ("a",), "has a step that is missing"),
        (np.array([[[1.0], [np.nan], [1.0]]]), ("a",), "has a step that is missing"),
    ],
)
def test_segments_that_are_none_cannot_be_made(
    rows: np.ndarray, ids: tuple[str, ...], told: str
) -> None:
    with pytest.raises(ValueError, match=told):
        Segments(ids, ("x",), rows)


def test_too_few_answers_are_refused(folder: Path) -> None:
    segments = read_segments(folder / "s.npz")
    answers = read_answers(folder / "answers.csv", segments)[:5]
    with pytest.raises(RewardError, match="5 of 5 answers prefer a segment"):
        fit_table(segments, answers, "linear", seed=0)


def test_what_would_fill_the_memory_is_refused() -> None:
    rows = np.zeros((2, 20_000, 100), dtype=np.float32)
    names = tuple(f"c{number}" for number in range(100))
    answers = [TableAnswer(left=0, right=1, target=1.0, rater="ada")] * 200
    with pytest.raises(RewardError, match=r"200 answers .* take 6 GB of memory, and 4"):
        fit_table(Segments(("a", "b"), names, rows), answers, "linear", seed=0)


def test_no_simulator_is_needed(folder: Path) -> None:
    """As on a machine that has torch alone."""
    program = (
        "import sys; sys.modules['mujoco'] = sys.modules['viser'] = None;"
        "from gaitpref.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", program, "fit", "--out", str(folder / "o")]
    tables = [
        "--segments",
        str(folder / "s.npz"),
        "--labels",
        str(folder / "answers.csv"),
    ]
    done = subprocess.run([*command, *tables], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
