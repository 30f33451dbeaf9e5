"""Data sets behind a URL: sent once, whole or not there, merged, and told in words."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from data.answers.address import Address
from data.answers.answer_records import Answer, Pair
from data.answers.lines import to_lines
from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from data.datasets.verify import verify
from data.episodes.clips import Clip
from data.errors import RemoteError
from data.files.files import sha256_bytes
from data.remote.place import Place
from data.remote.sharing import pull, push
from gaitpref.cli.main import main
from tests.data.test_dataset import META
from tests.data.test_decay import make_dataset
from tests.data.test_episode import make_episode
from tests.helpers import postgres, s3
from tests.helpers.required import needed

NOW = "2030-01-31T12:00:00Z"
MANY = 150
"""Episodes, so that a kill falls in between."""
Environment = Mapping[str, str]

needed("fsspec", "FSSPEC")


@pytest.fixture(scope="module")
def store() -> Iterator[Environment]:
    """An S3 server, and what is needed to reach it."""
    with s3.server() as environment:
        yield environment


@pytest.fixture
def bucket(store: Environment) -> str:
    """The URL of a directory in a new bucket."""
    name = f"tests-{time.monotonic_ns()}"
    s3.make_bucket(store, name)
    return f"s3://{name}/labs/ours"


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A data set of many small episodes, with three answers."""
    dataset = make_dataset(tmp_path_factory.mktemp("many") / "set")
    dataset.add_episodes(make_episode(3, seed, meta=META) for seed in range(2, MANY))
    return dataset


