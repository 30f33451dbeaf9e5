"""The store of answers: nothing acknowledged is lost, nothing is ever changed."""

import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data.answers import Answer, AnswerStore, Choice, Pair
from data.clips import Clip
from data.errors import AnswerError

NOW = "2030-01-31T12:00:00Z"
LATER = "2030-01-31T12:05:00Z"


def make_pair(number: int, round: int = 0) -> Pair:
    a, b = Clip("aa", number, 50), Clip("bb", number, 30)
    return Pair.make(a, b, strategy="random", round=round, info={"score": 0.5})


def make_answer(answer_id: str, pair: Pair, **changes: object) -> Answer:
    values: dict[str, object] = {
        "answer_id": answer_id,
        "pair_id": pair.pair_id,
        "rater_id": "ada",
        "choice": "a",
        "shown_left": "b",
        "created_utc": NOW,
    }
    return Answer(**(values | changes))  # type: ignore[arg-type]


@pytest.fixture
def store(tmp_path: Path) -> Iterator[AnswerStore]:
    """A store with two raters and three pairs."""
    with AnswerStore.open(tmp_path / "preferences.sqlite") as store:
        store.add_rater("ada", "human", {"since": 2030})
        store.add_rater("bob", "scripted")
        store.add_pairs([make_pair(0), make_pair(1), make_pair(2, round=1)])
        yield store


@pytest.mark.parametrize(
    ("choice", "p_a", "target"),
    [
        ("a", None, 1.0),
        ("b", None, 0.0),
        ("equal", None, 0.5),
        ("skip", None, None),
        ("bad", None, None),
        ("a", 0.75, 0.75),
        ("b", 0.25, 0.25),
        ("equal", 0.5, 0.5),
    ],
)
def test_targets_worked_out_by_hand(
    choice: Choice, p_a: float | None, target: float | None
) -> None:
    """The target is the probability that a is better, whichever side it was shown."""
    for shown_left in ("a", "b"):
        answer = make_answer(
            "1", make_pair(0), choice=choice, p_a=p_a, shown_left=shown_left
        )
        assert answer.target == target


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"choice": "a", "p_a": 0.25}, "choice 'a' contradicts p_a 0.25"),
        ({"choice": "b", "p_a": 0.75}, "choice 'b' contradicts p_a 0.75"),
        ({"choice": "equal", "p_a": 0.6}, "choice 'equal' contradicts"),
        ({"choice": "skip", "p_a": 0.5}, "choice 'skip' contradicts"),
        ({"choice": "bad", "p_a": 0.5}, "choice 'bad' contradicts"),
        ({"choice": "left"}, "choice is one of a, b, equal, skip, bad: 'left'"),
        ({"p_a": float("nan")}, r"p_a must lie in \[0, 1\]"),
        ({"confidence": 1.5}, r"confidence must lie in \[0, 1\]"),
        ({"response_ms": -1}, "response_ms must be whole milliseconds"),
        ({"created_utc": "2030-01-31T12:00:00"}, "has no offset"),
        ({"client": {"x": float("inf")}}, "client must be JSON"),
        ({"supersedes": "1"}, "cannot correct itself"),
        ({"rater_id": ""}, "rater_id must not be empty"),
    ],
)
def test_answers_that_contradict_themselves_are_refused(
    changes: dict[str, object], message: str
) -> None:
    """The message names the field and the value."""
    with pytest.raises(ValueError, match=message):
        make_answer("1", make_pair(0), **changes)


def test_a_pair_is_named_by_its_clips() -> None:
    """Not by how or when it was chosen; but which clip is a matters."""
    pair = make_pair(0)
    again = Pair.make(pair.a, pair.b, strategy="other", round=5, info={})
    assert again.pair_id == pair.pair_id
    swapped = Pair.make(pair.b, pair.a, strategy="random", round=0, info={})
    assert swapped.pair_id != pair.pair_id
    with pytest.raises(ValueError, match="two different clips"):
        Pair.make(pair.a, pair.a, strategy="random", round=0, info={})


def test_pairs_keep_their_order_and_are_added_once(store: AnswerStore) -> None:
    """Adding known pairs adds nothing and keeps their first round."""
    assert store.add_pairs([make_pair(1, round=9), make_pair(3), make_pair(3)]) == 1
    expected = [make_pair(0), make_pair(1), make_pair(2, round=1), make_pair(3)]
    assert store.pairs() == expected
    assert store.pairs(round=1) == expected[2:3]
    assert store.pair(expected[0].pair_id) == expected[0]
    with pytest.raises(AnswerError, match="has no pair 'x'"):
        store.pair("x")


