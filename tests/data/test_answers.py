"""The store of answers: nothing acknowledged is lost, nothing is ever changed."""

import os
import signal
import sqlite3
import subprocess
import sys
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data.answers import sqlite_file as answer_database
from data.answers.address import Address, parse_address
from data.answers.answer_records import Answer, Choice, Pair
from data.answers.backend import SqliteBackend
from data.answers.check import damaged_rows
from data.answers.lines import from_lines, to_lines
from data.answers.overlap import Overlap
from data.answers.question_board import QuestionBoard, Shown, Tally
from data.answers.rows import encode_answer
from data.answers.sqlite_file import SCHEMA_VERSION, backup_path
from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from data.datasets.verify import verify
from data.episodes.clips import Clip
from data.errors import AnswerError, AnswersUnreachable
from data.files.limits import NOTE_CHARS, RATER_ID_CHARS

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


def fill(store: AnswerStore) -> AnswerStore:
    store.add_rater("ada", "human", {"since": 2030})
    store.add_rater("bob", "scripted")
    store.add_pairs([make_pair(0), make_pair(1), make_pair(2, round=1)])
    return store


@pytest.fixture
def store(answers_address: Address) -> Iterator[AnswerStore]:
    """A store with two raters and three pairs, on SQLite and on PostgreSQL."""
    with AnswerStore.open(answers_address) as store:
        yield fill(store)


@pytest.fixture
def file_store(tmp_path: Path) -> Iterator[AnswerStore]:
    """The same in a file, for what only a file can meet."""
    with AnswerStore.open(tmp_path / "file.sqlite") as store:
        yield fill(store)


def file_of(store: AnswerStore) -> Path:
    assert isinstance(store.address, Path)
    return store.address


def connection_of(store: AnswerStore) -> sqlite3.Connection:
    assert isinstance(store._backend, SqliteBackend)
    return store._backend.connection


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
        ({"why": "mood"}, "why is one of , posture, feet"),
        ({"why": "feet", "choice": "equal"}, "why 'feet' without a preference"),
        ({"response_ms": -1}, "response_ms must be whole milliseconds"),
        ({"created_utc": "2030-01-31T12:00:00"}, "has no offset"),
        ({"client": {"x": float("inf")}}, "client must be JSON"),
        ({"supersedes": "1"}, "cannot correct itself"),
        ({"rater_id": ""}, "rater_id must not be empty"),
        ({"role": "third"}, "role is one of first, repeat, undo: 'third'"),
        ({"role": "undo", "choice": "skip"}, "an undo supersedes an answer"),
        ({"role": "undo", "supersedes": "0"}, "has the choice 'skip'"),
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
        note="quöte ' \\ : :name %s 猫",
        reason="foot through floor",
        client={"page": {"version": 1}},
    )
    assert store.add_answer(answer)
    with AnswerStore.open(store.address) as other:
        assert other.current_answers() == [(make_pair(0), answer)]


def test_what_decided_an_answer_comes_back(store: AnswerStore, tmp_path: Path) -> None:
    """From the file, and from lines; of those of before it could be said, nothing."""
    answer = make_answer("1", make_pair(0), choice="b", why="rhythm")
    store.add_answer(answer)
    lines = list(to_lines(store))
    with AnswerStore.open(store.address) as other:
        assert other.current_answers() == [(make_pair(0), answer)]
    with AnswerStore.open(tmp_path / "new.sqlite") as copy:
        from_lines(copy, lines, "lines")
        assert copy.all_answers() == [(make_pair(0), answer)]
    older = [line.replace(', "why": "rhythm"', "") for line in lines]
    assert older != lines
    with AnswerStore.open(tmp_path / "older.sqlite") as copy:
        from_lines(copy, older, "lines")
        assert copy.all_answers() == [(make_pair(0), replace(answer, why=""))]


def test_what_decided_it_is_part_of_what_is_checked() -> None:
    """An answer that does not say it has the checksum it always had."""
    said, silent = (
        encode_answer(make_answer("1", make_pair(0), why=why)) for why in ("feet", "")
    )
    assert said["crc32"] != silent["crc32"]
    *values, _, _ = silent.values()
    assert silent["crc32"] == zlib.crc32("\x1f".join(map(str, values)).encode())


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


