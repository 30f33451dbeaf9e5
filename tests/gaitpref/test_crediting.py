"""What moved a reward of teams, or of choices, about an answered pair."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.options import Options, bent, gain_per_answer
from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.errors import GaitprefError
from data.features import column
from gaitpref.cli.main import main
from gaitpref.cli.shared.next_of_answers import next_answers, next_fit, next_pairs
from gaitpref.options.choice_storage import REWARD_NAME, load_choices, save_choices
from gaitpref.options.gait_files import Gaits, load_gaits
from gaitpref.options.train_options import OptionsCfg, OptionsTraining
from gaitpref.report.answer_credit import answers_section, credited
from gaitpref.report.crediting import load_crediting
from gaitpref.report.page_pictures import answer_picture
from policy.env.course import CourseCfg, Obstacle
from policy.env.team_cfg import TeamCfg
from policy.options.choice_row import ChoiceReward, choice_names
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.team.team_record import TeamRecordCfg, record_team
from policy.team.team_start import as_team
from policy.training.checkpoint import load_policy
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.team.team_fit import fit_team, rows_in
from rewardmodel.team.team_storage import save_team
from tests.helpers.curves_of_reports import drawn
from tests.policy.test_team import any_reward

BAR = CourseCfg(
    obstacles=(Obstacle(kind="bar", start_m=0.7, length_m=0.3),), length_m=1.6
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Data sets of teams and of gaits that follow one another, and a reward of each."""
    place = tmp_path_factory.mktemp("credited")
    (place / "team.pt").write_bytes(as_team(WALK, TeamCfg()))
    teams = Dataset.create(place / "teams")
    cfg = TeamRecordCfg(episodes=8, episode_s=1.4, lazy_share=0.5, lazy_s=0.3)
    teams.add_episodes(record_team(load_policy(place / "team.pt"), cfg, seed=0))
    save_team(any_reward(), place / "team-reward")
    bent(WALK, place / "crouch.pt")
    training = OptionsTraining(
        gaits_in(place), OptionsCfg(course=BAR, envs=2), likes_all(("walk", "crouch"))
    )
    (place / "choose.pt").write_bytes(training.policy())
    chosen = Dataset.create(place / "chosen")
    shown = RecordCfg(episodes=6, episode_s=1.0, noisy_share=1.0)
    chosen.add_episodes(record(place / "choose.pt", shown, seed=1))
    save_choices(likes_all(("walk", "crouch")), place / "choice-reward")
    return place


def gaits_in(place: Path) -> Gaits:
    return load_gaits({"walk": WALK, "crouch": place / "crouch.pt"})


def likes_all(gaits: tuple[str, ...]) -> ChoiceReward:
    """A reward with weights drawn at random, of columns and of their squares."""
    names = choice_names(gaits)
    weights = np.random.default_rng(0).normal(size=(2, len(names))).round(3)
    weights[:, -1] /= 1000.0
    linear, square = (tuple(row.tolist()) for row in weights)
    return ChoiceReward(told="all", names=names, linear=linear, square=square, shift=3)


def asked(dataset: Dataset) -> tuple[Pair, Answer]:
    """Two clips, the first of which was shown on the right and preferred."""
    a, b = (Clip(e.sha256, 0, min(30, e.num_steps)) for e in dataset.entries()[:2])
    pair = Pair.make(a, b, strategy="uniform", round=0)
    answer = Answer(
        answer_id="00000000-0000-0000-0000-000000000001",
        pair_id=pair.pair_id,
        rater_id="ann",
        choice="a",
        shown_left="b",
        created_utc="2030-01-01T00:00:00.000+00:00",
    )
    return pair, answer


@pytest.mark.parametrize(
    ("shown", "reward", "row", "names"),
    [
        ("teams", "team-reward", "robot", {"robot 1", "robot 2"}),
        ("chosen", "choice-reward", "choice", {"walk", "crouch"}),
    ],
)
def test_every_row_adds_up_to_the_lead(
    place: Path, shown: str, reward: str, row: str, names: set[str]
) -> None:
    """Of the clip on the left, which is `b` here, over the other; and it is drawn."""
    dataset, model = Dataset.open(place / shown), load_crediting(place / reward)
    pair, answer = asked(dataset)
    found = credited(model, dataset, pair, answer).credit
    left, right = (model.side(dataset, clip).mean for clip in (pair.b, pair.a))
    assert found.lead == pytest.approx(left - right, abs=1e-4)
    assert abs(found.lead) > 0.01
    assert set(found.rows) == {"habit", row}
    for shares in found.rows.values():
        assert math.fsum(shares.values()) == pytest.approx(found.lead, abs=1e-3)
    assert set(found.rows[row]) <= names
    assert row == "choice" or set(found.rows[row]) == names
    picture = answer_picture(place / shown, place / reward, pair, answer)
    assert picture.startswith("<svg")
    assert all(name in picture for name in found.rows[row])


def test_a_gait_earns_nothing_by_running_longer(place: Path) -> None:
    """What both clips have alike, as a reward for every second, is nobody's."""
    dataset = Dataset.open(place / "chosen")
    pair, answer = asked(dataset)
    names = choice_names(("walk", "crouch"))
    flat = ChoiceReward(told="", names=names, linear=(0.0,) * len(names), shift=5.0)
    save_choices(flat, place / "flat")
    found = credited(load_crediting(place / "flat"), dataset, pair, answer).credit
    assert found.lead == 0.0
    assert all(share == 0.0 for share in found.rows["choice"].values())


