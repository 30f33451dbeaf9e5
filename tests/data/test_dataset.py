"""Data sets: directories that two processes may fill and a stranger may damage."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data.datasets.dataset import Dataset
from data.datasets.manifest import encode_manifest
from data.datasets.manifest_lookup import look_up
from data.episodes.chunks import Compression
from data.episodes.clips import Clip
from data.episodes.episode import Episode, EpisodeMeta
from data.errors import CorruptEpisode, DatasetError
from data.features import FEATURE_DIM
from data.files.files import replace_directory, sha256_file, write_atomically

META = EpisodeMeta(
    task="velocity",
    seed=0,
    env_index=0,
    command=(0.5, 0.0, 0.0),
    policy_sha256="c" * 64,
    policy_step=0,
    stochastic=False,
    control_dt_s=0.02,
    physics_dt_s=0.004,
    robot="go1_like",
    model_sha256="d" * 64,
)


def make_episode(env_index: int, num_steps: int = 3) -> Episode:
    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape, dtype=np.float32)

    return Episode(
        qpos=np.zeros((num_steps + 1, 19)),
        qvel=np.zeros((num_steps + 1, 18)),
        obs=zeros(num_steps + 1, 48),
        action=zeros(num_steps, 12),
        ctrl=zeros(num_steps, 12),
        features=np.full((num_steps, FEATURE_DIM), env_index, dtype=np.float32),
        reward=zeros(num_steps),
        end_reason="truncated",
        meta=replace(META, env_index=env_index),
        mjcf="<mujoco/>",
    )


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return Dataset.create(tmp_path / "set")


def test_added_episodes_are_found_again(dataset: Dataset) -> None:
    """By a new reader, sorted by hash, with all their facts and rows."""
    added = dataset.add_episodes(make_episode(index) for index in range(4))
    assert [entry.meta.env_index for entry in added] == [0, 1, 2, 3]
    again = Dataset.open(dataset.root)
    assert again.entries() == tuple(sorted(added, key=lambda entry: entry.sha256))
    for index, entry in enumerate(added):
        assert again.entry(entry.sha256) == entry
        assert sha256_file(again.root / entry.path) == entry.sha256
        assert again.read(entry.sha256).meta == entry.meta
        assert (again.features(entry.sha256) == index).all()
        assert again.features(entry.sha256) is again.features(entry.sha256)


def test_adding_twice_changes_nothing(dataset: Dataset) -> None:
    """Neither the manifest nor the files are written again."""
    first = dataset.add_episodes([make_episode(0), make_episode(0)])
    assert first[0] == first[1]
    files = dataset.root / "manifest.json", dataset.root / first[0].path
    before = [(file.stat().st_ino, file.stat().st_mtime_ns) for file in files]
    assert dataset.add_episodes([make_episode(0)]) == first[:1]
    after = [(file.stat().st_ino, file.stat().st_mtime_ns) for file in files]
    assert after == before
    assert len(dataset.entries()) == 1
    assert Dataset.create(dataset.root).entries() == dataset.entries()


def test_the_order_of_adding_leaves_no_trace(dataset: Dataset, tmp_path: Path) -> None:
    """The same episodes give the same manifest, byte for byte."""
    other = Dataset.create(tmp_path / "other")
    dataset.add_episodes([make_episode(0), make_episode(1)])
    other.add_episodes([make_episode(1)])
    other.add_episodes([make_episode(0)])
    manifests = [(d.root / "manifest.json").read_bytes() for d in (dataset, other)]
    assert manifests[0] == manifests[1]


ADDER = """
import sys
from pathlib import Path
from tests.data.test_dataset import make_episode
from data.datasets.dataset import Dataset
dataset = Dataset.open(Path(sys.argv[1]))
print("ready", flush=True)
sys.stdin.readline()
for index in range(*map(int, sys.argv[2:])):
    dataset.add_episodes([make_episode(index)])
"""


def test_two_processes_adding_at_once_lose_nothing(dataset: Dataset) -> None:
    """Each adds 15 episodes one by one, 5 of them the same; 25 are there."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", ADDER, str(dataset.root), *bounds],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for bounds in (("0", "15"), ("10", "25"))
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        process.communicate("go\n", timeout=60)
        assert process.returncode == 0
    found = sorted(entry.meta.env_index for entry in dataset.entries())
    assert found == list(range(25))
    files = sorted(path.name for path in dataset.root.rglob("*.*") if path.is_file())
    assert len(files) == 25 + 2, files


