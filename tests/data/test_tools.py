"""`gaitpref data`: what each command does to data sets, and what it refuses."""

import json
import shutil
import stat
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from data.answers.answer_records import Answer
from data.datasets.archive import pack, unpack
from data.datasets.dataset import Dataset
from data.datasets.labels import LABEL_TYPES, labels
from data.datasets.manifest import encode_manifest
from data.datasets.transfer import part_of, split, transfer
from data.datasets.verify import verify
from data.errors import DatasetError, GaitprefError
from gaitpref.cli.main import main
from tests.data.test_dataset import META, STORED
from tests.data.test_decay import everything, make_dataset
from tests.data.test_episode import make_episode

NOW = "2030-01-31T12:00:00Z"


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return make_dataset(tmp_path / "set")


def say(capsys: pytest.CaptureFixture[str], *args: object) -> dict:
    """Run `gaitpref data ... --json`; gives what it printed."""
    assert main(["data", *map(str, args), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_info_counts(dataset: Dataset, capsys: pytest.CaptureFixture[str]) -> None:
    """2 episodes of 3 steps of 0.02 s; ada and bob gave two answers each."""
    seen = say(capsys, "info", "--dataset", dataset.root)
    assert (seen["episodes"], seen["steps"], seen["falls"]) == (2, 6, 0)
    assert seen["hours"] == pytest.approx(6 * 0.02 / 3600)
    assert seen["policies"] == {"c" * 64: 2}
    assert seen["commands"] == {"0.5, 0, 0": 2}
    counted = [(a["rater"], a["round"], a["answers"]) for a in seen["answers"]]
    assert counted == [("ada", 0, 1), ("ada", 1, 1), ("bob", 1, 1), ("bob", 2, 1)]
    assert main(["data", "info", "--dataset", str(dataset.root)]) == 0
    assert "ada" in capsys.readouterr().out


def test_verify_exits_1_and_lists(
    dataset: Dataset, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file, what is wrong, the episode and the answers, on one line."""
    assert main(["data", "verify", "--dataset", str(dataset.root)]) == 0
    entry = dataset.entries()[0]
    (dataset.root / entry.path).unlink()
    capsys.readouterr()
    assert main(["data", "verify", "--dataset", str(dataset.root)]) == 1
    line = capsys.readouterr().out.splitlines()[0]
    assert line.startswith(f"missing: {entry.path}: the file is gone")
    assert f"episode {entry.sha256}; answers answer-0, answer-1" in line


def test_recover_says_what_it_kept_and_lost(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a file that lies elsewhere, and of nothing that needs it."""
    (entry,) = dataset.add_episodes([make_episode(300, meta=META)])
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(dataset.content(entry)[:200_000])
    args = ["data", "recover", "--dataset", str(tmp_path / "new"), "--file", str(cut)]
    assert main(args) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0] == "cut.mcap: kept 128 steps, lost 172"
    found = say(capsys, "recover", "--dataset", dataset.root)
    assert found == {"files": [], "kept": 0, "lost": 0}


def test_merging_keeps_people_apart(dataset: Dataset, tmp_path: Path) -> None:
    """Two adas become two raters, one scripted bob stays one; twice changes nothing."""
    other = make_dataset(tmp_path / "other")
    with other.answers() as store:
        pair = store.pairs()[0].pair_id
        for rater in ("ada", "bob"):
            for target in (other, dataset):
                answer = Answer(
                    answer_id=f"{rater} in {target.root.name}",
                    pair_id=pair,
                    rater_id=rater,
                    choice="b",
                    shown_left="a",
                    created_utc=NOW,
                )
                with target.answers() as own:
                    own.add_answer(answer)
    fresh = Dataset.create(tmp_path / "fresh")
    first = transfer(dataset, fresh)
    assert (first.episodes, first.pairs, first.answers) == (2, 3, 6)
    second = transfer(other, fresh)
    # An answer both have shows that both adas are the same.
    assert (second.episodes, second.pairs, second.answers) == (0, 0, 2)
    assert second.renamed == {}

    stranger = Dataset.create(tmp_path / "stranger")
    entries = stranger.add_from(dataset, [e.sha256 for e in dataset.entries()])
    assert len(entries) == 2
    with stranger.answers() as store, dataset.answers_copy() as known:
        store.add_rater("ada", "human")
        store.add_rater("bob", "scripted")
        store.add_pairs(known.pairs())
        for rater in ("ada", "bob"):
            store.add_answer(replace(answer, answer_id=f"s-{rater}", rater_id=rater))
    for expected in (2, 0):
        third = transfer(stranger, fresh)
        assert third.answers == expected
        assert third.renamed == {"ada": "ada~2"}
    assert not verify(fresh.root).damages


def test_splitting_keeps_pairs_within_a_part(tmp_path: Path) -> None:
    """Shares are close to what was asked for, and no episode is in two parts."""
    hashes = [f"{number:064x}" for number in range(2000)]
    shares = {"train": 0.8, "test": 0.2}
    in_train = sum(part_of(sha, shares, 0) == "train" for sha in hashes)
    assert 1500 < in_train < 1700
    dataset = make_dataset(tmp_path / "set")
    seed = next(
        seed
        for seed in range(1000)
        if len({part_of(e.sha256, shares, seed) for e in dataset.entries()}) == 2
    )
    report = split(dataset, shares, tmp_path / "parts", seed=seed)
    assert [part.episodes for part in report.values()] == [1, 1]
    assert [part.left_out for part in report.values()] == [4, 4]
    with pytest.raises(DatasetError, match="is there already"):
        split(dataset, shares, tmp_path / "parts", seed=seed)
    with pytest.raises(DatasetError, match="make 1 together"):
        split(dataset, {"a": 0.5}, tmp_path / "x", seed=0)
    args = ["data", "split", "--dataset", str(dataset.root), "--part", "../a=1"]
    assert main([*args, "--out", str(tmp_path / "y")]) == 2


def test_a_subset_carries_its_answers(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of one rater, or none if no episode fits."""
    dataset.add_episodes([make_episode(3, 5, meta=replace(META, robot="other"))])
    out = tmp_path / "part"
    args = ["subset", "--dataset", dataset.root, "--out"]
    found = say(capsys, *args, out, "--rater", "bob")[str(out)]
    assert (found["episodes"], found["pairs"], found["answers"]) == (2, 2, 2)
    assert {row["rater"] for row in labels(Dataset.open(out))} == {"bob"}
    found = say(capsys, *args, tmp_path / "other", "--robot", "other")
    assert next(iter(found.values()))["answers"] == 0
    assert main(["data", *map(str, args), str(out), "--robot", "nobody's"]) == 2


def test_packing_and_unpacking_give_the_same(dataset: Dataset, tmp_path: Path) -> None:
    """Episodes, manifest, raters, pairs and answers; equal sets give equal archives."""
    (dataset.root / "README.md").write_text("card")
    size = pack(dataset, tmp_path / "a.zip")
    assert size == (tmp_path / "a.zip").stat().st_size
    again = unpack(tmp_path / "a.zip", tmp_path / "again")
    assert everything(again) == everything(dataset)
    assert (again.root / "README.md").read_text() == "card"
    pack(again, tmp_path / "b.zip")
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    with pytest.raises(DatasetError, match="is there already"):
        unpack(tmp_path / "a.zip", again.root)


def put(file: zipfile.ZipFile, name: str, **facts: object) -> None:
    info = zipfile.ZipInfo(name)
    for fact, value in facts.items():
        setattr(info, fact, value)
    file.writestr(info, b"x")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: put(f, "../evil"), r"may not hold '\.\./evil'"),
        (lambda f: put(f, "/etc/evil"), "may not hold '/etc/evil'"),
        (lambda f: put(f, "rollouts/../../x.mcap"), "may not hold"),
        (lambda f: put(f, "preferences.sqlite"), "may not hold 'preferences.sqlite'"),
        (
            lambda f: put(f, "README.md", external_attr=(stat.S_IFLNK | 0o777) << 16),
            "README.md is a link",
        ),
        (
            lambda f: put(f, "README.md", compress_type=zipfile.ZIP_DEFLATED),
            "is compressed",
        ),
        (lambda f: put(f, f"rollouts/ab/{'ab' * 32}.mcap"), "is not in the manifest"),
    ],
)
def test_foul_archives_are_refused(
    dataset: Dataset,
    tmp_path: Path,
    change: Callable[[zipfile.ZipFile], None],
    message: str,
) -> None:
    """Nothing of them is left on the disk."""
    archive = tmp_path / "a.zip"
    pack(dataset, archive)
    with zipfile.ZipFile(archive, "a") as file:
        change(file)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(DatasetError, match=message):
        unpack(archive, tmp_path / "new")
    assert sorted(tmp_path.rglob("*")) == before


def test_archives_that_lie_about_sizes_are_refused(
    dataset: Dataset, tmp_path: Path
) -> None:
    """A count of 4 GB, a flipped bit, half a file: one line each."""
    archive = tmp_path / "a.zip"
    pack(dataset, archive)
    sound = archive.read_bytes()
    central = sound.rindex(b"PK\x01\x02")
    huge = bytearray(sound)
    huge[central + 20 : central + 28] = b"\xfe\xff\xff\xff" * 2
    flipped = bytearray(sound)
    flipped[len(sound) // 2] ^= 1
    for content in (huge, flipped, sound[:-100], sound[:3000], b"", b"PK"):
        archive.write_bytes(content)
        with pytest.raises(GaitprefError):
            unpack(archive, tmp_path / "new")
        assert not (tmp_path / "new").exists()
    with pytest.raises(DatasetError, match="is missing"):
        unpack(tmp_path / "no.zip", tmp_path / "new")


def test_an_episode_that_is_not_what_its_name_says_is_refused(
    dataset: Dataset, tmp_path: Path
) -> None:
    """Even if the archive's own checksums are right."""
    entries = dataset.entries()
    with zipfile.ZipFile(tmp_path / "a.zip", "x") as file:
        file.writestr("manifest.json", encode_manifest(entries))
        file.writestr("answers.jsonl", "")
        for entry in entries:
            file.writestr(entry.path, dataset.content(entries[0]))
    with pytest.raises(DatasetError, match="is not what its name says"):
        unpack(tmp_path / "a.zip", tmp_path / "new")


def test_a_card_says_what_is_open(
    dataset: Dataset, capsys: pytest.CaptureFixture[str]
) -> None:
    """Licences are the publisher's to choose, so they are asked for until given."""
    args = ["data", "card", "--dataset", str(dataset.root)]
    assert main([*args, "--licence-rollouts", "CC-BY-4.0"]) == 0
    text = (dataset.root / "README.md").read_text()
    assert "| licence of the episodes | CC-BY-4.0 |" in text
    assert "| licence of the answers | TO BE FILLED IN BY THE PUBLISHER |" in text
    assert "| episodes | 2 |" in text
    said = " ".join(capsys.readouterr().err.split())
    assert "before you publish: title, author, licence answers" in said
    assert "licence rollouts" not in said


def test_labels_in_every_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Corrections are told from both ends; the same rows in JSON lines and CSV."""
    root = tmp_path / "old"
    shutil.copytree(STORED / "dataset_v1", root)
    assert main(["data", "labels", "--dataset", str(root)]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["answer_id"] for row in rows] == ["a1", "a2", "a3", "b1"]
    assert list(rows[0]) == list(LABEL_TYPES)
    assert (rows[1]["superseded_by"], rows[2]["supersedes"]) == ("a3", "a2")
    assert [row["target"] for row in rows] == [0.75, None, 0.0, 0.5]
    out = tmp_path / "x.csv"
    args = ["data", "labels", "--dataset", str(root), "--format", "csv"]
    assert main([*args, "--out", str(out)]) == 0
    assert out.read_text().splitlines()[0] == ",".join(LABEL_TYPES)
    pq = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "x.parquet"
    args = ["data", "labels", "--dataset", str(root), "--format", "parquet"]
    assert main(args) == 2
    assert main([*args, "--out", str(out)]) == 0
    assert pq.read_table(out).to_pylist() == rows


def test_reading_an_old_store_leaves_its_file_as_it_is(tmp_path: Path) -> None:
    """Only opening it for answers brings it up to date."""
    root = tmp_path / "old"
    shutil.copytree(STORED / "dataset_v1", root)
    before = (root / "preferences.sqlite").read_bytes()
    dataset = Dataset.open(root)
    assert verify(root).answers == 4
    assert len(labels(dataset)) == 4
    assert (root / "preferences.sqlite").read_bytes() == before
    with dataset.answers() as store:
        assert store.count() == 3
    assert not verify(root).damages


def test_unknown_directories_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every command that reads says that there is no data set."""
    for command in ("info", "verify", "card", "labels"):
        assert main(["data", command, "--dataset", str(tmp_path)]) == 2
        assert "is no data set" in capsys.readouterr().err


def test_answers_in_postgresql_are_those_of_the_data_set(
    dataset: Dataset,
    postgres_answers: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Merged in, listed, counted, verified, packed: as from the file."""
    served = tmp_path / "served"
    answers = ["--answers", postgres_answers]
    merge = ["merge", "--dataset", served, *answers, "--source", dataset.root]
    (report,) = say(capsys, *merge).values()
    assert (report["episodes"], report["answers"]) == (2, 4)
    assert not (served / "preferences.sqlite").exists()
    expected = labels(dataset)
    assert labels(Dataset.open(served, answers=postgres_answers)) == expected
    assert main(["data", "labels", "--dataset", str(served), *answers]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [json.loads(line) for line in lines] == expected
    assert say(capsys, "info", "--dataset", served, *answers) == say(
        capsys, "info", "--dataset", dataset.root
    )
    assert say(capsys, "verify", "--dataset", served, *answers)["answers"] == 4
    archives = [tmp_path / "file.zip", tmp_path / "served.zip"]
    say(capsys, "pack", "--dataset", dataset.root, "--out", archives[0])
    say(capsys, "pack", "--dataset", served, *answers, "--out", archives[1])
    assert archives[0].read_bytes() == archives[1].read_bytes()