def test_clips_and_strengths_out_of_arrays_are_stored(store: AnswerStore) -> None:
    """numpy's own numbers come back as plain ones."""
    index = np.arange(5)
    pair = Pair.make(
        Clip("aa", index[1], index[4]),
        Clip("bb", index[1], index[4]),
        strategy="random",
        round=0,
    )
    assert store.add_pairs([pair]) == 1
    assert store.pair(pair.pair_id) == pair
    answer = make_answer("1", pair, p_a=np.float32(0.75))
    assert store.add_answer(answer)
    assert store.current_answers()[0][1].target == 0.75


def test_every_field_of_an_answer_comes_back(store: AnswerStore) -> None:
    """From the file, through another connection."""
    answer = make_answer(
        "1",
        make_pair(0),
        choice="bad",
        shown_ms=1,
        watched_ms=2,
        response_ms=3,
        confidence=0.5,
        note="quöte ' \0",
        reason="foot through floor",
        client={"page": {"version": 1}},
    )
    assert store.add_answer(answer)
    with AnswerStore.open(store.path) as other:
        assert other.current_answers() == [(make_pair(0), answer)]


def test_sending_an_answer_twice_does_no_harm(store: AnswerStore) -> None:
    """The same again is False; the same id with another content is an error."""
    answer = make_answer("1", make_pair(0))
    assert store.add_answer(answer) is True
    assert store.add_answer(answer) is False
    with pytest.raises(AnswerError, match=r"'1' is in .* with another content"):
        store.add_answer(replace(answer, choice="b"))
    assert store.count() == 1


def test_a_correction_replaces_what_it_names(store: AnswerStore) -> None:
    """The old answer stays in the file but counts no more, and only once."""
    pair = make_pair(0)
    store.add_answer(make_answer("1", pair))
    second = make_answer("2", pair, choice="b", supersedes="1")
    store.add_answer(second)
    assert store.current_answers() == [(pair, second)]
    assert store.history("ada", 5) == [(pair, second)]
    with pytest.raises(AnswerError, match=r"no current answer '1'.*corrected already"):
        store.add_answer(make_answer("3", pair, supersedes="1"))
    with pytest.raises(AnswerError, match="no current answer 'x'"):
        store.add_answer(make_answer("3", pair, supersedes="x"))
    third = make_answer("3", pair, choice="equal", supersedes="2")
    store.add_answer(third)
    assert store.current_answers() == [(pair, third)]
    assert store.add_answer(second) is False, "a late retry is still the same answer"


def test_only_ones_own_answer_can_be_corrected(store: AnswerStore) -> None:
    """Neither another rater's nor the answer to another pair."""
    store.add_answer(make_answer("1", make_pair(0)))
    for wrong in (
        make_answer("2", make_pair(0), rater_id="bob", supersedes="1"),
        make_answer("2", make_pair(1), supersedes="1"),
    ):
        with pytest.raises(AnswerError, match="correct only your own answer"):
            store.add_answer(wrong)


def test_unknown_pairs_and_raters_are_named(store: AnswerStore) -> None:
    """An answer cannot dangle."""
    with pytest.raises(AnswerError, match="has no pair"):
        store.add_answer(make_answer("1", make_pair(99)))
    with pytest.raises(AnswerError, match="has no rater 'eve'; add it first"):
        store.add_answer(make_answer("1", make_pair(0), rater_id="eve"))
    with pytest.raises(AnswerError, match=r"'ada' in .* is human, not model"):
        store.add_rater("ada", "model")
    with pytest.raises(ValueError, match="human, scripted, model, got 'cat'"):
        store.add_rater("cy", "cat")  # type: ignore[arg-type]


def test_unanswered_pairs_are_per_rater_or_for_all(store: AnswerStore) -> None:
    """Can't tell is an answer: the pair is not asked again."""
    zero, one, two = store.pairs()
    store.add_answer(make_answer("1", zero, choice="skip"))
    store.add_answer(make_answer("2", one, rater_id="bob"))
    assert store.unanswered("ada") == [one, two]
    assert store.unanswered("bob") == [zero, two]
    assert store.unanswered() == [two]
    assert store.unanswered("ada", round=0) == [one]


def test_current_answers_come_in_the_order_of_pairs(store: AnswerStore) -> None:
    """However they arrived; the history is newest first."""
    zero, one, two = store.pairs()
    for answer_id, pair in (("c", two), ("b", one), ("a", zero)):
        store.add_answer(make_answer(answer_id, pair))
    found = [answer.answer_id for _, answer in store.current_answers()]
    assert found == ["a", "b", "c"]
    assert [answer.answer_id for _, answer in store.current_answers(round=1)] == ["c"]
    assert [answer.answer_id for _, answer in store.history("ada", 2)] == ["a", "b"]
    assert store.count(round=0) == 2
    assert store.count(rater_id="bob") == 0
    assert store.count(choice="a") == 3


