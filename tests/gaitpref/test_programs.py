"""Programs as raters: they see real clips, are asked with patience, are no people."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections import Counter
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from data.answers.answer_records import Answer, Choice, Pair, RaterKind
from data.answers.overlap import Overlap
from data.answers.question_board import QuestionBoard
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.features import column
from gaitpref.cli.main import main
from gaitpref.loop.presets import loop_cfg
from gaitpref.programs.chat import completion
from gaitpref.programs.program_answers import answer_by_program, program_rater
from gaitpref.programs.program_cfg import ProgramCfg, ProgramError, ReachCfg
from gaitpref.programs.program_trust import compared, require_teaching
from gaitpref.programs.seen_pair import seen_pair
from gaitpref.programs.vision_rater import MOST_ODD, agreed, answer_in
from labeling_ui.questions.rater_figures import human_rows
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from rewardmodel.answers.answered_pairs import count_evidence, load_pairs
from rewardmodel.answers.program_agreement import agreements
from rewardmodel.asking.clip_questions import ClipCfg, ask
from tests.helpers.own_lookers import always_left, fewer_feet_down
from tests.helpers.vision_server import Reply, completion_of, vision_server

LOOKERS = "tests.helpers.own_lookers"
NOW = "2030-01-31T12:00:00Z"
QUICK = ReachCfg(timeout_s=20.0, tries=1)


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clips of the walk that ships, with twelve pairs."""
    root = tmp_path_factory.mktemp("walks") / "set"
    dataset = Dataset.create(root)
    cfg = RecordCfg(episodes=16, episode_s=1.5)
    dataset.add_episodes(record(WALK, cfg, seed=3))
    with dataset.answers() as store:
        how: dict[str, Any] = {"model": None, "round_number": 0, "uniform_share": 1.0}
        rng = np.random.default_rng(0)
        entries = dataset.entries()
        cut = ClipCfg.of(1.2)
        store.add_pairs(
            ask(dataset, entries, cut, 12, known=[], strategy="uniform", rng=rng, **how)
        )
    return root


@pytest.fixture
def dataset(walks: Path, tmp_path: Path) -> Dataset:
    """A copy of the walks nobody answered yet."""
    shutil.copytree(walks, tmp_path / "set")
    return Dataset.open(tmp_path / "set")


def better(dataset: Dataset, pair: Pair) -> Choice:
    """The clip with fewer feet on the ground."""
    feet = column("foot_contact")
    a, b = (dataset.clip_features(c)[:, feet].mean() for c in (pair.a, pair.b))
    return "equal" if abs(a - b) < 1e-6 else "a" if a < b else "b"


def given(dataset: Dataset) -> list[tuple[Pair, Answer]]:
    with dataset.answers() as store:
        return store.current_answers()


def answered(dataset: Dataset, cfg: ProgramCfg, reach: ReachCfg = QUICK) -> int:
    return answer_by_program(dataset, program_rater(cfg, reach), cfg, seed=0)


def function(name: str) -> ProgramCfg:
    return ProgramCfg(name=f"{LOOKERS}:{name}")


def model(url: str, **settings: Any) -> ProgramCfg:
    return ProgramCfg(name=f"openai:{url}", model="eye", **settings)


def test_a_function_looks_at_both_clips_whichever_is_left(dataset: Dataset) -> None:
    cfg = function("fewer_feet_down")
    assert answered(dataset, cfg) == 12
    assert answered(dataset, cfg) == 0
    rows = given(dataset)
    assert {answer.shown_left for _, answer in rows} == {"a", "b"}
    assert [answer.choice for _, answer in rows] == [
        better(dataset, pair) for pair, _ in rows
    ]
    chosen = [answer for _, answer in rows if answer.choice != "equal"]
    assert len(chosen) > 8
    assert all(" against " in answer.note for answer in chosen)


def test_a_program_is_no_person(dataset: Dataset) -> None:
    """Nor does it keep a pair from people."""
    answered(dataset, function("always_left"))
    with dataset.answers() as store:
        assert set(store.raters().values()) == {"model"}
        assert human_rows(store) == []
        board = QuestionBoard(store, Overlap())
        store.add_rater("ann", "human")
        assert board.tally("ann", NOW).open == 12
        assert store.unanswered() == []
        assert len(store.unanswered(but_by="model")) == 12


