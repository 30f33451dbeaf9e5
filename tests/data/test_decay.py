"""Crash and decay: whatever happens to the bytes is harmless or reported."""

import errno
import fcntl
import io
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.datasets.labels import labels
from data.datasets.recovery import recover, recover_file
from data.datasets.salvage import salvage
from data.datasets.verify import verify
from data.episodes.chunks import Compression
from data.episodes.clips import Clip
from data.episodes.episode import decode_episode
from data.episodes.writer import encode_episode
from data.errors import DatasetError, GaitprefError
from tests.data.test_dataset import META
from tests.data.test_episode import assert_same, make_episode

NOW = "2030-01-31T12:00:00Z"


def make_dataset(root: Path, num_steps: int = 3) -> Dataset:
    """Two episodes, three pairs, and four answers of two raters."""
    dataset = Dataset.create(root)
    episodes = [make_episode(num_steps, seed, meta=META) for seed in (0, 1)]
    first, second = (entry.sha256 for entry in dataset.add_episodes(episodes))
    with dataset.answers() as store:
        store.add_rater("ada", "human", {"since": 2030})
        store.add_rater("bob", "scripted")
        pairs = [
            Pair.make(Clip(first, i, 1), Clip(second, i, 1), strategy="u", round=i)
            for i in range(3)
        ]
        store.add_pairs(pairs)
        for number, (pair, rater, p_a) in enumerate(
            [
                (pairs[0], "ada", 0.75),
                (pairs[1], "ada", None),
                (pairs[1], "bob", 1.0),
                (pairs[2], "bob", None),
            ]
        ):
            answer = Answer(
                answer_id=f"answer-{number}",
                pair_id=pair.pair_id,
                rater_id=rater,
                choice="a",
                p_a=p_a,
                shown_left="b",
                response_ms=1000 + number,
                note="höher",
                created_utc=NOW,
            )
            store.add_answer(answer)
    return dataset


def everything(dataset: Dataset) -> list[object]:
    """All that readers give of a data set."""
    episodes = [encode_episode(dataset.read(e.sha256)) for e in dataset.entries()]
    windows = [
        Dataset.open(dataset.root).clip_features(Clip(e.sha256, 1, 2)).tobytes()
        for e in dataset.entries()
    ]
    with dataset.answers_copy() as store:
        return [
            dataset.entries(),
            episodes,
            windows,
            store.rater_rows(),
            labels(dataset),
        ]


def flipped(sound: bytes, rng: random.Random) -> bytes:
    """The bytes with one bit turned over."""
    damaged = bytearray(sound)
    damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return bytes(damaged)


def cut(sound: bytes, rng: random.Random) -> bytes:
    """The bytes up to any of them."""
    return sound[: rng.randrange(len(sound))]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damage", "count", "reported_at_least"),
    [(flipped, 1000, 701), (cut, 200, 141)],
    ids=["1000 flipped bits", "200 truncations"],
)
def test_damage_is_harmless_or_reported(
    damage: Callable[[bytes, random.Random], bytes],
    count: int,
    reported_at_least: int,
    tmp_path: Path,
) -> None:
    """Over every file of a data set: where `verify` is silent, nothing has changed.

    And readers, who look at less, give what was written or an error.
    """
    dataset = make_dataset(tmp_path / "set")
    expected = everything(dataset)
    files = [p for p in dataset.root.rglob("*") if p.is_file() and p.stat().st_size > 0]
    rng = random.Random(0)
    reported = 0
    for number in range(count):
        # Every file is hit, the large ones not only.
        path = files[number % len(files)]
        sound = path.read_bytes()
        path.write_bytes(damage(sound, rng))
        noticed = is_reported(dataset.root)
        reported += noticed
        try:
            same = everything(Dataset.open(dataset.root)) == expected
        except GaitprefError:
            assert noticed, f"readers fail on {path}, verify says nothing"
        else:
            assert same or noticed, f"{path} changed without a word"
        path.write_bytes(sound)
    assert reported >= reported_at_least
    assert not verify(dataset.root).damages


def is_reported(root: Path) -> bool:
    try:
        return bool(verify(root).damages)
    except GaitprefError:
        return True


