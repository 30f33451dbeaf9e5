"""Policies against one another: strengths, what is asked next, and a whole arena."""

from __future__ import annotations

import json
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from data.answers.answer_records import Answer, now_utc
from data.datasets.dataset import Dataset
from gaitpref.arena.games import Answered
from gaitpref.arena.parts import of_command, of_rater, parts_of
from gaitpref.arena.strengths import (
    Match,
    Ranking,
    least_sure,
    ranking_of,
    strengths_of,
)
from gaitpref.cli.main import main
from gaitpref.console import progress
from policy.robots.shipped import WALK
from tests.helpers.older_run import older_run

TRUE = np.array([0.8, 0.0, -0.8])
"""Strengths of three players, logits."""


def drawn(rng: np.random.Generator, each: int) -> list[Match]:
    """So many answers about every two of the three."""
    found = []
    for first, second in combinations(range(3), 2):
        share = 1 / (1 + np.exp(TRUE[second] - TRUE[first]))
        for number in range(each):
            score = float(rng.random() < share)
            question = f"{first}-{second}-{number}"
            found.append(
                Match(first=first, second=second, score=score, question=question)
            )
    return found


def test_two_players_are_as_far_apart_as_their_wins_say() -> None:
    """Of 100 answers 73 are one logit apart, but for the weak prior."""
    wins = np.array([[0.0, 73.1], [26.9, 0.0]])
    theta = strengths_of(wins)
    assert theta[0] - theta[1] == pytest.approx(1.0, abs=0.01)
    assert theta.sum() == pytest.approx(0.0)


def test_a_tie_is_half_a_win() -> None:
    ties = [Match(first=0, second=1, score=0.5, question=str(n)) for n in range(9)]
    found = ranking_of(ties, 2, np.random.default_rng(0))
    assert found.strengths == pytest.approx([0.0, 0.0])
    assert not found.is_sure


def test_who_always_wins_is_not_infinitely_strong() -> None:
    won = [Match(first=0, second=1, score=1.0, question=str(n)) for n in range(20)]
    found = ranking_of(won, 2, np.random.default_rng(0))
    assert found.order == (0, 1)
    assert found.is_sure
    assert 2 < found.strengths[0] - found.strengths[1] < 20


def test_three_wins_of_three_are_not_sure() -> None:
    """An equal player has them in one of eight cases."""
    won = [Match(first=0, second=1, score=1.0, question=str(n)) for n in range(3)]
    found = ranking_of(won, 2, np.random.default_rng(0))
    assert 0.5 < found.kept[0] < 0.95
    assert found.low[0] < 0 < found.high[0]


def test_intervals_hold_what_is_true() -> None:
    """Of 200 draws, 90 to 99 in a hundred intervals of each player."""
    rng = np.random.default_rng(1)
    held = np.zeros(3)
    for _ in range(200):
        found = ranking_of(drawn(rng, 30), 3, rng, resamples=300)
        held += (found.low <= TRUE) & (found.high >= TRUE)
    assert ((held / 200 >= 0.90) & (held / 200 <= 0.99)).all(), held


def test_the_next_question_is_about_whom_the_order_is_most_open() -> None:
    ranking = Ranking(
        strengths=np.array([1.0, 0.1, 0.0, -2.0]),
        low=np.zeros(4),
        high=np.zeros(4),
        order=(0, 1, 2, 3),
        kept=(0.96, 0.6, 0.9),
    )
    often = [
        Match(first=a, second=b, score=1.0, question=f"{a}{n}")
        for a, b in ((0, 1), (1, 2), (2, 3))
        for n in range(3)
    ]
    assert least_sure(ranking, often, at_least=3) == (1, 2)
    # Who hardly met comes first, however sure the order looks.
    assert least_sure(ranking, often[1:], at_least=3) == (0, 1)


def said(rater: str, command: tuple[float, ...], wins: int, of: int) -> list[Answered]:
    """Answers of one rater about one command: so many prefer player 0 to player 1."""
    return [
        Answered(
            match=Match(
                first=0,
                second=1,
                score=float(number < wins),
                question=f"{rater}{command}{number}",
            ),
            rater=rater,
            command=command,
            note="",
        )
        for number in range(of)
    ]


def test_what_one_command_says_is_not_lost_in_the_whole() -> None:
    """Who is better straight ahead and worse in a turn is neither on the whole."""
    ahead, turn = (1.0, 0.0, 0.0), (0.65, 0.0, 0.4)
    answers = said("ann", ahead, 18, 20) + said("bob", turn, 2, 20)
    whole = ranking_of([each.match for each in answers], 2, np.random.default_rng(0))
    assert whole.low[0] < 0 < whole.high[0]
    for by, best, worst in ((of_command, ahead, turn), (of_rater, "ann", "bob")):
        parts = {part.about: part for part in parts_of(answers, by)}
        good, bad = parts[best].shares[0], parts[worst].shares[0]
        assert good.interval is not None
        assert bad.interval is not None
        assert good.interval[0] > 0 > bad.interval[1]
        assert parts[best].shares[1].interval == pytest.approx(
            (-good.interval[1], -good.interval[0]), abs=0.2
        )
        assert (good.preferred, good.answers) == (0.9, 20)


