"""The queue of a rater: nothing is lost, nothing is asked or answered twice."""

import datetime
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.answer_cost import QUEUE, answer_once, fill
from data.answers.answer_records import Pair
from data.answers.backend import SqliteBackend
from data.answers.overlap import Overlap
from data.answers.question_board import QuestionBoard
from data.answers.sqlite_file import connect
from data.answers.store import AnswerStore
from data.episodes.clips import Clip
from labeling_ui.questions.judgement import Judgement, Outcome, Question, Verdict
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.plan import PlanCfg, slot
from labeling_ui.questions.rater_session import QueueCfg, RaterSession

NO_GUARD = GuardCfg(min_shown_s=0.0, repeat_gap_s=0.0, same_verdict_s=0.0)
PLAIN = PlanCfg(repeat_share=0.0, gold_share=0.0, overlap=Overlap(share=0.0))


class Clock:
    """A clock that stands still until it is told otherwise."""

    def __init__(self) -> None:
        self.now = datetime.datetime(2030, 1, 31, 12, tzinfo=datetime.UTC)

    def __call__(self) -> datetime.datetime:
        return self.now

    def advance(self, seconds: float) -> None:
        self.now += datetime.timedelta(seconds=seconds)


def make_pair(number: int, round: int = 0, **info: object) -> Pair:
    a, b = Clip("aa", number, 50), Clip("bb", number, 30)
    return Pair.make(a, b, strategy="random", round=round, info=info)


Open = Callable[..., RaterSession]


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def store(tmp_path: Path) -> Iterator[AnswerStore]:
    """A store with three open pairs."""
    with AnswerStore.open(tmp_path / "preferences.sqlite") as store:
        # Thousands of answers; that they survive a power loss is tested elsewhere.
        store.query("PRAGMA synchronous = OFF")
        store.add_pairs(make_pair(number) for number in range(3))
        yield store


@pytest.fixture
def open_session(store: AnswerStore, clock: Clock) -> Open:
    """Opens a session as the page does, again and again if need be."""

    def opened(
        rater_id: str = "ada", plan: PlanCfg = PLAIN, guard: GuardCfg = NO_GUARD
    ) -> RaterSession:
        cfg = QueueCfg(plan=plan, guard=guard)
        rng = np.random.default_rng(0)
        return RaterSession(store, rater_id, cfg=cfg, rng=rng, now=clock)

    return opened


def shown(session: RaterSession) -> Question:
    question = session.current()
    assert question is not None
    return question


def say(session: RaterSession, verdict: Verdict = "left", **more: object) -> Outcome:
    question_id = shown(session).question_id
    return session.answer(
        Judgement(question_id=question_id, verdict=verdict, **more)  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("verdict", "as_a", "as_b"),
    [
        ("left_much", ("a", 1.0), ("b", 0.0)),
        ("left", ("a", 0.75), ("b", 0.25)),
        ("equal", ("equal", 0.5), ("equal", 0.5)),
        ("right", ("b", 0.25), ("a", 0.75)),
        ("right_much", ("b", 0.0), ("a", 1.0)),
        ("skip", ("skip", None), ("skip", None)),
        ("bad", ("bad", None), ("bad", None)),
    ],
)
def test_what_is_said_of_sides_is_stored_of_clips(
    open_session: Open, store: AnswerStore, verdict: Verdict, as_a: object, as_b: object
) -> None:
    """Relative to clip a, whichever side it was on; and read back as it was said."""
    session = open_session()
    sides = set()
    for _ in range(3):
        question = shown(session)
        sides.add(question.shown_left)
        clips = question.pair.a, question.pair.b
        expected = clips if question.shown_left == "a" else clips[::-1]
        assert (question.left, question.right) == expected
        answer = say(session, verdict).answer
        assert answer is not None
        expected = as_a if question.shown_left == "a" else as_b
        assert (answer.choice, answer.p_a) == expected
        assert session.history(1)[0].verdict == verdict
    assert sides == {"a", "b"}, "the sides are left to chance"
    assert store.count() == 3