def test_an_answer_taken_back_is_none(store: AnswerStore) -> None:
    """Its pair is open again, and may be answered anew; the row stays in the file."""
    pair = make_pair(0)
    store.add_answer(make_answer("1", pair))
    undo = make_answer("2", pair, choice="skip", role="undo", supersedes="1")
    store.add_answer(undo)
    assert store.current_answers() == []
    assert store.current_answer("1") is None
    assert store.count() == 0
    assert pair in store.unanswered("ada")
    assert pair in store.unanswered()
    again = make_answer("3", pair, choice="b")
    store.add_answer(again)
    assert store.current_answers() == [(pair, again)]
    assert store.current_answer("3") == (pair, again)
    assert store.query("SELECT count(*) FROM answer") == [(3,)]


def make_shown(question_id: str, pair: Pair, **changes: object) -> Shown:
    values: dict[str, object] = {
        "question_id": question_id,
        "rater_id": "ada",
        "pair_id": pair.pair_id,
        "role": "first",
        "shown_left": "a",
        "supersedes": None,
        "shown_utc": "2030-01-31T12:00:00.000000Z",
        "expires_utc": "2030-01-31T12:01:00.000000Z",
    }
    return Shown(**(values | changes))  # type: ignore[arg-type]


ONE_EACH = Overlap(share=0.0)


def test_shown_pairs_are_kept_from_others_for_a_while(store: AnswerStore) -> None:
    """Until the lease ends; times with other offsets are compared as times."""
    store.add_rater("eve", "human")
    board = QuestionBoard(store, ONE_EACH)
    pair = make_pair(0)
    shown = make_shown("q", pair, expires_utc="2030-01-31T13:01:00+01:00")
    board.show(shown)
    assert board.shown("ada") == [make_shown("q", pair)]
    assert pair not in board.open_pairs("eve", NOW)
    assert pair in board.open_pairs("ada", NOW)
    shared = QuestionBoard(store, Overlap(share=1.0, raters=2))
    assert pair in shared.open_pairs("eve", NOW)
    assert pair in board.open_pairs("eve", LATER)
    board.renew("ada", "2030-01-31T12:10:00Z")
    assert pair not in board.open_pairs("eve", LATER)
    board.close("q")
    assert pair in board.open_pairs("eve", NOW)
    with pytest.raises(AnswerError, match=r"(?i)foreign key"):
        board.show(make_shown("q", make_pair(99)))


def test_the_newest_round_comes_first(store: AnswerStore) -> None:
    """Within a round the order is that of the loop; known answers are not in it."""
    store.add_rater("eve", "human")
    known = Pair.make(
        Clip("aa", 90, 5), Clip("bb", 90, 5), strategy="x", round=9, info={"gold": "b"}
    )
    store.add_pairs([known])
    zero, one, two, _ = store.pairs()
    board = QuestionBoard(store, ONE_EACH)
    shared = QuestionBoard(store, Overlap(share=1.0))
    assert board.open_pairs("ada", NOW) == [two, zero, one]
    assert board.open_pairs("ada", NOW, limit=1) == [two]
    assert board.tally("ada", NOW) == Tally(answered=0, open=3, total=3)
    store.add_answer(make_answer("1", two))
    store.add_answer(make_answer("2", zero, rater_id="bob"))
    assert board.open_pairs("ada", NOW) == [zero, one]
    assert board.open_pairs("eve", NOW) == [zero, one]
    assert shared.open_pairs("eve", NOW) == [two, zero, one]
    assert board.gold_pairs("ada") == [known.pair_id]
    store.add_answer(make_answer("3", known))
    assert board.gold_pairs("ada") == []
    assert board.gold_pairs("eve") == [known.pair_id]


def test_about_a_fifth_of_the_pairs_overlap() -> None:
    """Which ones depends on the pair alone, as the data base sees it too."""
    ids = [make_pair(number).pair_id for number in range(2000)]
    share = sum(map(Overlap(share=0.2).takes, ids)) / len(ids)
    assert share == pytest.approx(0.2, abs=0.03)
    assert all(map(Overlap(share=1.0).takes, ids))
    assert not any(map(Overlap(share=0.0).takes, ids))
    with pytest.raises(ValueError, match=r"share in \[0, 1\]"):
        Overlap(share=1.5)


def test_a_known_answer_must_be_a_preference() -> None:
    """Anything else could never be met."""
    clips = Clip("aa", 0, 5), Clip("bb", 0, 5)
    with pytest.raises(ValueError, match="one of a, b, equal, got 'left'"):
        Pair.make(*clips, strategy="x", round=0, info={"gold": "left"})