def test_200_truncations_give_every_complete_chunk(tmp_path: Path) -> None:
    """Kept are exactly the steps whose chunk is whole, with metadata and robot."""
    episode = make_episode(300)
    content = encode_episode(episode)
    ends = chunk_ends(content)
    rng = random.Random(0)
    for _ in range(200):
        size = rng.randrange(len(content))
        saved = salvage(content[:size], "cut")
        whole = sum(end <= size for end in ends)
        kept = (0, 128, 256, 300)[whole]
        assert saved.kept_steps == kept, size
        if not kept:
            assert saved.problem
            continue
        assert saved.promised_steps == 300
        assert saved.lost_steps == 300 - kept
        (part,) = saved.episodes
        if kept == 300:
            assert encode_episode(part) == content
            continue
        assert part.features.tobytes() == episode.features[:kept].tobytes()
        assert part.qpos[:-1].tobytes() == episode.qpos[:kept].tobytes()
        assert np.isnan(part.qpos[-1]).all()
        assert part.mjcf == episode.mjcf
        assert part.end_reason == "aborted"
        assert part.meta.extra["recovered_from"] == "cut"
        assert replace(part.meta, extra=episode.meta.extra) == episode.meta
        assert_same(decode_episode(encode_episode(part), "x"), part)


def chunk_ends(content: bytes) -> list[int]:
    """The byte behind each chunk record, from the official reader's summary."""
    summary = make_reader(io.BytesIO(content)).get_summary()
    assert summary is not None
    return [c.chunk_start_offset + c.chunk_length for c in summary.chunk_indexes]


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_a_damaged_chunk_costs_only_itself(compression: Compression) -> None:
    """What lies before and behind it is saved as two parts."""
    episode = make_episode(300)
    content = bytearray(encode_episode(episode, compression=compression))
    content[chunk_ends(bytes(content))[1] - 50] ^= 1
    saved = salvage(bytes(content), "x")
    assert [part.num_steps for part in saved.episodes] == [128, 44]
    assert saved.lost_steps == 128
    second = saved.episodes[1]
    assert second.meta.extra["recovered_first_step"] == "256"
    assert second.features.tobytes() == episode.features[256:].tobytes()


def test_verify_names_episodes_and_answers(tmp_path: Path) -> None:
    """Changed and missing files and dangling answers, each with what they touch."""
    dataset = make_dataset(tmp_path / "set")
    first, second = dataset.entries()
    path = dataset.root / first.path
    content = bytearray(path.read_bytes())
    content[1000] ^= 1
    path.write_bytes(content)
    (dataset.root / second.path).unlink()
    found = {damage.kind: damage for damage in verify(dataset.root).damages}
    answers = tuple(f"answer-{number}" for number in range(4))
    assert set(found) == {"changed", "missing"}
    assert (found["changed"].episode, found["changed"].answers) == (
        first.sha256,
        answers,
    )
    assert found["missing"].episode == second.sha256
    dataset.unlist([second.sha256])
    found_again = verify(dataset.root)
    dangling = [d for d in found_again.damages if d.kind == "dangling"]
    assert {answer for d in dangling for answer in d.answers} == set(answers)
    assert {d.episode for d in dangling} == {second.sha256}


def test_recover_puts_a_data_set_in_order(tmp_path: Path) -> None:
    """A killed writer's file, a damaged file and a file no manifest knows."""
    dataset = Dataset.create(tmp_path / "set")
    episodes = [make_episode(300, seed, meta=META) for seed in range(3)]
    sound, hurt, unlisted = dataset.add_episodes(episodes)
    dataset.unlist([unlisted.sha256])
    path = dataset.root / hurt.path
    path.write_bytes(path.read_bytes()[:200_000])
    cut = encode_episode(make_episode(300, 9))[:150_000]
    (path.parent / ".9.mcap.0.tmp").write_bytes(cut)
    assert len(verify(dataset.root).left_over) == 2
    files = {f.kept_steps: f for f in recover(dataset.root)}
    assert {f.lost_steps for f in files.values()} == {0, 172}
    again = Dataset.open(dataset.root)
    assert {sound.sha256, unlisted.sha256} < {e.sha256 for e in again.entries()}
    assert sorted(e.num_steps for e in again.entries()) == [128, 128, 300, 300]
    assert verify(dataset.root).damages == ()
    assert verify(dataset.root).left_over == ()
    assert len(list((dataset.root / "damaged").iterdir())) == 2


def test_a_damaged_manifest_is_built_anew(tmp_path: Path) -> None:
    """Every file is found again, and answers about them stay valid."""
    dataset = make_dataset(tmp_path / "set")
    before = dataset.entries()
    manifest = dataset.root / "manifest.json"
    manifest.write_bytes(manifest.read_bytes()[:-40])
    assert [d.kind for d in verify(dataset.root).damages] == ["manifest"]
    recover(dataset.root)
    assert Dataset.open(dataset.root).entries() == before
    assert not verify(dataset.root).damages