def test_all_that_was_measured_is_stored(open_session: Open, clock: Clock) -> None:
    """Times, note, reason, confidence, and what the page says about itself."""
    session = open_session()
    shown(session)
    clock.advance(4.2)
    answer = say(
        session,
        "bad",
        reason="foot through the floor",
        note="both",
        confidence=0.5,
        watched_ms=3000,
        response_ms=4000,
        client={"speed": 0.5},
    ).answer
    assert answer is not None
    assert (answer.shown_ms, answer.watched_ms, answer.response_ms) == (
        4200,
        3000,
        4000,
    )
    assert (answer.reason, answer.note) == ("foot through the floor", "both")
    assert answer.confidence == 0.5
    assert answer.client == {"speed": 0.5, "kind": "new"}
    assert session.history(1)[0].answer == answer


@pytest.mark.parametrize(
    ("verdict", "kept"), [("left", "feet"), ("right_much", "feet"), ("equal", "")]
)
def test_what_decides_is_stored_with_a_preference(
    open_session: Open, clock: Clock, verdict: Verdict, kept: str
) -> None:
    session = open_session()
    shown(session)
    clock.advance(4.2)
    answer = say(session, verdict, why="feet").answer
    assert answer is not None
    assert answer.why == kept


def test_the_newest_round_comes_first_and_older_ones_stay(
    open_session: Open, store: AnswerStore
) -> None:
    """New pairs are asked next, without a restart; then nothing is left."""
    session = open_session()
    first = shown(session).pair
    store.add_pairs([make_pair(9, round=1)])
    assert shown(session).pair == first, "what is on the screen stays there"
    say(session)
    rounds = []
    while (question := session.current()) is not None:
        rounds.append(question.pair.round)
        say(session)
    assert rounds == [1, 0, 0]
    assert session.progress().open == 0
    store.add_pairs([make_pair(10, round=2)])
    assert shown(session).pair.round == 2


def test_a_reload_a_second_tab_and_a_restart_see_the_same(
    open_session: Open, store: AnswerStore, clock: Clock
) -> None:
    """Also the sides, a reopened answer and the history."""
    question = shown(open_session())
    assert shown(open_session()) == question
    session = open_session()
    assert say(session).accepted
    assert session.reopen(question.question_id).accepted
    reopened = shown(session)
    with AnswerStore.open(store.address) as restarted:
        rng = np.random.default_rng(5)
        after = RaterSession(restarted, "ada", cfg=session.cfg, rng=rng, now=clock)
        assert after.current() == reopened
        assert after.history() == session.history()


def test_one_question_has_one_answer(open_session: Open, store: AnswerStore) -> None:
    """Two tabs, a stale event, the same event again: the first one counts."""
    one, two = open_session(), open_session()
    question = shown(one)
    assert shown(two) == question
    judgement = Judgement(question_id=question.question_id, verdict="left")
    assert one.answer(judgement).accepted
    outcome = two.answer(judgement)
    assert not outcome.accepted
    assert outcome.reason == "This pair was answered in another window."
    shown(one)
    assert one.answer(judgement).reason == "This pair is not on the screen any more."
    assert store.count() == 1


def test_undo_goes_as_deep_as_wanted(open_session: Open, store: AnswerStore) -> None:
    """The questions come back one by one, sides as they were, and are asked anew."""
    session = open_session()
    asked = []
    for _ in range(3):
        asked.append(shown(session))
        say(session)
    for question in reversed(asked):
        outcome = session.undo()
        assert outcome.answer is not None
        assert outcome.answer.role == "undo"
        assert shown(session).pair == question.pair
        assert shown(session).shown_left == question.shown_left
    assert session.undo().reason == "There is nothing to undo."
    assert store.count() == 0
    assert len(store.unanswered()) == 3
    for question in asked:
        assert shown(session).pair == question.pair
        assert say(session, "right").accepted
    assert session.current() is None
    assert store.count() == 3
    assert store.query("SELECT count(*) FROM answer") == [(9,)], "nothing is deleted"