def test_what_is_no_data_set_says_how_to_make_one(tmp_path: Path) -> None:
    """The message is the command to run."""
    expected = f"gaitpref record --policy POLICY --dataset {tmp_path}"
    with pytest.raises(DatasetError, match=expected):
        Dataset.open(tmp_path)


def test_an_unknown_episode_is_named(dataset: Dataset) -> None:
    """So are clips that reach beyond their episode."""
    with pytest.raises(DatasetError, match="has no episode 'ffff' among its 0"):
        dataset.entry("ffff")
    (entry,) = dataset.add_episodes([make_episode(0)])
    assert dataset.clip_features(Clip(entry.sha256, 1, 2)).shape == (2, FEATURE_DIM)
    with pytest.raises(DatasetError, match="ends at step 4, its episode has 3"):
        dataset.clip_features(Clip(entry.sha256, 1, 3))


STORED = Path(__file__).parents[1] / "stored"


def test_a_data_set_of_version_1_is_read_and_added_to(tmp_path: Path) -> None:
    """Its manifest is brought up to date by the first addition, its files stay."""
    shutil.copytree(STORED / "dataset_v1", tmp_path / "old")
    dataset = Dataset.open(tmp_path / "old")
    old = dataset.entries()
    assert [entry.num_steps for entry in old] == [5, 5]
    for entry in old:
        assert dataset.read(entry.sha256).num_steps == 5
        rows = dataset.clip_features(Clip(entry.sha256, 1, 2))
        assert (rows == entry.meta.env_index).all()
    (new,) = dataset.add_episodes([make_episode(2)])
    again = Dataset.open(dataset.root)
    assert set(again.entries()) == {*old, new}
    assert again.entry(old[0].sha256) == old[0]
    assert again.clip_features(Clip(old[1].sha256, 0, 5)).shape == (5, FEATURE_DIM)


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_windows_are_read_alone(dataset: Dataset, compression: Compression) -> None:
    """Within a chunk and across chunks, the rows are those of the whole episode."""
    episode = replace(
        make_episode(0, 300),
        features=np.arange(300 * FEATURE_DIM, dtype=np.float32).reshape(300, -1),
    )
    (entry,) = dataset.add_episodes([episode], compression=compression)
    for start, steps in ((0, 1), (0, 128), (100, 100), (127, 2), (10, 290), (299, 1)):
        clip = Clip(entry.sha256, start, steps)
        for _ in range(2):
            rows = dataset.clip_features(clip)
            np.testing.assert_array_equal(rows, episode.features[clip.rows])
        dataset = Dataset.open(dataset.root)


def test_many_clips_come_episode_by_episode(dataset: Dataset) -> None:
    """Each with its place in the list asked for."""
    first, second = (e.sha256 for e in dataset.add_episodes(map(make_episode, (1, 2))))
    clips = [Clip(sha, start, 1) for start in (0, 1) for sha in (first, second)]
    found = list(dataset.each_clip_features(clips))
    assert sorted(position for position, _ in found) == [0, 1, 2, 3]
    hashes = [clips[position].rollout for position, _ in found]
    assert hashes in ([first] * 2 + [second] * 2, [second] * 2 + [first] * 2)
    for position, rows in found:
        assert (rows == (1 if clips[position].rollout == first else 2)).all()


def test_a_large_manifest_is_searched(dataset: Dataset) -> None:
    """Every entry is found by bisection, however long its line, and no other."""
    (entry,) = dataset.add_episodes([make_episode(0)])
    entries = {
        sha: replace(
            entry,
            sha256=sha,
            path=f"rollouts/{sha[:2]}/{sha}.mcap",
            meta=replace(META, extra={"note": "x" * (number**3 % 20_000)}),
        )
        for number, sha in enumerate(
            hashlib.sha256(bytes([n])).hexdigest() for n in range(200)
        )
    }
    path = dataset.root / "manifest.json"
    path.write_bytes(encode_manifest(entries.values()))
    for sha, expected in entries.items():
        assert look_up(path, sha) == expected
    for absent in ("0" * 64, "f" * 64, entry.sha256):
        assert look_up(path, absent) is None