def test_a_report_draws_whatever_reward_there_is(place: Path, tmp_path: Path) -> None:
    (tmp_path / "dataset").symlink_to(place / "teams")
    (tmp_path / "rounds" / "00").mkdir(parents=True)
    save_team(any_reward(), tmp_path / "rounds" / "00" / "reward")
    dataset = Dataset.open(tmp_path / "dataset")
    pair, answer = asked(dataset)
    with dataset.answers() as store:
        store.add_rater("ann", "human", {})
        store.add_pairs([pair])
        store.add_answer(replace(answer, why="feet"))
    with drawn():
        section = answers_section(tmp_path, [{"round": 0, "fit": {"answers": 1}}])
    assert "robot 1" in section
    assert "ann: B is better" in section
    assert "Of 1 answers that prefer a clip 1 say what decided: feet 1." in section
    given = ["--reward", str(place / "team-reward"), "--dataset", str(place / "teams")]
    assert (
        main(["explain", *given, "--count", "1", "--out", str(tmp_path / "why")]) == 0
    )
    told = json.loads((tmp_path / "why" / "explanation.json").read_text())
    (one,) = told["answers"]
    assert sum(one["by_robot"].values()) == pytest.approx(one["lead"], abs=1e-3)
    assert set(told["clips"][0]["ways"]) == {"moment", "habit", "robot"}
    page = (tmp_path / "why" / "index.html").read_text()
    assert page.count("<svg") == len(told["clips"]) + 1
    assert f"an answer of ann: A leads by {one['lead']:+.2f}" in page
    assert all(clip["clip"] in page for clip in told["clips"])
    assert "robot 1" in page


def test_a_reward_of_something_else_is_refused_in_one_line(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoilt = json.loads((place / "choice-reward" / REWARD_NAME).read_text())
    spoilt["linear"][0] = float("nan")
    (tmp_path / "spoilt").mkdir()
    (tmp_path / "spoilt" / REWARD_NAME).write_text(json.dumps(spoilt))
    for shown, reward, words in (
        ("chosen", place / "team-reward", "this reward is of teams of two"),
        ("teams", place / "choice-reward", "of the gaits none"),
        ("chosen", tmp_path / "spoilt", "a weight is no finite number"),
        ("chosen", tmp_path, "is missing"),
    ):
        args = ["--dataset", str(place / shown), "--reward", str(reward), "--no-auth"]
        assert main(["label", *args]) == 2, reward
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line
    save_choices(replace(likes_all(("walk",)), names=("walk:open",)), tmp_path)
    with pytest.raises(GaitprefError, match="none of a choice"):
        load_choices(tmp_path)


def test_what_comes_next_is_of_what_is_shown(place: Path) -> None:
    teams, chosen = (Dataset.open(place / name) for name in ("teams", "chosen"))
    assert "`gaitpref team answer --dataset" in next_answers(teams)
    assert "`gaitpref team fit --dataset" in next_fit(teams)
    assert "gaitpref answer" not in next_answers(teams) + next_answers(chosen)
    assert "--policy walk=FILE --policy crouch=FILE" in next_fit(chosen)
    assert next_pairs(chosen).endswith("--clip-s 1` chooses what to ask")


def test_it_does_not_matter_which_robot_of_a_team_fell(place: Path) -> None:
    """The second one falls, or the first: the same team got up to the same."""
    dataset = Dataset.open(place / "teams")
    given = ["--dataset", str(dataset.root)]
    assert main(["pairs", *given, "--count", "14", "--clip-s", "0.4"]) == 0
    assert main(["team", "answer", *given]) == 0
    pairs, rows = load_pairs([dataset]), rows_in([dataset])
    falls = column("fallen").start
    spoilt = {name for name, _ in pairs.episodes[:4]}

    def with_falls(robot: int):
        def read(sha256: str) -> np.ndarray:
            found = rows(sha256).copy()
            found[:, :, falls] = 0.0
            found[20:, robot, falls] = sha256 in spoilt
            return found

        return read

    first, second = (fit_team(pairs, with_falls(r), seed=0) for r in (0, 1))
    never = fit_team(pairs, rows, seed=0)
    torch.testing.assert_close(first.weights, second.weights, atol=1e-4, rtol=1e-3)
    assert not torch.allclose(first.weights, never.weights, atol=1e-3)


def test_answers_are_worth_something_at_both_levels(
    place: Path, tmp_path: Path
) -> None:
    """The part of the benchmark that compares them, small; its rows are kept."""
    files = {"walk": WALK, "crouch": place / "crouch.pt"}
    options = Options(
        policy=(),
        steps=160,
        joint_steps=192,
        envs=8,
        seeds=1,
        episodes=2,
        answers=(12,),
        episode_s=1.0,
        clips=RecordCfg(episodes=8, episode_s=1.0, noisy_share=1.0),
        course=BAR,
        results=tmp_path / "rows",
        work=tmp_path / "work",
    )
    figures = gain_per_answer(gaits_in(place), files, options)
    for level in ("choices", "joints"):
        gain = figures[f"{level}_12_gain"]
        assert isinstance(gain, float)
        assert figures[f"{level}_12_gain_per_answer"] == pytest.approx(gain / 12)
    assert gain_per_answer(gaits_in(place), files, options) == figures