def test_a_transaction_is_all_or_nothing(store: AnswerStore) -> None:
    """Also where one is part of another."""

    def fail_half_way() -> None:
        with store.transaction():
            store.add_answer(make_answer("1", make_pair(0)))
            raise RuntimeError("the power is gone")

    with pytest.raises(RuntimeError, match="the power is gone"):
        fail_half_way()
    assert store.count() == 0
    with store.transaction():
        store.add_answer(make_answer("1", make_pair(0)))
        store.add_answer(make_answer("2", make_pair(1)))
    assert store.count() == 2


def test_together_each_is_whole_by_itself(store: AnswerStore) -> None:
    """One that fails takes none of the others along, before it or behind it."""
    with store.together():
        store.add_answer(make_answer("1", make_pair(0)))
        with pytest.raises(AnswerError, match="no pair"):
            store.add_answer(make_answer("2", make_pair(9)))
        store.add_answer(make_answer("3", make_pair(1)))
    assert [answer.answer_id for _, answer in store.current_answers()] == ["1", "3"]
    with AnswerStore.open(store.address) as other:
        assert other.count() == 2


def test_together_ends_like_a_transaction_of_its_own(store: AnswerStore) -> None:
    """Where the block fails, what it stored before is kept; inside another
    transaction all of it belongs to that one."""

    def fail(context: AbstractContextManager[None], answer_id: str) -> None:
        with context, store.together():
            store.add_answer(make_answer(answer_id, make_pair(int(answer_id))))
            raise RuntimeError("the power is gone")

    with pytest.raises(RuntimeError):
        fail(nullcontext(), "0")
    with pytest.raises(RuntimeError):
        fail(store.transaction(), "1")
    assert [answer.answer_id for _, answer in store.current_answers()] == ["0"]


def test_together_waits_for_the_disk_at_its_end(postgres_answers: str) -> None:
    """The server tells how much of its log is on the disk."""

    def on_disk(lsn: str) -> bool:
        query = "SELECT pg_current_wal_flush_lsn() >= CAST(:lsn AS pg_lsn)"
        return store.query(query, {"lsn": lsn})[0][0]

    with AnswerStore.open(postgres_answers) as store:
        fill(store)
        with store.together():
            for number in range(2):
                store.add_answer(make_answer(str(number), make_pair(number)))
            query = "SELECT CAST(pg_current_wal_insert_lsn() AS TEXT)"
            written = store.query(query)[0][0]
        assert on_disk(written)


def test_one_by_one_waits_for_the_disk_after_together(file_store: AnswerStore) -> None:
    """The switch that lets commits wait is per connection, and set back."""
    with file_store.together():
        file_store.add_answer(make_answer("1", make_pair(0)))
    assert file_store.query("PRAGMA synchronous") == [(2,)]


STORED = Path(__file__).parents[1] / "stored" / "answers"


@pytest.mark.parametrize("version", range(1, SCHEMA_VERSION + 1))
def test_a_store_of_every_version_is_brought_up_to_date(
    version: int, tmp_path: Path
) -> None:
    """Every answer is there as it was given; what it was before lies beside it."""
    path = tmp_path / "preferences.sqlite"
    old = (STORED / f"v{version}.sqlite").read_bytes()
    path.write_bytes(old)
    with AnswerStore.snapshot(path) as copy:
        expected = copy.all_answers()
    assert path.read_bytes() == old, "who only reads changes nothing"
    with AnswerStore.open(path) as store:
        assert store.all_answers() == expected
        by_id = {answer.answer_id: answer for _, answer in expected}
        assert (by_id["1"].p_a, by_id["1"].note) == (0.75, "höher ' \"")
        assert by_id["3"].supersedes == "2"
        current = [answer.answer_id for _, answer in store.current_answers()]
        assert current == ["1", "3", "4"]
        assert store.rater_rows()[0] == ("ada", "human", {"since": 2030})
        store.add_answer(make_answer("new", store.pairs()[2]))
    assert damaged_rows(path) == []
    for older in range(1, SCHEMA_VERSION):
        backup = backup_path(path, older)
        assert backup.exists() == (older >= version)
        if backup.exists():
            with closing(sqlite3.connect(backup)) as connection:
                (found,) = connection.execute("PRAGMA user_version").fetchone()
                (count,) = connection.execute("SELECT count(*) FROM answer").fetchone()
            assert (found, count) == (older, len(expected))