def share(
    what: str, root: Path, url: str, environment: Environment
) -> subprocess.Popen[str]:
    """`gaitpref data push` or `pull` in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "gaitpref", "data", what, str(root), url, "--json"],
        env=os.environ | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def shared(what: str, root: Path, url: str, environment: Environment) -> dict:
    """What the command said, run to its end."""
    out, err = (process := share(what, root, url, environment)).communicate()
    assert process.returncode == 0, err
    return json.loads(out)


def killed(process: subprocess.Popen[str], done: Callable[[], int]) -> None:
    """Kill the command once some files, and not all, are done."""
    deadline = time.monotonic() + 60
    while done() < 5:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()


def objects(environment: Environment, url: str) -> dict[str, str]:
    """Address of everything in the bucket of `url` by its name there."""
    bucket, _, start = url.removeprefix("s3://").partition("/")
    base = f"{environment['AWS_ENDPOINT_URL']}/{bucket}"
    found = ElementTree.fromstring(s3.get(f"{base}?list-type=2&max-keys=1000"))
    keys = [key.text or "" for key in found.iterfind(".//{*}Key")]
    return {key.removeprefix(f"{start}/"): f"{base}/{key}" for key in keys}


def require_whole(environment: Environment, url: str) -> int:
    """Everything is what its name says; gives how many episodes there are."""
    found = objects(environment, url)
    for name, address in found.items():
        content = s3.get(address)
        assert sha256_bytes(content) == Path(name).name.partition(".")[0]
    return sum(name.startswith("rollouts/") for name in found)


def everything(dataset: Dataset) -> tuple[object, list[str]]:
    """All that a data set holds; its files are whole."""
    assert not verify(dataset.root).damages
    with dataset.answers_copy() as store:
        return dataset.entries(), list(to_lines(store))


def answered(dataset: Dataset, answer_id: str, rater: str, **changes: str) -> None:
    """One more answer of a person, to the first pair where no other is named."""
    with dataset.answers() as store:
        store.add_rater(rater, "human")
        values = {
            "pair_id": store.pairs()[0].pair_id,
            "choice": "a",
            "shown_left": "a",
            "created_utc": NOW,
        } | changes
        store.add_answer(
            Answer(
                answer_id=answer_id,
                rater_id=rater,
                **values,  # type: ignore[arg-type]
            )
        )


@pytest.mark.parametrize("kind", ["directory", "memory"])
def test_what_was_pushed_comes_back(tmp_path: Path, kind: str) -> None:
    """Everything, once; a store that shows files while they arrive gets them aside."""
    dataset = make_dataset(tmp_path / "set")
    url = str(tmp_path / "disk" / "new") if kind == "directory" else "memory://here/new"
    place, told = Place(url), []
    found = push(dataset, place, tell=lambda *counts: told.append(counts))
    assert (found.episodes, found.files, found.pairs, found.answers) == (2, 2, 3, 4)
    assert told == [(0, 2), (1, 2), (2, 2)]
    again = push(dataset, place)
    assert (again.episodes, again.files, again.pairs, again.answers) == (0, 0, 0, 0)
    assert not place.sizes("partial")
    taken = pull(place, tmp_path / "copy")
    assert (taken.episodes, taken.files, taken.answers) == (2, 2, 4)
    assert everything(Dataset.open(tmp_path / "copy")) == everything(dataset)
    assert pull(place, tmp_path / "copy").files == 0


def test_a_killed_push_and_a_killed_pull_go_on(
    tmp_path: Path, many: Dataset, store: Environment, bucket: str
) -> None:
    """On a real S3 server: what is there is whole at any time and not sent twice, and
    nobody sees a data set before it is one."""

    def sent() -> int:
        return sum(name.startswith("rollouts/") for name in objects(store, bucket))

    killed(share("push", many.root, bucket, store), sent)
    before = require_whole(store, bucket)
    assert 5 <= before < MANY
    refused = share("pull", tmp_path / "early", bucket, store)
    assert "holds no data set" in refused.communicate()[1]
    assert not (tmp_path / "early").exists()
    assert shared("push", many.root, bucket, store)["files"] == MANY - before
    assert require_whole(store, bucket) == MANY

    copy = tmp_path / "copy"
    files = copy / "rollouts"
    killed(
        share("pull", copy, bucket, store), lambda: len(list(files.glob("*/*.mcap")))
    )
    here = list(files.glob("*/*.mcap"))
    assert all(sha256_bytes(path.read_bytes()) == path.stem for path in here)
    taken = shared("pull", copy, bucket, store)
    assert (taken["episodes"], taken["files"]) == (MANY, MANY - len(here))
    assert everything(Dataset.open(copy)) == everything(many)


def test_of_two_who_push_at_once_nothing_is_lost(
    tmp_path: Path, store: Environment, bucket: str
) -> None:
    """Answers of both come back, also of two people of one name; the next push takes
    the lists together."""
    ours, theirs = make_dataset(tmp_path / "ours"), make_dataset(tmp_path / "theirs")
    theirs.add_episodes([make_episode(3, 7, meta=META)])
    answered(ours, "of our eve", "eve")
    answered(theirs, "of their eve", "eve", choice="b")
    both = [share("push", data.root, bucket, store) for data in (ours, theirs)]
    for process in both:
        _, err = process.communicate()
        assert process.returncode == 0, err
    copy = Dataset.create(tmp_path / "copy")
    assert shared("pull", copy.root, bucket, store)["episodes"] == 3
    with copy.answers_copy() as answers:
        found = {a.answer_id: a.rater_id for _, a in answers.all_answers()}
    assert found.keys() == {f"answer-{n}" for n in range(4)} | {
        "of our eve",
        "of their eve",
    }
    assert {found["of our eve"], found["of their eve"]} == {"eve", "eve~2"}
    shared("push", copy.root, bucket, store)
    names = sorted(name.partition("/")[0] for name in objects(store, bucket))
    assert names == ["answers", "manifests", *["rollouts"] * 3]


@pytest.mark.parametrize("before", ["answers", "manifests"])
def test_what_another_pushes_while_the_list_is_read_is_kept(
    tmp_path: Path, before: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between one folder and the next, whichever is looked at first."""
    place = Place(str(tmp_path / "there"))
    ours, theirs = make_dataset(tmp_path / "ours"), make_dataset(tmp_path / "theirs")
    push(ours, place)
    (new,) = theirs.add_episodes([make_episode(3, 7, meta=META)])
    pair = Pair.make(
        Clip(new.sha256, 0, 2), Clip(new.sha256, 2, 2), strategy="x", round=0
    )
    with theirs.answers() as store:
        store.add_pairs([pair])
    answered(theirs, "theirs", "eve", pair_id=pair.pair_id)
    answered(ours, "ours", "eve")
    sizes, pushed = Place.sizes, []

    def slow(self: Place, folder: str) -> dict[str, int]:
        if folder == before and not pushed:
            pushed.append(True)
            push(theirs, Place(str(tmp_path / "there")))
        return sizes(self, folder)

    monkeypatch.setattr(Place, "sizes", slow)
    push(ours, place)
    assert pushed
    pull(place, tmp_path / "copy")
    with Dataset.open(tmp_path / "copy").answers_copy() as store:
        found = {answer.answer_id for _, answer in store.all_answers()}
    assert {"ours", "theirs"} <= found


def test_answers_on_a_server_are_pushed_and_pulled(
    tmp_path: Path, postgres_server: str
) -> None:
    """From one host's database to another's, by `--answers`; the files beside the
    episodes stay empty."""
    ours, theirs = (postgres.new_schema(postgres_server) for _ in range(2))
    dataset = make_dataset(tmp_path / "set")
    here, there, copy = (str(tmp_path / name) for name in ("here", "there", "copy"))
    merged = ["--dataset", here, "--answers", ours, "--source", str(dataset.root)]
    assert main(["data", "merge", *merged]) == 0
    assert main(["data", "push", here, there, "--answers", ours]) == 0
    assert main(["data", "pull", copy, there, "--answers", theirs]) == 0
    told = to_lines_at(dataset.root / "preferences.sqlite")
    assert len(told) > 4
    assert to_lines_at(theirs) == told
    assert to_lines_at(Path(copy) / "preferences.sqlite") == []


def to_lines_at(address: Address) -> list[str]:
    """All that is said in a store."""
    with AnswerStore.snapshot(address) as store:
        return list(to_lines(store))