def test_a_file_with_a_writer_is_left_alone(tmp_path: Path) -> None:
    """Recovery beside a recording takes nothing away from it."""
    dataset = make_dataset(tmp_path / "set")
    path = dataset.root / "rollouts" / ".x.mcap.0.tmp"
    with path.open("wb") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        assert recover(dataset.root) == []
    assert path.exists()


def as_child(work: Callable[[], None]) -> int:
    """Run `work` in a forked process; gives its exit code, 3 for a DatasetError."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            work()
            code = 0
        except DatasetError as error:
            code = 3 if "\n" not in str(error) else 4
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path: Path) -> None:
    """Files may not grow beyond 100 kB: adding fails, what was there is sound."""
    dataset = make_dataset(tmp_path / "set")
    before = verify(dataset.root)

    def work() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        Dataset.open(dataset.root).add_episodes([make_episode(300, meta=META)])

    assert as_child(work) == 3
    assert verify(dataset.root) == before


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become somebody else")
def test_a_read_only_directory_is_read_and_refuses_writes(tmp_path: Path) -> None:
    """Somebody without rights reads everything and gets one line when writing."""
    root = Path("/tmp") / f"gaitpref-read-only-{os.getpid()}"
    dataset = make_dataset(root)

    def read() -> None:
        os.setgid(65534)
        os.setuid(65534)
        everything(Dataset.open(root))
        assert not verify(root).damages

    def write() -> None:
        os.setgid(65534)
        os.setuid(65534)
        Dataset.open(root).add_episodes([make_episode(3, 7, meta=META)])

    try:
        assert as_child(read) == 0
        assert as_child(write) == 3
        assert not verify(dataset.root).damages
    finally:
        shutil.rmtree(root)


ANSWERER = """
import sys
from pathlib import Path
from data.answers.store import Answer, AnswerStore
path, worker = Path(sys.argv[1]), sys.argv[2]
with AnswerStore.open(path) as store:
    store.add_rater("ada", "human")
    pair = store.pairs()[0].pair_id
    number = 0
    while True:
        name = f"{worker}-{number}"
        store.add_answer(Answer(answer_id=name, pair_id=pair, rater_id="ada",
            choice="a", shown_left="a", created_utc="2030-01-31T12:00:00Z"))
        print(name, flush=True)
        number += 1
"""


@pytest.mark.slow
def test_four_processes_killed_20_times_lose_no_acknowledged_answer(
    tmp_path: Path,
) -> None:
    """Every id that was printed is in the store, and the store is sound."""
    dataset = make_dataset(tmp_path / "set")
    path = dataset.root / "preferences.sqlite"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    acknowledged: set[str] = set()
    for turn in range(20):
        workers = [
            subprocess.Popen(
                [sys.executable, "-c", ANSWERER, str(path), f"{turn}-{number}"],
                stdout=subprocess.PIPE,
                env=environment,
            )
            for number in range(4)
        ]
        for worker in workers:
            assert worker.stdout is not None
            acknowledged.add(worker.stdout.readline().decode().strip())
        for worker in workers:
            worker.kill()
        for worker in workers:
            output, _ = worker.communicate()
            # The last line may be cut off: it was not acknowledged.
            acknowledged |= set(output.decode().split("\n")[:-1])
    found = verify(dataset.root)
    assert found.damages == ()
    with dataset.answers() as store:
        stored = {answer.answer_id for _, answer in store.all_answers()}
    assert acknowledged <= stored
    assert len(acknowledged) >= 80


def test_two_writers_lose_nothing(tmp_path: Path) -> None:
    """Two objects on one directory, turn by turn: both see what the other added."""
    one = Dataset.create(tmp_path / "set")
    other = Dataset.open(one.root)
    for index in range(3):
        for dataset in (one, other):
            meta = replace(META, env_index=index, seed=int(dataset is other))
            dataset.add_episodes([make_episode(1, meta=meta)])
    assert len(one.entries()) == len(other.entries()) == 6


def test_a_single_file_is_saved_into_a_new_data_set(tmp_path: Path) -> None:
    """A log cut somewhere else, without a data set around it."""
    (tmp_path / "cut.mcap").write_bytes(encode_episode(make_episode(300))[:200_000])
    dataset = Dataset.create(tmp_path / "set")
    saved = recover_file(dataset, tmp_path / "cut.mcap")
    assert (saved.kept_steps, saved.lost_steps) == (128, 172)
    assert dataset.entries()[0].num_steps == 128


def test_errors_of_the_disk_that_say_something_else_stay_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only what making room or rights would mend is called not writable."""
    dataset = Dataset.create(tmp_path / "set")

    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("data.datasets.dataset.write_atomically", fail)
    with pytest.raises(OSError, match="Input/output error"):
        dataset.add_episodes([make_episode(1)])