def test_a_migration_that_fails_leaves_the_version_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first step is done and kept, the second is undone as a whole."""
    path = tmp_path / "preferences.sqlite"
    path.write_bytes((STORED / "v1.sqlite").read_bytes())
    real = answer_database._statements

    def failing(number: int) -> Iterator[str]:
        for index, statement in enumerate(real(number)):
            if (number, index) == (3, 4):
                raise sqlite3.OperationalError("the power is gone")
            yield statement

    monkeypatch.setattr(answer_database, "_statements", failing)
    with pytest.raises(AnswerError, match="the power is gone"):
        AnswerStore.open(path)
    monkeypatch.undo()
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (2,)
        tables = connection.execute("SELECT sql FROM sqlite_master").fetchall()
    assert not any("crc32" in (row[0] or "") for row in tables)
    with AnswerStore.open(path) as store:
        assert len(store.current_answers()) == 3


def test_a_new_store_is_alone_in_its_directory(tmp_path: Path) -> None:
    """It was never older, so there is nothing to keep of that."""
    with AnswerStore.open(tmp_path / "preferences.sqlite") as store:
        fill(store)
    assert [path.name for path in tmp_path.iterdir()] == ["preferences.sqlite"]


def test_two_processes_may_migrate_at_once(tmp_path: Path) -> None:
    """One does it, the other waits and finds it done."""
    path = tmp_path / "preferences.sqlite"
    path.write_bytes((STORED / "v1.sqlite").read_bytes())

    def count(_: int) -> int:
        with AnswerStore.open(path) as store:
            return store.count()

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(count, range(8))) == [3] * 8
    assert damaged_rows(path) == []


def test_rows_cannot_be_changed_behind_our_back(file_store: AnswerStore) -> None:
    """Not even with SQL of one's own."""
    file_store.add_answer(make_answer("1", make_pair(0)))
    with closing(sqlite3.connect(file_of(file_store))) as connection:
        for statement in ("UPDATE answer SET choice = 'b'", "DELETE FROM answer"):
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                connection.execute(statement)
        with pytest.raises(sqlite3.IntegrityError, match="append-only"):
            connection.execute("DELETE FROM pair")


def test_the_file_is_set_up_for_safety(file_store: AnswerStore) -> None:
    """WAL stays with the file; the other switches are per connection."""
    connection = connection_of(file_store)
    pragmas = ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
    found = [connection.execute(f"PRAGMA {name}").fetchone()[0] for name in pragmas]
    assert found == ["wal", 2, 1, 30_000]


def test_a_newer_version_is_refused_and_left_alone(file_store: AnswerStore) -> None:
    """The message says what to install."""
    file_store.close()
    with closing(sqlite3.connect(file_of(file_store))) as connection:
        connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    before = file_of(file_store).read_bytes()
    with pytest.raises(AnswerError, match=f"reads up to {SCHEMA_VERSION}"):
        AnswerStore.open(file_of(file_store))
    assert file_of(file_store).read_bytes() == before


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
from tests.data.test_answers import make_answer, make_pair
from data.answers.store import AnswerStore
address, name, number = sys.argv[1], sys.argv[2], 0
if not address.startswith("postgresql"):
    address = Path(address)
with AnswerStore.open(address) as store:
    store.add_rater("ada", "human")
    while number < int(sys.argv[3]):
        pair = make_pair(number)
        store.add_pairs([pair])
        store.add_answer(make_answer(f"{name}-{number}", pair))
        print(f"{name}-{number}", flush=True)
        number += 1