def test_a_model_sees_pictures_in_both_orders(dataset: Dataset) -> None:
    """The server counts pixels of the pictures it decodes."""
    with vision_server() as (url, seen):
        cfg = model(url)
        assert answered(dataset, cfg) == 12
        # A pixel is less than a step, so where feet are equal, pixels say what they do.
        rows = [
            (answer.choice, wanted)
            for pair, answer in given(dataset)
            if (wanted := better(dataset, pair)) != "equal"
        ]
        assert len(rows) > 8
        assert all(choice == wanted for choice, wanted in rows)
        assert len(seen.bodies) == 24
        film, feet = (384, 1024, 3), (130, 850, 3)
        assert seen.shapes == 24 * [[film, feet, film, feet]]
        text = seen.bodies[0]["messages"][0]["content"][0]["text"]
        assert "forward 1.00 m/s" in text or "turning" in text
        with dataset.answers() as store:
            (found,) = compared(store)
    assert (found.asked_twice, found.turned) == (12, 0)
    assert (found.costs.questions, found.costs.tokens_in) == (24, 24_000)


def test_a_model_that_names_one_place_says_nothing(dataset: Dataset) -> None:
    with vision_server(lambda body: (200, {}, completion_of('{"better": "A"}'))) as at:
        answered(dataset, model(at[0]))
    assert Counter(answer.choice for _, answer in given(dataset)) == {"equal": 12}
    with dataset.answers() as store:
        assert compared(store)[0].turned == 12


def test_two_orders_come_to_one_answer() -> None:
    assert agreed("left", "left") == "left"
    assert agreed("left", "right") == "equal"
    assert agreed("equal", "right") == "equal"
    assert agreed("skip", "right") == "skip"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('{"better": "A", "why": "smooth"}', ("left", "smooth")),
        ('Well:\n```json\n{"better": "b"}\n```', ("right", "")),
        ('{"better": "unsure"}', ("skip", "")),
        ("Equal.", ("equal", "")),
        ("A is better than B", None),
        ('{"better": "A"} or {"better": "B"}', None),
        ('{"better": ["A"]}', None),
        ("", None),
        ("{" * 100_000, None),
    ],
)
def test_only_an_answer_is_taken_for_one(text: str, found: Any) -> None:
    assert answer_in(text) == found