def test_an_earlier_answer_can_be_corrected(
    open_session: Open, store: AnswerStore
) -> None:
    """The new answer supersedes the old one; then the rater goes on where they were."""
    session = open_session()
    first = shown(session)
    say(session, "left_much")
    second = shown(session)
    assert session.reopen(first.question_id).accepted
    reopened = shown(session)
    assert (reopened.pair, reopened.shown_left) == (first.pair, first.shown_left)
    assert reopened.earlier == "left_much"
    assert store.count() == 1, "the old answer counts until there is a new one"
    correction = say(session, "right").answer
    assert correction is not None
    assert correction.supersedes == first.question_id
    assert shown(session) == second
    assert [past.verdict for past in session.history()] == ["right"]
    assert not session.reopen(first.question_id).accepted, "it is no longer current"


def test_a_reopened_answer_can_be_left_as_it_is(open_session: Open) -> None:
    """By closing it, by undo, or by reopening another one."""
    session = open_session()
    ids = []
    for _ in range(2):
        ids.append(shown(session).question_id)
        say(session, "equal")
    third = shown(session)
    assert not session.cancel().accepted, "nothing is reopened"
    for close in (session.cancel, session.undo):
        assert session.reopen(ids[0]).accepted
        assert session.reopen(ids[1]).accepted
        assert shown(session).corrects is not None
        assert close().accepted
        assert shown(session) == third
    assert [past.answer.answer_id for past in session.history()] == ids[::-1]


def test_only_own_answers_can_be_reopened(open_session: Open) -> None:
    """Neither another rater's nor what was never given."""
    ada, bob = open_session("ada"), open_session("bob")
    question = shown(ada)
    say(ada)
    assert not bob.reopen(question.question_id).accepted
    assert not bob.reopen("x").accepted
    assert not bob.undo().accepted


def test_a_correction_overtaken_elsewhere_disappears(
    open_session: Open, store: AnswerStore
) -> None:
    """A script corrected the answer while it was reopened here."""
    session = open_session()
    first = shown(session)
    given = say(session).answer
    assert given is not None
    session.reopen(first.question_id)
    reopened = shown(session)
    newer = replace(given, answer_id="x", supersedes=given.answer_id, note="checked")
    store.add_answer(newer)
    judgement = Judgement(question_id=reopened.question_id, verdict="right")
    assert session.answer(judgement).reason.startswith("This answer was changed")
    assert shown(session).corrects is None
    assert session.history()[0].answer == newer


def test_a_shown_pair_is_kept_from_others_until_its_lease_ends(
    open_session: Open, clock: Clock
) -> None:
    """A sign of life renews it; an empty chair does not."""
    ada, bob = open_session("ada"), open_session("bob")
    hers = shown(ada).pair
    assert shown(bob).pair != hers
    clock.advance(599)
    assert shown(ada).pair == hers
    clock.advance(599)
    eve = open_session("eve")
    assert shown(eve).pair not in (hers, shown(bob).pair)
    clock.advance(599)
    assert ada.current(active=False) is not None
    clock.advance(2)
    assert hers in [shown(open_session("cy")).pair, *ada.upcoming(3)]
    late = say(ada)
    assert late.accepted, "an answer that is there is never thrown away"


def test_whoever_comes_back_late_gets_another_pair(
    open_session: Open, clock: Clock
) -> None:
    """If somebody else has taken theirs; and theirs again if nobody has."""
    ada = open_session("ada")
    hers = shown(ada).pair
    clock.advance(601)
    assert shown(open_session("ada")).pair == hers
    clock.advance(601)
    assert shown(open_session("bob")).pair == hers
    assert shown(open_session("ada")).pair != hers


def test_overlapping_pairs_are_answered_by_two_people(
    open_session: Open, store: AnswerStore
) -> None:
    """And by no third; answers of a script do not count."""
    plan = PlanCfg(repeat_share=0.0, gold_share=0.0, overlap=Overlap(share=1.0))
    store.add_rater("script", "scripted")
    sessions = [open_session(name, plan) for name in ("ada", "bob", "cy")]
    assert shown(sessions[0]).pair == shown(sessions[1]).pair
    assert shown(sessions[0]).kind == "overlap"
    assert shown(sessions[2]).pair != shown(sessions[0]).pair
    for session in sessions * 9:
        if session.current() is not None:
            say(session)
    counts = Counter(pair.pair_id for pair, _ in store.current_answers())
    assert set(counts.values()) == {2}
    assert len(counts) == 3