"""


def start_child(address: Address, name: str, count: int) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(address), name, str(count)],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )


def test_acknowledged_answers_survive_a_kill(answers_address: Address) -> None:
    """SIGKILL in the middle of answering: all that were acknowledged are there."""
    with start_child(answers_address, "k", 10**9) as child:
        assert child.stdout is not None
        acknowledged = [child.stdout.readline().strip() for _ in range(30)]
        child.send_signal(signal.SIGKILL)
        acknowledged += child.stdout.read().split()
    with AnswerStore.open(answers_address) as store:
        found = [answer.answer_id for _, answer in store.current_answers()]
    assert len(found) - len(acknowledged) in (0, 1), "one may be committed, not printed"
    assert found[: len(acknowledged)] == acknowledged
    assert damaged_rows(answers_address) == []


def test_several_processes_share_a_new_store(answers_address: Address) -> None:
    """Three make and fill it at once; nothing is lost, nothing is locked out."""
    children = [start_child(answers_address, name, 20) for name in "xyz"]
    for child in children:
        output, _ = child.communicate(timeout=60)
        assert child.returncode == 0
        assert len(output.split()) == 20
    with AnswerStore.open(answers_address) as store:
        assert store.count() == 60
        assert len(store.pairs()) == 20


def test_a_copy_is_of_one_moment_and_keeps_to_itself(store: AnswerStore) -> None:
    """What is added to the copy is not in the store, and the other way round."""
    store.add_answer(make_answer("1", make_pair(0)))
    with AnswerStore.snapshot(store.address) as copy:
        store.add_answer(make_answer("2", make_pair(1)))
        copy.add_answer(make_answer("3", make_pair(2, round=1)))
        assert [a.answer_id for _, a in copy.all_answers()] == ["1", "3"]
    assert [a.answer_id for _, a in store.all_answers()] == ["1", "2"]
    assert store.rater_rows() == [
        ("ada", "human", {"since": 2030}),
        ("bob", "scripted", {}),
    ]


def test_a_changed_row_on_the_server_is_noticed(postgres_answers: str) -> None:
    """Rows are append-only there too; who owns the tables can still change them."""
    import psycopg

    with AnswerStore.open(postgres_answers) as store:
        fill(store).add_answer(make_answer("1", make_pair(0)))
        for statement in ("UPDATE answer SET note = 'x'", "DELETE FROM pair"):
            with pytest.raises(AnswerError, match="append-only"):
                store.query(statement)
        assert damaged_rows(postgres_answers) == []
        with psycopg.connect(postgres_answers) as connection:
            connection.execute("ALTER TABLE answer DISABLE TRIGGER ALL")
            connection.execute("UPDATE answer SET note = 'x'")
        (row,) = damaged_rows(postgres_answers)
        assert row.answers == ("1",)
        with pytest.raises(AnswerError, match="not what was written"):
            store.current_answers()


def test_what_postgresql_cannot_do_is_said_in_one_line(
    postgres_answers: str, tmp_path: Path
) -> None:
    """No server, no such URL, a newer version, a character it does not hold."""
    with AnswerStore.open(postgres_answers) as store:
        fill(store)
        with pytest.raises(AnswerError, match="NUL"):
            store.add_answer(make_answer("1", make_pair(0), note="a\0b"))
        assert store.count() == 0
        store.query("INSERT INTO gaitpref_store VALUES (:v)", {"v": SCHEMA_VERSION + 1})
    with pytest.raises(AnswerError, match=f"reads up to {SCHEMA_VERSION}"):
        AnswerStore.open(postgres_answers)
    nowhere = "postgresql://ada:secret@127.0.0.1:1/none"
    with pytest.raises(AnswersUnreachable, match="cannot be reached: conn") as caught:
        AnswerStore.open(nowhere)
    assert "secret" not in str(caught.value)
    assert "\n" not in str(caught.value)
    Dataset.create(tmp_path)
    # That says nothing about the answers: it is no damage.
    with pytest.raises(AnswersUnreachable, match="cannot be reached"):
        verify(tmp_path, answers=nowhere)
    with pytest.raises(AnswerError, match="--answers takes postgresql://"):
        parse_address("mysql://ada:secret@host/none")


def test_what_people_type_has_a_limit(store: AnswerStore) -> None:
    """In every store, whoever asks for it to be kept."""
    fill(store)
    pair = store.pairs()[2]
    longest = "x" * NOTE_CHARS
    for number, name in enumerate(("note", "reason")):
        answer_id = f"new{number}"
        long = make_answer(answer_id, pair, **{name: longest + "x"})
        with pytest.raises(AnswerError, match=f"the {name} of .* has 1,001 characters"):
            store.add_answer(long)
        assert store.find_answer(answer_id) is None
        assert store.add_answer(make_answer(answer_id, pair, **{name: longest}))
    with pytest.raises(AnswerError, match="has 201 characters, 200 at most"):
        store.add_rater("x" * (RATER_ID_CHARS + 1), "human")


def test_what_was_typed_before_there_was_a_limit_is_kept(tmp_path: Path) -> None:
    """It is read, verified, merged, packed and unpacked as it is."""
    old, rater = Dataset.create(tmp_path / "old"), "r" * 300
    note = "x" * 900_000
    pair = make_pair(0)
    with old.answers() as store:
        store.add_pairs([pair])
        store.add_rater(rater, "human", copied=True)
        answer = make_answer("1", pair, rater_id=rater, note=note)
        store.add_answer(answer, copied=True)
    lines = list(to_lines(old.answers_copy()))
    with Dataset.create(tmp_path / "unpacked").answers() as store:
        from_lines(store, lines, "lines")
        assert store.all_answers() == [(pair, answer)]
        assert store.raters() == {rater: "human"}