def test_a_replaced_file_is_noticed(dataset: Dataset) -> None:
    """Even when it is a sound episode, only another one than promised."""
    first, second = dataset.add_episodes([make_episode(0), make_episode(1)])
    (dataset.root / first.path).write_bytes((dataset.root / second.path).read_bytes())
    for read in (dataset.read, dataset.features):
        with pytest.raises(
            CorruptEpisode, match=f"the manifest promises {first.sha256}"
        ):
            read(first.sha256)
    with pytest.raises(CorruptEpisode, match="is not the file the manifest promises"):
        dataset.clip_features(Clip(first.sha256, 0, 1))
    (dataset.root / first.path).unlink()
    with pytest.raises(CorruptEpisode, match="is missing"):
        dataset.read(first.sha256)


def test_adding_again_mends_a_truncated_file(dataset: Dataset) -> None:
    """A file of another length than its name promises is written anew."""
    (entry,) = dataset.add_episodes([make_episode(0)])
    (dataset.root / entry.path).write_bytes(b"")
    dataset.add_episodes([make_episode(0)])
    assert dataset.read(entry.sha256).num_steps == 3


@pytest.mark.parametrize("path", ["/etc/passwd", "../secret.mcap", "rollouts/x.mcap"])
def test_paths_that_lead_elsewhere_are_refused(dataset: Dataset, path: str) -> None:
    """A manifest from a stranger cannot make anybody read another file."""
    dataset.add_episodes([make_episode(0)])
    manifest = dataset.root / "manifest.json"
    content = json.loads(manifest.read_text())
    content["files"][0]["path"] = path
    manifest.write_text(json.dumps(content))
    with pytest.raises(DatasetError, match=f"lists the file '{path}'"):
        dataset.entries()


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_links_are_refused(dataset: Dataset, tmp_path: Path, depth: int) -> None:
    """Neither the file nor a directory above it may be a link."""
    (entry,) = dataset.add_episodes([make_episode(0)])
    path = [dataset.root / entry.path, *(dataset.root / entry.path).parents][depth]
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DatasetError, match="is a link"):
        dataset.read(entry.sha256)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.update(format_version=3), "has format_version 3, this version"),
        (
            lambda m: m.update(features_sha256="e"),
            "has features_sha256 e, this version",
        ),
        (lambda m: m.pop("files"), "is damaged"),
        (lambda m: m["files"][0].update(sha256="X"), "is damaged"),
        (lambda m: m["files"][0]["meta"].update(seed='"x"'), "seed should be int"),
        (lambda m: m["files"][0].update(end_reason="bored"), "end_reason 'bored'"),
    ],
)
def test_unusable_manifests_are_refused(
    dataset: Dataset, change: object, message: str
) -> None:
    """Newer versions and damage are one DatasetError that says which."""
    dataset.add_episodes([make_episode(0)])
    manifest = dataset.root / "manifest.json"
    content = json.loads(manifest.read_text())
    assert callable(change)
    change(content)
    manifest.write_text(json.dumps(content))
    with pytest.raises(DatasetError, match=message):
        Dataset.open(dataset.root).entries()


def test_the_feature_cache_stays_small(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With room for two episodes, the third pushes out the one not used for longest."""
    monkeypatch.setattr(
        "data.datasets.feature_cache.FEATURE_CACHE_BYTES", 2 * 3 * FEATURE_DIM * 4
    )
    first, second, third = (
        entry.sha256 for entry in dataset.add_episodes(map(make_episode, range(3)))
    )
    kept, dropped = dataset.features(first), dataset.features(second)
    dataset.features(first)
    dataset.features(third)
    assert dataset.features(first) is kept
    assert dataset.features(second) is not dropped


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    """Neither half a file nor a temporary one."""
    path = tmp_path / "f"
    write_atomically(path, b"old")
    with pytest.raises(TypeError):
        write_atomically(path, "text")  # type: ignore[arg-type]
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_finished_directory_replaces_the_old_one(tmp_path: Path) -> None:
    """What was there before is gone, nothing lies about."""
    for text in ("first", "second"):
        (tmp_path / "partial" / "deep").mkdir(parents=True)
        (tmp_path / "partial" / "deep" / "f").write_text(text)
        replace_directory(tmp_path / "partial", tmp_path / "final")
        assert (tmp_path / "final" / "deep" / "f").read_text() == text
    assert list(tmp_path.iterdir()) == [tmp_path / "final"]