def test_what_is_no_answer_is_skipped_with_its_words(dataset: Dataset) -> None:
    """And not asked for ever."""
    said: list[str] = []

    def reply(body: dict[str, Any]) -> Reply:
        said.append("As a robot I cannot\x07 judge." if len(said) > 1 else '{"better":')
        return 200, {}, completion_of(said[-1])

    with (
        vision_server(reply) as (url, _),
        pytest.raises(ProgramError, match="in a row"),
    ):
        answered(dataset, model(url))
    rows = given(dataset)
    assert len(said) == MOST_ODD + MOST_ODD % 2
    assert [answer.choice for _, answer in rows] == ["skip"] * (MOST_ODD // 2)
    assert rows[0][1].note == 'no answer: {"better":'
    assert rows[1][1].note == "no answer: As a robot I cannot judge."


BODY = {"model": "eye", "messages": [{"role": "user", "content": []}]}


def test_a_busy_server_is_asked_again_when_it_says(monkeypatch: Any) -> None:
    monkeypatch.setenv("RATER_KEY", "secret")
    replies = [(503, {}, b""), (429, {"Retry-After": "7"}, b""), (500, {}, b"")]
    slept: list[float] = []
    with vision_server(
        lambda body: replies.pop(0) if replies else (200, {}, completion_of("A"))
    ) as (url, seen):
        reach = ReachCfg(key_env="RATER_KEY", tries=4)
        found = completion(url, BODY, reach, sleep=slept.append)
    assert (found.text, found.tokens_in) == ("A", 1000)
    assert slept == [1.0, 7.0, 4.0]
    assert set(seen.keys) == {"Bearer secret"}


@pytest.mark.parametrize(
    ("reply", "told"),
    [
        ((401, {}, b'{"error": {"message": "bad key"}}'), "401 Unauthorized: bad key"),
        ((404, {}, b"<html>" * 9999), "refuses"),
        ((302, {"Location": "http://127.0.0.1:9/"}, b""), "refuses .302"),
        ((307, {"Location": "http://127.0.0.1:9/"}, b""), "refuses .307"),
        ((503, {}, b""), "asked once and gave no answer .503"),
        ((200, {}, b"<html>"), "no chat completion"),
        ((200, {}, b"[" * 200_000), "no chat completion"),
        ((200, {}, b'{"choices": []}'), "no chat completion .IndexError"),
        ((200, {}, completion_of("x").replace(b'"x"', b"7")), "content is a int"),
        ((200, {}, b" " * (2**20 + 1)), "more than 1,048,576 bytes"),
    ],
)
def test_what_a_server_must_not_say_is_told_in_one_line(
    reply: Reply, told: str
) -> None:
    with (
        vision_server(lambda body: reply) as (url, _),
        pytest.raises(ProgramError, match=told) as caught,
    ):
        completion(url, BODY, QUICK)
    assert "\n" not in str(caught.value)


def test_pictures_stay_on_this_machine() -> None:
    cfg = model("http://10.1.2.3/v1")
    with pytest.raises(ProgramError, match=r"another machine.*--beyond-loopback"):
        program_rater(cfg, QUICK)
    assert program_rater(cfg, replace(QUICK, beyond_loopback=True))


def test_a_key_is_nowhere_stored(dataset: Dataset, monkeypatch: Any) -> None:
    monkeypatch.setenv("GAITPREF_RATER_KEY", "sk-quite-secret")
    with vision_server() as (url, seen):
        answered(dataset, model(url))
        assert set(seen.keys) == {"Bearer sk-quite-secret"}
    for file in dataset.root.rglob("*"):
        assert not file.is_file() or b"quite-secret" not in file.read_bytes()


@pytest.mark.parametrize(
    ("name", "told"),
    [
        (f"{LOOKERS}:says_maybe", "gave 'maybe': an answer is left, right"),
        (f"{LOOKERS}:nobody", "cannot be imported.*nobody"),
        ("no_such_module:look", "cannot be imported.*no_such_module"),
        (f"{LOOKERS}:LOOKS", "cannot be imported"),
    ],
)
def test_a_function_that_is_no_rater(dataset: Dataset, name: str, told: str) -> None:
    with pytest.raises(ProgramError, match=told):
        answered(dataset, ProgramCfg(name=name))


def test_what_a_data_set_says_is_never_imported(
    dataset: Dataset, tmp_path: Path, monkeypatch: Any
) -> None:
    """Its raters name programs, whose names are words to everybody else."""
    ran = tmp_path / "ran"
    (tmp_path / "of_a_stranger.py").write_text(f"open({str(ran)!r}, 'w')")
    monkeypatch.syspath_prepend(str(tmp_path))
    answered(dataset, function("fewer_feet_down"))
    info = {"program": "of_a_stranger:look"}
    with dataset.answers() as store:
        store.add_rater("program:of_a_stranger:look", "model", info)
    root = str(dataset.root)
    assert main(["raters", "--dataset", root, "compare"]) == 0
    assert main(["fit", "--dataset", root, "--out", str(tmp_path / "reward")]) == 2
    assert not ran.exists()


def rows(
    said: dict[str, str], kinds: dict[str, RaterKind]
) -> list[tuple[Pair, Answer]]:
    """Answers of raters, a letter for each pair: a, b or e for equal."""
    words: dict[str, Choice] = {"a": "a", "b": "b", "e": "equal"}
    return [
        (
            Pair.make(
                Clip("0" * 64, number, 5), Clip("1" * 64, 0, 5), strategy="u", round=0
            ),
            Answer(
                answer_id=f"{name} {number}",
                pair_id=str(number),
                rater_id=name,
                choice=words[letter],
                shown_left="a",
                created_utc=NOW,
            ),
        )
        for name in kinds
        for number, letter in enumerate(said[name])
        if letter in words
    ]


@pytest.mark.parametrize(
    ("program", "person", "of", "share", "teaches"),
    [
        (30 * "a", 21 * "a" + 9 * "b", 30, 0.7, True),
        (30 * "a", 20 * "a" + 10 * "b", 30, 2 / 3, False),
        (29 * "a", 29 * "a", 29, 1.0, False),
        (30 * "a" + 9 * "e", 30 * "a" + 9 * "b", 30, 1.0, True),
        (30 * "e", 30 * "a", 0, None, False),
    ],
)
def test_a_program_teaches_where_it_agrees_with_people(
    program: str, person: str, of: int, share: float | None, teaches: bool
) -> None:
    kinds: dict[str, RaterKind] = {"eye": "model", "ann": "human", "sim": "scripted"}
    said = {"eye": program, "ann": person, "sim": 40 * "b"}
    pairs = [
        (replace(pair, pair_id=answer.pair_id), answer)
        for pair, answer in rows(said, kinds)
    ]
    found = agreements(pairs, kinds)["eye"]
    assert (found.of, found.share, found.teaches) == (of, share, teaches)


def test_a_fit_leaves_out_who_does_not_agree(dataset: Dataset, capsys: Any) -> None:
    answered(dataset, function("fewer_feet_down"))
    with dataset.answers() as store:
        assert count_evidence(store, dataset) == 0
        assert count_evidence(store, dataset, unchecked=True) > 8
    assert len(load_pairs([dataset], unchecked=True)) == 12
    fit = ["fit", "--dataset", str(dataset.root), "--out", str(dataset.root / "r")]
    assert main(fit) == 2
    assert "was never compared with people, 70%" in capsys.readouterr().err
    assert main([*fit, "--unchecked", "--model", "linear"]) == 0
    with pytest.raises(
        ProgramError, match=r"was never compared with people: .gaitpref"
    ):
        require_teaching(function("fewer_feet_down"))
    checked = replace(function("fewer_feet_down"), checked_on=str(dataset.root))
    with pytest.raises(ProgramError, match=r"never compared with people of .*set, 70%"):
        require_teaching(checked)
    require_teaching(replace(checked, unchecked=True))


def test_compare_shows_agreement_place_and_cost(dataset: Dataset, capsys: Any) -> None:
    answered(dataset, function("always_left"))
    with dataset.answers() as store:
        store.add_rater("ann", "human")
        for number, (pair, answer) in enumerate(store.current_answers()):
            theirs = replace(answer, answer_id=str(number), rater_id="ann", client={})
            assert theirs.choice in ("a", "b")
            other: Choice = "a" if theirs.choice == "b" else "b"
            choice = theirs.choice if number < 9 else other
            store.add_answer(replace(theirs, choice=choice, pair_id=pair.pair_id))
    assert main(["raters", "--dataset", str(dataset.root), "compare", "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["programs"]
    assert (found["agreement"]["agreed"], found["agreement"]["of"]) == (9, 12)
    assert not found["agreement"]["teaches"]
    assert (found["sides"]["left"], found["sides"]["right"]) == (12, 0)
    assert found["costs"]["questions"] == 12


def test_a_loop_takes_a_function_by_its_name() -> None:
    cfg = loop_cfg(rater=fewer_feet_down, unchecked=True)
    name = f"{LOOKERS}:fewer_feet_down"
    assert cfg.program == ProgramCfg(name=name, unchecked=True)
    assert loop_cfg(rater=name).program == ProgramCfg(name=name)
    assert cfg.wish is None
    with pytest.raises(ProgramError, match="cannot be imported by a name"):
        loop_cfg(rater=lambda pair: "left")


def test_the_store_says_what_a_program_is(dataset: Dataset) -> None:
    """For whoever reads it without the project."""
    answered(dataset, function("always_left"))
    with closing(sqlite3.connect(dataset.root / "preferences.sqlite")) as store:
        query = "SELECT kind, info_json FROM rater"
        ((kind, info),) = store.execute(query).fetchall()
    assert kind == "model"
    assert json.loads(info) == {"program": f"{LOOKERS}:{always_left.__name__}"}


def test_where_nothing_renders_a_program_sees_stick_figures(dataset: Dataset) -> None:
    """The tests draw nothing else: tests/conftest.py."""
    with dataset.answers() as store:
        pair = store.pairs()[0]
    clip = seen_pair(dataset, pair, "a").left
    assert len(clip.frames) == 8
    assert {frame.shape for frame in clip.frames} == {(192, 256, 3)}
    # Legs move from picture to picture, and lines are no blank page.
    assert len({frame.tobytes() for frame in clip.frames}) == 8