def test_a_fifth_of_the_pairs_is_shared(open_session: Open, store: AnswerStore) -> None:
    """The same pairs for every rater and every server."""
    store.add_pairs(make_pair(number) for number in range(3, 60))
    plan = PlanCfg(repeat_share=0.0, gold_share=0.0)
    sessions = [open_session(name, plan) for name in ("ada", "bob")]
    for session in sessions * 60:
        if session.current() is not None:
            say(session)
    counts = Counter(pair.pair_id for pair, _ in store.current_answers())
    expected = {p.pair_id: 1 + plan.overlap.takes(p.pair_id) for p in store.pairs()}
    assert counts == expected
    assert 4 <= sum(expected.values()) - 60 <= 20


def test_own_pairs_come_back_with_the_sides_swapped(
    open_session: Open, store: AnswerStore
) -> None:
    """One of twenty, at least ten answers later, each at most once."""
    store.add_pairs(make_pair(number) for number in range(3, 200))
    session = open_session(plan=PlanCfg(gold_share=0.0, overlap=Overlap(share=0.0)))
    places: dict[str, int] = {}
    gaps = []
    for number in range(200):
        question = shown(session)
        answer = say(session, "left").answer
        assert answer is not None
        if question.kind == "repeat":
            assert answer.role == "repeat"
            gaps.append(number - places[question.pair.pair_id])
        else:
            assert question.pair.pair_id not in places
            places[question.pair.pair_id] = number
    assert 8 <= len(gaps) <= 10
    assert min(gaps) > 10
    sides = {"first": {}, "repeat": {}}
    for pair, answer in store.current_answers():
        sides[answer.role][pair.pair_id] = answer.shown_left
    for pair_id, side in sides["repeat"].items():
        assert side != sides["first"][pair_id]
    assert len(sides["repeat"]) == len(gaps)


def test_known_answers_are_mixed_in(open_session: Open, store: AnswerStore) -> None:
    """One of twenty, each once; and they alone keep nobody busy."""
    store.add_pairs(make_pair(number) for number in range(3, 100))
    gold = [make_pair(1000 + number, gold="a") for number in range(3)]
    store.add_pairs(gold)
    session = open_session(plan=PlanCfg(repeat_share=0.0, overlap=Overlap(share=0.0)))
    assert session.progress().total == 100
    kinds = Counter()
    while (question := session.current()) is not None:
        kinds[question.kind] += 1
        say(session)
    assert kinds == {"new": 100, "gold": 3}


@settings(deadline=None)
@given(st.text(min_size=1, max_size=8), st.integers(0, 50))
def test_every_block_of_twenty_has_one_repeat(rater_id: str, block: int) -> None:
    """And at most one known answer; at a place that differs between raters."""
    numbers = range(20 * block, 20 * block + 20)
    slots = Counter(slot(rater_id, number, PlanCfg()) for number in numbers)
    assert slots["repeat"] == 1
    assert slots["gold"] <= 1
    places = {
        next(n for n in numbers if slot(f"r{i}", n, PlanCfg()) == "repeat")
        for i in range(20)
    }
    assert len(places) > 5


def test_the_next_pairs_are_known_ahead(open_session: Open, store: AnswerStore) -> None:
    """Alone in the house, a rater is asked exactly what was foreseen."""
    store.add_pairs(make_pair(number) for number in range(3, 60))
    session = open_session(plan=PlanCfg())
    for _ in range(40):
        shown(session)
        (expected,) = session.upcoming(1)
        say(session)
        assert shown(session).pair == expected
    on_screen = shown(session).pair
    session.undo()
    assert session.upcoming(2)[0] == on_screen, "it comes next"


def test_progress_counts_what_is_left(open_session: Open) -> None:
    """For this rater; what another is looking at is not left."""
    ada, bob = open_session("ada"), open_session("bob")
    shown(bob)
    say(ada)
    found = ada.progress()
    assert (found.answered, found.open, found.total) == (1, 1, 3)


ACTIONS = st.lists(
    st.tuples(
        st.integers(0, 1),
        st.sampled_from(
            ["answer", "twice", "stale", "undo", "reopen", "cancel", "reload", "wait"]
        ),
    ),
    max_size=40,
)


@settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(actions=ACTIONS)
def test_no_answer_is_lost_or_doubled(
    tmp_path_factory: pytest.TempPathFactory, actions: list[tuple[int, str]]
) -> None:
    """Whatever two raters do in whatever order, the file says what they last said."""
    path = tmp_path_factory.mktemp("queue") / "preferences.sqlite"
    clock = Clock()
    names = ("ada", "bob")
    with AnswerStore.open(path) as store:
        store.query("PRAGMA synchronous = OFF")
        store.add_pairs(make_pair(number) for number in range(6))
        cfg = QueueCfg(plan=PlanCfg(repeat_gap=1), guard=NO_GUARD)

        def session_of(name: str) -> RaterSession:
            rng = np.random.default_rng(0)
            return RaterSession(store, name, cfg=cfg, rng=rng, now=clock)

        sessions = [session_of(name) for name in names]
        expected: list[dict[str, str]] = [{}, {}]
        stale = ["", ""]
        for who, action in actions:
            session, said = sessions[who], expected[who]
            clock.advance(1)
            match action:
                case "answer" | "twice":
                    question = session.current()
                    if question is None:
                        continue
                    stale[who] = question.question_id
                    judgement = Judgement(question_id=stale[who], verdict="left")
                    outcome = session.answer(judgement)
                    assert outcome.accepted
                    assert outcome.answer is not None
                    if question.corrects is not None:
                        del said[question.corrects.answer_id]
                    said[outcome.answer.answer_id] = question.pair.pair_id
                    if action == "twice":
                        assert not session.answer(judgement).accepted
                case "stale":
                    judgement = Judgement(question_id=stale[who], verdict="right")
                    session.current()
                    assert not session.answer(judgement).accepted
                case "undo":
                    retraction = session.undo().answer
                    if retraction is not None and retraction.supersedes is not None:
                        del said[retraction.supersedes]
                case "reopen":
                    for past in session.history()[-1:]:
                        assert session.reopen(past.answer.answer_id).accepted
                case "cancel":
                    session.cancel()
                case "reload":
                    before = session.current()
                    sessions[who] = session_of(names[who])
                    assert sessions[who].current() == before
                case "wait":
                    clock.advance(400)
        rows = store.current_answers()
        for who, name in enumerate(names):
            own = [answer for _, answer in rows if answer.rater_id == name]
            assert {a.answer_id: a.pair_id for a in own} == expected[who]
            asked = Counter((answer.pair_id, answer.role) for answer in own)
            assert set(asked.values()) <= {1}, "a pair is answered once in each role"


def work_of_answers(path: Path, pairs: int, answered: int) -> Counter[str]:
    """Instructions of SQLite, in tens, and lines of Python for answers of one rater,
    with all that the page asks beside."""
    connection = connect(path)
    connection.execute("PRAGMA synchronous = OFF")
    clips = [Clip(f"{n:064x}", 0, 50) for n in range(2 * int(pairs**0.5) + 2)]
    found: Counter[str] = Counter()

    def noted(frame: FrameType, event: str, argument: Any) -> Any:
        found[event] += 1
        return noted

    with AnswerStore(SqliteBackend(connection, path)) as store:
        names = [f"rater{n}" for n in range(8)]
        fill(store, clips, names, pairs=pairs, answered=answered)
        board = QuestionBoard(store, QUEUE.plan.overlap)
        board.follow()
        rng = np.random.default_rng(0)
        session = RaterSession(store, names[0], cfg=QUEUE, board=board, rng=rng)
        # As many as the page tells of.
        for _ in range(12):
            answer_once(session)
        connection.set_progress_handler(lambda: found.update(sql=1), 10)
        before = sys.gettrace()
        sys.settrace(noted)
        try:
            for _ in range(12):
                answer_once(session)
        finally:
            sys.settrace(before)
    return found


def test_an_answer_costs_the_same_however_many_pairs_there_are(tmp_path: Path) -> None:
    """And however many are answered. Work is counted: times are of the machine."""
    few = work_of_answers(tmp_path / "few.sqlite", 200, 0)
    for name, answered in (("many", 0), ("answered", 4_000)):
        many = work_of_answers(tmp_path / f"{name}.sqlite", 5_000, answered)
        for kind in ("sql", "call", "line"):
            assert 100 < many[kind] < 1.5 * few[kind], (name, kind)