def test_corrections_travel(tmp_path: Path) -> None:
    """An answer that is corrected at one end is corrected at the other."""
    place = Place(str(tmp_path / "there"))
    ours = make_dataset(tmp_path / "ours")
    answered(ours, "first", "eve")
    push(ours, place)
    pull(place, tmp_path / "theirs")
    theirs = Dataset.open(tmp_path / "theirs")
    answered(theirs, "second", "eve", choice="b", supersedes="first")
    assert push(theirs, place).answers == 1
    assert pull(place, ours.root).answers == 1
    with ours.answers_copy() as answers:
        current = {a.answer_id: a.choice for _, a in answers.current_answers()}
    assert "first" not in current
    assert current["second"] == "b"


def test_what_is_damaged_there_does_not_get_here(tmp_path: Path) -> None:
    """Named by file, and nothing of it is written; whoever has it whole sends it."""
    place = Place(str(tmp_path / "there"))
    dataset = make_dataset(tmp_path / "set")
    push(dataset, place)
    entry = dataset.entries()[0]
    path = tmp_path / "there" / entry.path
    path.write_bytes(bytes(entry.bytes))
    with pytest.raises(RemoteError, match=f"{entry.sha256}.* not what its name says"):
        pull(place, tmp_path / "copy")
    copy = Dataset.open(tmp_path / "copy")
    assert not copy.has_stored(entry)
    assert copy.entries() == ()
    path.unlink()
    assert push(dataset, place).files == 1
    pull(place, copy.root)
    assert everything(copy) == everything(dataset)
    (answers,) = (tmp_path / "there" / "answers").iterdir()
    answers.write_bytes(b"no answers")
    with pytest.raises(RemoteError, match="not what its name says"):
        push(dataset, place)


def test_files_about_which_nobody_knows_do_no_harm(tmp_path: Path) -> None:
    """Such as what a push that was killed has left aside, and an answer about an
    episode that is not shared."""
    place = Place(str(tmp_path / "there"))
    dataset = make_dataset(tmp_path / "set")
    with dataset.answers() as store:
        clips = Clip("ab" * 32, 0, 1), Clip("cd" * 32, 0, 1)
        pair = Pair.make(*clips, strategy="u", round=0)
        store.add_pairs([pair])
        store.add_answer(
            Answer(
                answer_id="gone",
                pair_id=pair.pair_id,
                rater_id="ada",
                choice="a",
                shown_left="a",
                created_utc=NOW,
            )
        )
    assert push(dataset, place).left_out == 1
    (tmp_path / "there" / "partial").mkdir()
    (tmp_path / "there" / "partial" / "0123").write_bytes(b"half")
    assert pull(place, tmp_path / "copy").answers == 4


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("xyz://bucket/path", "no URL of a store"),
        ("gs://bucket/path", "pip install gcsfs"),
        ("/proc/here", "cannot be"),
    ],
)
def test_an_impossible_place_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], url: str, expected: str
) -> None:
    """A scheme nobody knows, a package that is missing, a disk that takes nothing."""
    if url.startswith("gs:") and importlib.util.find_spec("gcsfs"):
        pytest.skip("gcsfs is installed")
    dataset = make_dataset(tmp_path / "set")
    assert main(["data", "push", str(dataset.root), url]) == 2
    told = capsys.readouterr().err.strip()
    assert expected in " ".join(told.split())
    assert "Traceback" not in told


def test_no_bucket_no_rights_and_no_server_are_told_in_one_line(
    tmp_path: Path, store: Environment, bucket: str
) -> None:
    """By S3's own words, and what to do."""
    dataset = make_dataset(tmp_path / "set")

    def told(url: str, environment: Environment) -> str:
        process = share("push", dataset.root, url, environment)
        _, err = process.communicate()
        assert process.returncode == 2
        assert "Traceback" not in err
        return " ".join(err.split())

    assert "make the bucket first" in told("s3://nobody-made-this/x", store)
    nobody = {name: "" for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY")}
    assert "you have no rights there" in told(bucket, {**store, **nobody})
    closed = {"AWS_ENDPOINT_URL": "http://127.0.0.1:9", "AWS_MAX_ATTEMPTS": "1"}
    assert "see to the connection" in told(bucket, {**store, **closed})
    # As soon as it has to know who asks, it knows nobody.
    with s3.server(INITIAL_NO_AUTH_ACTION_COUNT="0") as strict:
        assert "you have no rights there" in told("s3://bucket/x", strict)


def test_a_password_in_a_url_is_not_told() -> None:
    """Not even where the place cannot be reached."""
    with pytest.raises(RemoteError) as caught:
        Place("nothing://eve:secret@example.org/path")
    assert "secret" not in str(caught.value)


def test_a_folder_that_comes_to_be_while_it_is_listed_is_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """s3fs lists the folder itself where its first file arrives in between."""
    found = {f"{tmp_path}/manifests": {"size": 0, "type": "directory"}}
    local = needed("fsspec.implementations.local", "FSSPEC").LocalFileSystem
    monkeypatch.setattr(local, "find", lambda self, path, detail: found)
    assert Place(f"file://{tmp_path}").sizes("manifests") == {}
