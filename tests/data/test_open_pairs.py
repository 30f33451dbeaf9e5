"""What is open to whom is followed, and never differs from what the answers say."""

import contextlib
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from data.answers.address import Address
from data.answers.answer_records import Answer, Pair
from data.answers.overlap import Overlap
from data.answers.question_board import QuestionBoard, Shown, Tally
from data.answers.store import AnswerStore
from data.episodes.clips import Clip

NOW = "2030-01-31T12:00:00Z"
LATER = "2030-01-31T12:10:00Z"
PEOPLE = ("ada", "bob", "eve")
OVERLAP = Overlap(share=0.5, raters=2)


class UndoneError(Exception):
    """Ends a transaction that is to leave nothing behind."""


def make_pair(number: int) -> Pair:
    """Every fifth has a known answer; rounds go up and down."""
    info = {"gold": "a"} if number % 5 == 4 else {"why": "golden mean"}
    a, b = Clip("aa", number, 50), Clip("bb", number, 30)
    return Pair.make(a, b, strategy="random", round=number * 7 % 3, info=info)


def answer(number: int, pair: Pair, rater: str, **changes: str) -> Answer:
    values = {"choice": "a", "shown_left": "a", "created_utc": NOW} | changes
    return Answer(answer_id=f"{number}", pair_id=pair.pair_id, rater_id=rater, **values)  # type: ignore[arg-type]


def expected(store: AnswerStore, rater: str) -> list[Pair]:
    """The open pairs by their definition, out of all pairs and answers."""
    kinds = store.raters()
    answered = {(a.pair_id, a.rater_id) for _, a in store.current_answers()}
    people = Counter(pair_id for pair_id, who in answered if kinds[who] == "human")
    query = "SELECT DISTINCT pair_id, rater_id FROM question WHERE expires_utc > :now"
    shown = store.query(query, {"now": NOW})
    people.update(pair_id for pair_id, who in shown if who != rater)
    return [
        pair
        for pair in sorted(store.pairs(), key=lambda pair: -pair.round)
        if pair.gold is None
        and (pair.pair_id, rater) not in answered
        and people[pair.pair_id] < (2 if OVERLAP.takes(pair.pair_id) else 1)
    ]


def require_equal(store: AnswerStore, board: QuestionBoard) -> None:
    for rater in PEOPLE:
        wanted = expected(store, rater)
        assert board.open_pairs(rater, NOW) == wanted
        assert board.open_pairs(rater, NOW, limit=2) == wanted[:2]
        assert board.tally(rater, NOW) == Tally(
            answered=store.count(rater_id=rater),
            open=len(wanted),
            total=sum(pair.gold is None for pair in store.pairs()),
        )
        assert board.history(rater, 3) == store.history(rater, 3)
        for pair in store.pairs():
            found = board.is_open(pair.pair_id, rater, NOW)
            assert found == (pair in wanted)


def act(store: AnswerStore, number: int, action: str, who: str, which: int) -> None:
    """Change the store in one of the ways it is changed in."""
    pairs = store.pairs()
    pair = pairs[which % len(pairs)]
    own = [a for p, a in store.history(who, 50) if p == pair]
    match action:
        case "pairs":
            store.add_pairs([make_pair(len(pairs)), make_pair(len(pairs) + 1)])
        case "answer":
            store.add_answer(answer(number, pair, who))
        case "again":
            store.add_answer(answer(number, pair, who, role="repeat"))
        case "correct" if own:
            changes = {"supersedes": own[0].answer_id, "role": own[0].role}
            store.add_answer(answer(number, pair, who, choice="b", **changes))
        case "undo" if own:
            changes = {"supersedes": own[0].answer_id, "role": "undo"}
            store.add_answer(answer(number, pair, who, choice="skip", **changes))
        case "look" if who in PEOPLE:
            shown = Shown(
                question_id=f"q{number}",
                rater_id=who,
                pair_id=pair.pair_id,
                role="first",
                shown_left="a",
                supersedes=None,
                shown_utc=NOW,
                expires_utc=LATER if which % 2 else NOW,
            )
            QuestionBoard(store, OVERLAP).show(shown)


ACTIONS = st.lists(
    st.tuples(
        st.sampled_from(["pairs", "answer", "again", "correct", "undo", "look"]),
        st.sampled_from([*PEOPLE, "model"]),
        st.integers(0, 12),
        st.sampled_from(["here", "elsewhere", "inside", "undone"]),
    ),
    min_size=4,
    max_size=20,
)


@settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(actions=ACTIONS)
def test_what_is_open_follows_the_answers(
    tmp_path_factory: pytest.TempPathFactory,
    actions: list[tuple[str, str, int, str]],
) -> None:
    """Whoever answers, corrects, takes back and looks, here or in another process,
    and whichever transaction is undone after the board was asked in it."""
    path = tmp_path_factory.mktemp("open") / "preferences.sqlite"
    with AnswerStore.open(path) as store, AnswerStore.open(path) as other:
        for each in (store, other):
            each.query("PRAGMA synchronous = OFF")
        for name in PEOPLE:
            store.add_rater(name, "human")
        store.add_rater("model", "scripted")
        store.add_pairs(make_pair(number) for number in range(4))
        board = QuestionBoard(store, OVERLAP)
        for number, (action, who, which, where) in enumerate(actions):
            if where == "elsewhere":
                act(other, number, action, who, which)
            elif where == "here":
                act(store, number, action, who, which)
            else:
                with contextlib.suppress(UndoneError), store.transaction():
                    act(store, number, action, who, which)
                    require_equal(store, board)
                    if where == "undone":
                        raise UndoneError
            require_equal(store, board)


def test_a_board_beside_another_process_follows(answers_address: Address) -> None:
    """Also where the other one takes the position of an answer that was undone."""
    with (
        AnswerStore.open(answers_address) as store,
        AnswerStore.open(answers_address) as other,
    ):
        for name in PEOPLE:
            store.add_rater(name, "human")
        store.add_pairs(make_pair(number) for number in range(20))
        boards = [QuestionBoard(each, OVERLAP) for each in (store, other)]
        first, second, *_ = store.pairs()
        with contextlib.suppress(UndoneError), store.transaction():
            store.add_answer(answer(1, first, "ada"))
            require_equal(store, boards[0])
            raise UndoneError
        other.add_answer(answer(2, second, "bob"))
        for each, board in zip((store, other), boards, strict=True):
            require_equal(each, board)


def test_many_pairs_are_read_in_parts(tmp_path: Path) -> None:
    """More than fit into one statement, and the queue is the same."""
    with AnswerStore.open(tmp_path / "preferences.sqlite") as store:
        store.query("PRAGMA synchronous = OFF")
        store.add_rater("ada", "human")
        store.add_pairs(make_pair(number) for number in range(20_500))
        board = QuestionBoard(store, OVERLAP)
        assert board.tally("ada", NOW).open == 16_400
        assert board.open_pairs("ada", NOW, limit=600) == expected(store, "ada")[:600]