def test_leases_end_by_themselves(store: AnswerStore) -> None:
    """Times with other offsets are compared as times."""
    pair = make_pair(0)
    store.lease(pair.pair_id, "ada", "2030-01-31T13:01:00+01:00")
    assert store.leased(NOW) == {pair.pair_id}
    assert store.leased(NOW, except_rater="ada") == frozenset()
    assert store.leased(LATER) == frozenset()
    store.release(pair.pair_id, "ada")
    assert store.leased(NOW) == frozenset()
    with pytest.raises(AnswerError, match="has no pair"):
        store.lease("x", "ada", NOW)


def test_rows_cannot_be_changed_behind_our_back(store: AnswerStore) -> None:
    """Not even with SQL of one's own."""
    store.add_answer(make_answer("1", make_pair(0)))
    with closing(sqlite3.connect(store.path)) as connection:
        for statement in ("UPDATE answer SET choice = 'b'", "DELETE FROM answer"):
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                connection.execute(statement)
        with pytest.raises(sqlite3.IntegrityError, match="append-only"):
            connection.execute("DELETE FROM pair")


def test_the_file_is_set_up_for_safety(store: AnswerStore) -> None:
    """WAL stays with the file; the other switches are per connection."""
    connection = store._connection
    pragmas = ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
    found = [connection.execute(f"PRAGMA {name}").fetchone()[0] for name in pragmas]
    assert found == ["wal", 2, 1, 10_000]


def test_a_newer_version_is_refused_and_left_alone(store: AnswerStore) -> None:
    """The message says what to install."""
    store.close()
    with closing(sqlite3.connect(store.path)) as connection:
        connection.execute("PRAGMA user_version = 3")
    before = store.path.read_bytes()
    with pytest.raises(AnswerError, match="version 3, this gaitpref reads up to 2"):
        AnswerStore.open(store.path)
    assert store.path.read_bytes() == before


def test_other_files_are_refused_and_left_alone(tmp_path: Path) -> None:
    """A stranger's data base, and what is no data base at all."""
    foreign = tmp_path / "foreign.sqlite"
    with closing(sqlite3.connect(foreign)) as connection:
        connection.execute("CREATE TABLE t (x)")
    (tmp_path / "noise.sqlite").write_bytes(b"noise" * 1000)
    for name, message in (
        ("foreign.sqlite", "another program's data base"),
        ("noise.sqlite", "file is not a database"),
        ("missing/p.sqlite", "its directory is missing"),
    ):
        path = tmp_path / name
        before = path.read_bytes() if path.exists() else None
        with pytest.raises(AnswerError, match=message):
            AnswerStore.open(path)
        assert (path.read_bytes() if path.exists() else None) == before


def test_threads_share_a_store(store: AnswerStore) -> None:
    """Ten threads answer at once; each answer is there once."""
    store.add_pairs([make_pair(number) for number in range(100)])
    answers = [make_answer(str(n), make_pair(n)) for n in range(100)] * 2
    with ThreadPoolExecutor(10) as pool:
        assert sum(pool.map(store.add_answer, answers)) == 100
    assert store.count() == 100


CHILD = """
import sys
from pathlib import Path
from tests.test_data_answers import make_answer, make_pair
from data.answers import AnswerStore
name, number = sys.argv[2], 0
with AnswerStore.open(Path(sys.argv[1])) as store:
    store.add_rater("ada", "human")
    while number < int(sys.argv[3]):
        pair = make_pair(number)
        store.add_pairs([pair])
        store.add_answer(make_answer(f"{name}-{number}", pair))
        print(f"{name}-{number}", flush=True)
        number += 1
"""


def start_child(path: Path, name: str, count: int) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path), name, str(count)],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )


def test_acknowledged_answers_survive_a_kill(tmp_path: Path) -> None:
    """SIGKILL in the middle of answering: all that were acknowledged are there."""
    path = tmp_path / "preferences.sqlite"
    with start_child(path, "k", 10**9) as child:
        assert child.stdout is not None
        acknowledged = [child.stdout.readline().strip() for _ in range(30)]
        child.send_signal(signal.SIGKILL)
        acknowledged += child.stdout.read().split()
    with AnswerStore.open(path) as store:
        found = [answer.answer_id for _, answer in store.current_answers()]
        integrity = store._connection.execute("PRAGMA integrity_check").fetchall()
    assert len(found) - len(acknowledged) in (0, 1), "one may be committed, not printed"
    assert found[: len(acknowledged)] == acknowledged
    assert integrity == [("ok",)]


def test_several_processes_share_a_new_store(tmp_path: Path) -> None:
    """Three make and fill it at once; nothing is lost, nothing is locked out."""
    path = tmp_path / "preferences.sqlite"
    children = [start_child(path, name, 20) for name in "xyz"]
    for child in children:
        output, _ = child.communicate(timeout=60)
        assert child.returncode == 0
        assert len(output.split()) == 20
    with AnswerStore.open(path) as store:
        assert store.count() == 60
        assert len(store.pairs()) == 20