def test_of_few_questions_no_strength_is_told() -> None:
    """Also where many answered each of them: these hang together."""
    (part,) = parts_of(said("ann", (1.0, 0.0, 0.0), 7, 7) * 3, of_rater)
    assert part.answers == 21
    assert part.shares[0].preferred == 1.0
    assert part.shares[0].strength is part.shares[0].interval is None
    (part,) = parts_of(said("ann", (1.0, 0.0, 0.0), 8, 8), of_rater)
    assert part.shares[0].strength is not None


def test_intervals_of_small_parts_hold_what_is_true() -> None:
    """Three players, eight questions about each two: at least 90 in a hundred."""
    rng = np.random.default_rng(2)
    held = np.zeros(3)
    for _ in range(100):
        answers = [
            Answered(match=match, rater="ann", command=(1.0, 0.0, 0.0), note="")
            for match in drawn(rng, 8)
        ]
        (part,) = parts_of(answers, of_rater)
        ends = np.array([part.shares[player].interval for player in range(3)])
        held += (ends[:, 0] <= TRUE) & (ends[:, 1] >= TRUE)
    assert (held >= 90).all(), held


@pytest.fixture(scope="module")
def policies(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The walk that ships and one of a few hundred steps."""
    run = older_run(tmp_path_factory.mktemp("older") / "run")
    weak = run / "rounds" / "00" / "policy" / "policy.pt"
    return ["--policy", f"walk={WALK}", "--policy", f"weak={weak}"]


def test_an_arena_goes_on_until_the_order_is_sure(
    policies: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(progress, "_QUIET_S", 0.0)
    out = tmp_path / "arena"
    line = ["arena", "--out", str(out), *policies, "--episodes", "5"]
    assert main([*line, "--criterion", "task"]) == 0
    said = capsys.readouterr().err
    steps = re.findall(r"recording, steps: ([\d,]+) of 600, .* left", said)
    # Both policies: what tells of the second goes on behind the first.
    assert steps[0] == "1"
    assert steps[300] == "301"
    assert "next: `gaitpref play --policy" in said
    found = json.loads((out / "ranking.json").read_text())
    assert found["sure"]
    assert [player["name"] for player in found["players"]] == ["walk", "weak"]
    assert 3 <= len(found["answers"]) <= 60
    wins = np.array(found["wins"]["row_preferred_to_column"])
    assert found["wins"]["players"] == ["walk", "weak"]
    assert wins.sum() == len(found["answers"])
    assert wins[0, 1] > wins[1, 0]
    (rater,) = found["by_rater"]
    assert rater["rater"] == "simulated:task"
    assert rater["answers"] == sum(part["answers"] for part in found["by_command"])
    walk = rater["players"][0]
    assert walk["preferred"] == wins[0, 1] / wins.sum()
    # Eight questions settle it, or fewer; then no strength of a part is told.
    assert (walk["strength"] is None) == (len(found["answers"]) < 8)
    page = (out / "index.html").read_text()
    assert f"preferred in {walk['preferred']:.0%} of {walk['answers']}" in page
    assert ("too few for a strength" in page) == (
        any(
            player["strength"] is None
            for part in (*found["by_command"], rater)
            for player in part["players"]
        )
    )
    assert "walk &gt; weak, sure" in (out / "index.html").read_text()
    # The answers are ordinary ones, and once more asks nothing.
    with Dataset.open(out / "dataset").answers() as store:
        asked = store.pairs()
        assert len(store.current_answers()) == len(asked) == len(found["answers"])
    assert main([*line, "--criterion", "task"]) == 0
    assert json.loads((out / "ranking.json").read_text()) == found


def test_people_are_asked_a_few_at_a_time(
    policies: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "arena"
    line = ["arena", "--out", str(out), *policies, "--episodes", "5", "--most", "8"]
    dataset = str(out / "dataset")
    open_questions = []
    for _ in range(3):
        assert main(line) == 0
        with Dataset.open(out / "dataset").answers() as store:
            open_questions.append(len(store.pairs()) - len(store.current_answers()))
        # A person, played by a program.
        assert main(["answer", "--dataset", dataset, "--criterion", "crouch"]) == 0
    assert open_questions[0] == 6
    assert sum(open_questions) <= 8
    assert "gaitpref label --dataset" in capsys.readouterr().out


def test_what_is_no_arena_is_said(
    policies: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "arena")]
    weak = policies[3].partition("=")[2]
    for more, said in (
        (policies[:2], "two policies or more"),
        (["--policy", str(WALK), *policies[:2]], "NAME=FILE"),
        ([*policies, "--policy", f"same={weak}"], "the same policy"),
        ([*policies, "--policy", "walk=nothing.pt"], "nothing.pt"),
    ):
        assert main(["arena", *out, *more]) == 2
        assert said in capsys.readouterr().err
    line = ["arena", *out, *policies, "--most", "1", "--episodes", "5"]
    assert main(line) == 0
    with Dataset.open(tmp_path / "arena/dataset").answers() as store:
        (pair,) = store.unanswered()
        store.add_rater("ann", "human")
        equal = Answer(
            answer_id="first",
            pair_id=pair.pair_id,
            rater_id="ann",
            choice="equal",
            shown_left="a",
            created_utc=now_utc(),
        )
        store.add_answer(equal)
    assert main(line) == 0
    assert "the same command with `--most 2` asks on" in capsys.readouterr().err
    assert main([*line[:-1], "10"]) == 2
    assert "another --out" in capsys.readouterr().err
