"""The owner leaves raters out and adds known answers; nothing that was said changes."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from data.answers.address import Address
from data.answers.answer_records import utc_text
from data.answers.check import damaged_rows
from data.answers.curation import (
    answers_heard,
    ask_known,
    find_pair,
    hear_owner_of,
    known_because,
    leave_out,
    left_out,
    withdraw_known,
    withdrawn,
)
from data.answers.lines import from_lines, to_lines
from data.answers.overlap import Overlap
from data.answers.question_board import QuestionBoard
from data.answers.store import AnswerStore
from data.datasets.merged_rows import add_rows, rows_of
from data.errors import AnswerError
from labeling_ui.questions.rater_figures import human_rows
from rewardmodel.answers.used import count_evidence
from tests.data.test_answers import fill, make_answer, make_pair

NOON = datetime(2030, 1, 31, 12, tzinfo=UTC)
LATER = NOON + timedelta(hours=1)
Both = tuple[AnswerStore, AnswerStore]


@pytest.fixture
def store(answers_address: Address) -> Iterator[AnswerStore]:
    """Ada answered two of three pairs, on SQLite and on PostgreSQL."""
    with AnswerStore.open(answers_address) as store:
        fill(store)
        for number in range(2):
            store.add_answer(make_answer(f"a{number}", make_pair(number)))
        yield store


@pytest.fixture
def both(tmp_path: Path) -> Iterator[Both]:
    """Two stores in which ada answered the same."""
    with (
        AnswerStore.open(tmp_path / "ours.sqlite") as ours,
        AnswerStore.open(tmp_path / "theirs.sqlite") as theirs,
    ):
        for store in (ours, theirs):
            fill(store).add_answer(make_answer("a0", make_pair(0)))
        yield ours, theirs


def test_who_is_left_out_teaches_nothing_and_can_come_back(store: AnswerStore) -> None:
    """The answers stay, as does what was known of the rater."""
    assert count_evidence(store) == 2
    leave_out(store, "ada", NOON)
    assert left_out(store) == {"ada"}
    assert count_evidence(store) == 0
    assert store.count(rater_id="ada") == 2
    leave_out(store, "ada", NOON)
    leave_out(store, "ada", NOON, out=False)
    assert left_out(store) == frozenset()
    assert count_evidence(store) == 2
    said = {"left_out": False, "left_out_utc": utc_text(NOON.isoformat())}
    assert store.rater_rows()[0] == ("ada", "human", {"since": 2030, **said})


def test_a_question_whose_answer_is_known_measures_and_teaches_nothing(
    store: AnswerStore,
) -> None:
    """It shows the clips of a pair the other way round, which stays as it is."""
    board = QuestionBoard(store, Overlap())
    assert board.gold_pairs("cy") == []
    known = ask_known(store, make_pair(0), "a")
    assert (known.a, known.b) == (make_pair(0).b, make_pair(0).a)
    assert (known.gold, known_because(known)) == ("b", "the owner says so")
    assert board.gold_pairs("cy") == [known.pair_id]
    store.add_answer(make_answer("known", known))
    assert count_evidence(store) == 2
    assert store.pair(make_pair(0).pair_id).gold is None
    with pytest.raises(AnswerError, match="in both orders already"):
        ask_known(store, make_pair(0), "a")
    with pytest.raises(AnswerError, match="is known already"):
        ask_known(store, known, "a")


def test_what_the_owner_says_travels_and_is_whole(
    store: AnswerStore, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Checksums are those of what was written, and archives take it along."""
    leave_out(store, "ada", NOON)
    known = ask_known(store, make_pair(1), "equal")
    assert not list(damaged_rows(store.address))
    with AnswerStore.open(tmp_path_factory.mktemp("other") / "b.sqlite") as other:
        fill(other)
        from_lines(other, to_lines(store), "archive")
        assert left_out(other) == {"ada"}
        assert other.pair(known.pair_id).gold == "equal"


def test_who_is_left_out_is_left_out_where_it_is_merged(both: Both) -> None:
    """Also into a store that learned from the rater before."""
    ours, theirs = both
    leave_out(theirs, "ada", NOON)
    assert left_out(ours) == frozenset()
    add_rows(ours, rows_of(theirs, "theirs"), {"aa", "bb"})
    assert left_out(ours) == {"ada"}
    assert answers_heard(ours) == []


def test_the_last_word_about_a_rater_counts_where_it_is_merged(both: Both) -> None:
    """Whichever way, and over what an earlier version said, which told no time."""
    ours, theirs = both
    leave_out(ours, "ada", NOON)
    leave_out(theirs, "ada", LATER, out=False)
    add_rows(theirs, rows_of(ours, "ours"), {"aa", "bb"})
    assert left_out(theirs) == frozenset()
    add_rows(ours, rows_of(theirs, "theirs"), {"aa", "bb"})
    assert left_out(ours) == frozenset()
    hear_owner_of(ours, "ada", {"left_out": True})
    hear_owner_of(ours, "ada", {"left_out": True, "left_out_utc": "soon"})
    assert left_out(ours) == frozenset()
    hear_owner_of(ours, "ada", {"left_out": True, "left_out_utc": "2030-02-01T00:00Z"})
    assert left_out(ours) == {"ada"}


def test_a_known_answer_can_be_withdrawn(store: AnswerStore, tmp_path: Path) -> None:
    """A page that is up asks it no more; it measures nobody, and that travels."""
    board = QuestionBoard(store, Overlap())
    known = ask_known(store, make_pair(0), "a")
    store.add_answer(make_answer("known", known))
    assert board.gold_pairs("cy") == [known.pair_id]
    assert known in [pair for pair, _ in human_rows(store)]
    tally = board.tally("cy", NOON.isoformat())
    withdraw_known(store, known, NOON)
    assert board.gold_pairs("cy") == []
    assert board.tally("cy", NOON.isoformat()) == tally
    assert known not in [pair for pair, _ in human_rows(store)]
    assert store.find_answer("known") is not None
    assert count_evidence(store) == 2
    assert not list(damaged_rows(store.address))
    with pytest.raises(AnswerError, match="withdrawn already"):
        withdraw_known(store, known, LATER)
    with pytest.raises(AnswerError, match=r"no answer to .* is known, so there"):
        withdraw_known(store, make_pair(1), NOON)
    lines = list(to_lines(store))
    with (
        AnswerStore.open(tmp_path / "archive.sqlite") as unpacked,
        AnswerStore.open(tmp_path / "merged.sqlite") as merged,
    ):
        from_lines(unpacked, lines, "archive")
        assert withdrawn(unpacked) == {known.pair_id}
        fill(merged)
        withdraw_known(merged, ask_known(merged, make_pair(0), "a"), LATER)
        add_rows(merged, rows_of(store, "ours"), {"aa", "bb"})
        assert withdrawn(merged) == {known.pair_id}
        assert QuestionBoard(merged, Overlap()).gold_pairs("cy") == []


def test_whoever_and_whatever_is_not_there_is_named(store: AnswerStore) -> None:
    """With those that are."""
    with pytest.raises(AnswerError, match="no rater 'eve'; there are ada, bob"):
        leave_out(store, "eve", NOON)
    pair = make_pair(2, round=1)
    assert find_pair(store, pair.pair_id[:10]) == pair
    with pytest.raises(AnswerError, match="3 of 3 pairs begin with ''"):
        find_pair(store, "")
    with pytest.raises(AnswerError, match="0 of 3 pairs begin with 'zz'"):
        find_pair(store, "zz")
