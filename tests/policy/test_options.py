"""Gaits chosen by what is ahead: their worth, when they end, on a real course."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmarks.options import bent
from data.datasets.dataset import Dataset
from data.datasets.segments import Segments, TableAnswer
from data.episodes.choices import choices_of, told_choices
from data.episodes.clips import Clip
from data.errors import GaitprefError
from gaitpref.cli.main import main
from gaitpref.film.shot import shot_of
from gaitpref.options.choice_clips import rows_of_episode
from gaitpref.options.choice_explained import OfChoices
from gaitpref.options.choice_fit import as_reward, fit_choices
from gaitpref.options.choice_rater import answer_choices, wisher_of
from gaitpref.options.choice_sets import Asked, course_of
from gaitpref.options.choice_storage import load_choices
from gaitpref.options.gait_files import Gaits, load_gaits, named_files
from gaitpref.options.measure import alone, measure
from gaitpref.options.train_options import (
    OptionsCfg,
    OptionsTraining,
    train_options,
)
from labeling_ui.page.footfall_svg import footfalls
from labeling_ui.scene.clip_motion import load_motion
from policy.env.course import CourseCfg, Lane, Obstacle, course_heights, stands_on
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import CommandCfg
from policy.env.team_cfg import TeamCfg
from policy.options.choice_row import (
    CHANGES,
    PROGRESS,
    TASK,
    ChoiceReward,
    choice_names,
    written_reward,
)
from policy.options.choosing import (
    ChoosingCfg,
    Draws,
    Running,
    Termination,
    choose,
    ran,
)
from policy.options.smdp import targets, termination_loss, upon_arrival
from policy.robots.hints import RobotError
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.team.team_start import as_team
from policy.training.checkpoint import PolicyError, load_policy, read_plain
from rewardmodel.fitting.tables import fit_table
from tests.helpers.retold_policies import heavier, restless, slower

BAR = CourseCfg(
    obstacles=(Obstacle(kind="bar", start_m=0.7, length_m=0.3),), length_m=1.6
)
GAMMA = 0.9


@pytest.fixture(scope="module")
def gaits(tmp_path_factory: pytest.TempPathFactory) -> Gaits:
    folder = tmp_path_factory.mktemp("gaits")
    return load_gaits({"walk": WALK, "crouch": bent(WALK, folder / "crouch.pt")})


@pytest.fixture(scope="module")
def chosen(gaits: Gaits, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy that chooses, as a training of a few looks leaves it."""
    out = tmp_path_factory.mktemp("chosen")
    assert train_options(out, gaits, small(steps=640), task_of(gaits))
    return out / "policy.pt"


def small(**changes: int) -> OptionsCfg:
    return replace(OptionsCfg(course=BAR, envs=16, seed=3), **changes)


def task_of(gaits: Gaits):
    return written_reward(TASK, gaits.names, "task")


def values_of_chain(gamma_of: object) -> Tensor:
    """Values [2] of a state whose gaits lead back to it: `short` pays 1 for one step,
    `long` pays nothing in three and then 3.2.

    By hand, for good: short alone is worth 1 / (1 - 0.9) = 10. Long is worth
    0.81 * 3.2 + 0.729 * 10 = 9.882 before short, so short is the better one.
    """
    paid = torch.tensor([1.0, 3.2 * GAMMA**2])
    steps = torch.tensor([1, 3])
    waits = steps if gamma_of == "steps" else torch.ones_like(steps)
    q = torch.zeros(2)
    nobody = torch.zeros(2, dtype=torch.bool)
    for _ in range(400):
        arrived = upon_arrival(q.repeat(2, 1), torch.arange(2), torch.ones(2), cost=0.0)
        q = targets(paid, waits, arrived, nobody, gamma=GAMMA)
    return q


def test_a_gait_of_k_steps_discounts_by_gamma_to_the_k() -> None:
    short, long = values_of_chain("steps").tolist()
    assert short == pytest.approx(10.0, abs=1e-4)
    assert long == pytest.approx(0.81 * 3.2 + 0.729 * 10.0, abs=1e-4)


def test_a_discount_of_one_step_would_choose_the_wrong_gait() -> None:
    """What the line above guards against is seen: the long gait wins."""
    short, long = values_of_chain("one").tolist()
    assert long == pytest.approx(0.81 * 3.2 / (1 - GAMMA), abs=1e-3)
    assert long > short + 1.0


def test_what_is_collected_and_learned_is_discounted_by_the_control_step(
    gaits: Gaits,
) -> None:
    """Of one a step paid for k steps, (1 - gamma^k) / (1 - gamma) is collected, and
    what comes then counts gamma^k in what is learned."""
    names = choice_names(gaits.names)
    per_second = 1.0 / gaits.env.control_dt_s
    level = ChoiceReward(
        told="one a step", names=names, linear=(0.0,) * len(names), shift=per_second
    )
    training = OptionsTraining(gaits, small(), level)
    gamma = training.cfg.learner.gamma
    found = training.collector.collect(120).transitions
    kept = found.rows(~found.over)
    assert len(kept) > 16
    assert int(kept.steps.max()) >= 10
    share = gamma ** kept.steps.double()
    assert kept.paid.double().numpy() == pytest.approx(
        ((1 - share) / (1 - gamma)).numpy(), rel=1e-4
    )
    later, _ = training.learner._wanted(kept)
    at_once, _ = training.learner._wanted(
        replace(kept, steps=torch.zeros_like(kept.steps))
    )
    assert (later - kept.paid).detach().double().numpy() == pytest.approx(
        (share * (at_once - kept.paid).detach()).numpy(), abs=1e-4
    )


def test_what_may_end_is_worth_a_share_of_going_on_and_of_the_best() -> None:
    """0.75 * 2 + 0.25 * max(2, 5 - 1) where a change costs 1; nothing after a fall."""
    q, running = torch.tensor([[2.0, 5.0]]), torch.tensor([0])
    value = upon_arrival(q, running, torch.tensor([0.25]), cost=1.0)
    assert value.item() == pytest.approx(2.5)
    fell = targets(
        torch.ones(1), torch.tensor([4]), value, torch.tensor([True]), gamma=GAMMA
    )
    assert fell.item() == 1.0


@pytest.mark.parametrize(("other", "rises"), [(5.0, True), (2.5, False)])
def test_ends_become_likelier_where_another_gait_is_worth_the_change(
    other: float, rises: bool
) -> None:
    ends = torch.tensor([0.5], requires_grad=True)
    loss = termination_loss(
        ends, torch.tensor([[2.0, other]]), torch.tensor([0]), cost=1.0
    )
    loss.backward()
    assert ends.grad is not None
    assert (ends.grad.item() < 0) == rises


def gaits_over_time(cfg: ChoosingCfg, lead: float, steps: int) -> list[int]:
    """The gait of each step where gait 1 leads by `lead` from step 10 on."""
    running, found = Running.nothing(1), []
    for step in range(steps):
        q = torch.tensor([[1.0, 0.0 if step < 10 else 1.0 + lead]])
        running = choose(
            running,
            q,
            torch.zeros(1, 2),
            torch.tensor([step == 0]),
            cfg,
            control_dt_s=0.02,
            draws=Draws.none(torch.zeros(1, 1)),
        )
        found.append(int(running.gait))
        running = ran(running)
    return found


def test_a_gait_runs_its_length_unless_it_is_interrupted() -> None:
    fixed = ChoosingCfg(termination="fixed", length_s=1.0, change_cost=0.1)
    assert gaits_over_time(fixed, 1.0, 60) == [0] * 50 + [1] * 10
    # Looks are 10 steps apart; a lead of 0.9 after the cost is above the margin.
    cut = replace(fixed, interrupt_margin=0.5)
    assert gaits_over_time(cut, 1.0, 60) == [0] * 10 + [1] * 50
    assert gaits_over_time(cut, 0.5, 50) == [0] * 50


def test_what_is_ahead_is_told_by_kind_and_distance() -> None:
    """A bar from 0.7 to 1.0 m is reached 0.3 m before and left 0.3 m behind it."""
    lane = Lane(BAR, torch.device("cpu"))
    ahead = lane.ahead(torch.tensor([-1.2, 0.0, 0.7, 1.4]), torch.zeros(4))
    assert ahead[:, 2].tolist() == [0.0, 1.0, 1.0, 0.0]
    torch.testing.assert_close(ahead[:, 3], torch.tensor([1.5, 0.4, 0.0, 1.5]))
    torch.testing.assert_close(ahead[:, 4], torch.tensor([1.5, 1.3, 0.6, 1.5]))


def test_steps_go_up_and_down_again() -> None:
    steps = Obstacle(kind="steps", start_m=1.0, length_m=2.0)
    cfg = CourseCfg(obstacles=(steps,), length_m=4.0)
    heights = course_heights(cfg)
    assert heights.max() == pytest.approx(3 * cfg.step_m)
    assert heights[0] == heights[-1] == 0.0


def test_a_walk_is_stopped_by_the_bar_that_a_crouch_passes_below(gaits: Gaits) -> None:
    """In real physics; to bump is no fall."""
    env_cfg = replace(gaits.env, course=BAR, episode_s=5.0)
    for policy, passes in zip(gaits.policies, (False, True), strict=True):
        env = QuadrupedEnv(gaits.robot, env_cfg, 2, seed=0, keep_final=True)
        env.fix_commands(torch.tensor([[0.6, 0.0, 0.0]] * 2))
        farthest, fell = torch.zeros(2), False
        for _ in range(env_cfg.episode_steps - 1):
            action = policy(env.get_observations()["policy"][:, :48])
            extras = env.step(action)[3]
            fell |= bool(extras["fallen"].any())
            farthest = farthest.maximum(extras["final"][0][:, 0].float())
        assert not fell
        assert bool((farthest > 1.2).all()) == passes


def test_who_finishes_is_paid_on_by_a_reward_without_a_level(gaits: Gaits) -> None:
    """Answers tell no level: one point a second is worth the whole time to who is
    through before, and what they stood to who falls. Metres end where the way does."""
    slope = Obstacle(kind="slope", start_m=0.6, length_m=0.1)
    course = CourseCfg(obstacles=(slope,), length_m=1.0, slope_rad=0.1)
    asked = CommandCfg(
        forward_m_s=(0.8, 0.8), left_m_s=(0.0, 0.0), yaw_rad_s=(0.0, 0.0)
    )
    env_cfg = replace(gaits.env, course=course, commands=asked, episode_s=3.0)
    metres = written_reward({PROGRESS: 1.0}, gaits.names, "metres")
    level = replace(metres, linear=(0.0,) * len(metres.names), shift=1.0)

    def falls(obs: Tensor) -> tuple[Tensor, Tensor]:
        act, gait = alone(gaits, 0)(obs)
        return act * 0.0 + torch.tensor([3.0, 3.0, 3.0] * 4), gait

    of_level, of_metres, fallen = (
        measure("way", act, gaits, env_cfg, reward, episodes=2, seed=0)
        for act, reward in (
            (alone(gaits, 0), level),
            (alone(gaits, 0), metres),
            (falls, level),
        )
    )
    assert of_level.finished == of_metres.finished == 2
    assert of_level.seconds < 2.5
    assert of_level.reward == pytest.approx(3.0, abs=1e-4)
    assert of_metres.reward == pytest.approx(of_metres.metres, abs=1e-4)
    assert (fallen.falls, fallen.finished) == (2, 0)
    assert fallen.reward == pytest.approx(fallen.seconds, abs=1e-4)
    assert fallen.seconds < 2.5


def test_a_policy_that_chooses_is_recorded_with_what_ran(
    chosen: Path, tmp_path: Path
) -> None:
    """And what a rater is asked about can be computed from the episode alone; the page
    and a film write over a clip which gait runs when."""
    cfg = RecordCfg(episodes=2, episode_s=1.5, noisy_share=1.0)
    episode, other = record(chosen, cfg, seed=0)
    said = choices_of(episode.meta.extra, episode.num_steps)
    assert said is not None
    assert said.names == ("walk", "crouch")
    assert not np.array_equal(
        said.gait,
        choices_of(other.meta.extra, other.num_steps).gait,  # type: ignore[union-attr]
    )
    rows = rows_of_episode(episode, said.names)
    # Each step is of one gait at one place, and says how far it came.
    np.testing.assert_array_equal(rows[:, :8].sum(axis=1), 1.0)
    np.testing.assert_array_equal(rows[:, 4:8].sum(axis=1), said.gait)
    moved = episode.qpos[-1, 0] - episode.qpos[0, 0]
    assert rows[:, -2].sum() * 0.02 == pytest.approx(moved, abs=1e-4)
    dataset = Dataset.create(tmp_path / "set")
    entry, _ = dataset.add_episodes([episode, other])
    clip = Clip(entry.sha256, 5, 45)
    ran_there = [said.names[gait] for gait in said.gait[clip.rows]]
    assert set(ran_there) == set(said.names)
    motion = load_motion(dataset, clip)
    told = [name for name, a, b in motion.gaits for _ in range(a, b)]
    assert told == ran_there
    page = footfalls(motion, motion, motion.duration_s)
    for name, first, last in motion.gaits:
        share = 100 / clip.steps
        place = f"left:{first * share:.2f}%;width:{(last - first) * share:.2f}%"
        assert len(re.findall(f'"{name}" style="{place}[^>]*>{name}<', page)) == 2
    captions = shot_of(episode, clip, caption="it").captions(50.0, clip.steps)
    assert captions == [f"it  {name}" for name in ran_there]
    assert main(["pairs", "--dataset", str(dataset.root), "--count", "1"]) == 0
    with dataset.answers() as store:
        assert len(store.pairs()) == 1


def test_a_wish_about_choices_is_fitted_from_answers(
    chosen: Path, tmp_path: Path
) -> None:
    """Whoever dislikes changes pays for them, and for nothing of another sign."""
    dataset = Dataset.create(tmp_path / "set")
    cfg = RecordCfg(episodes=16, episode_s=2.0, noisy_share=1.0)
    dataset.add_episodes(record(chosen, cfg, seed=1))
    names = ("walk", "crouch")
    wish = {"changes_per_s": -1.0}
    assert answer_choices(dataset, names, wish, count=60, seed=0) == 60
    # A run that goes on asks nothing twice.
    assert answer_choices(dataset, names, wish, count=60, seed=0) == 0
    reward, report = fit_choices(dataset, names, seed=0)
    assert report.held_out_accuracy is None or report.held_out_accuracy > 0.5
    assert reward.change_cost(0.02) > 0.2
    rows = torch.zeros(1, len(reward.names))
    changes = rows.clone()
    changes[0, reward.names.index("changes_per_s")] = 50.0
    cost = (reward(rows) - reward(changes)) * 0.02
    assert cost.item() == pytest.approx(reward.change_cost(0.02), rel=1e-4)


def test_what_is_paid_is_what_was_fitted() -> None:
    """To the columns that are rare, and so far from their mean, too."""
    rng = np.random.default_rng(0)
    names = choice_names(("walk", "crouch"))
    rows = np.zeros((60, 100, len(names)), dtype=np.float32)
    rows[..., names.index("progress_m_s")] = rng.normal(0.6, 0.2, rows.shape[:2])
    changes = names.index("changes_per_s")
    rows[..., changes] = 50.0 * (rng.random(rows.shape[:2]) < rng.random((60, 1)) / 50)
    segments = Segments(ids=tuple(map(str, range(60))), names=names, rows=rows)
    wish = written_reward(
        {"progress_m_s": 1.0, "changes_per_s": -0.5}, ("walk", "crouch"), ""
    )
    true = wish(torch.from_numpy(rows)).mean(dim=1)
    answers = [
        TableAnswer(left=a, right=b, target=float(true[a] > true[b]), rater="ann")
        for a, b in rng.choice(60, (80, 2)).tolist()
        if a != b
    ]
    fitted = fit_table(segments, answers, "linear", seed=0, unbounded=True)
    paid = as_reward(fitted, segments, "")(torch.from_numpy(rows)).mean(dim=1)
    alike = np.corrcoef(paid.numpy(), fitted.worth(segments)[0].numpy())[0, 1]
    assert alike > 0.9999
    assert np.corrcoef(paid.numpy(), true.numpy())[0, 1] > 0.9


def test_another_wish_is_another_rater(chosen: Path, tmp_path: Path) -> None:
    """Its answers are its own, and those of an episode that is gone teach nothing."""
    dataset = Dataset.create(tmp_path / "set")
    cfg = RecordCfg(episodes=12, episode_s=2.0, noisy_share=1.0)
    entries = dataset.add_episodes(record(chosen, cfg, seed=1))
    names = ("walk", "crouch")
    wishes = ({"changes_per_s": -1.0}, {"changes_per_s": 1.0})
    costs = []
    for wish in wishes:
        assert answer_choices(dataset, names, wish, count=50, seed=0) == 50
        rater_id = wisher_of(wish)
        reward, _ = fit_choices(dataset, names, seed=0, rater_id=rater_id)
        costs.append(reward.linear[reward.names.index("changes_per_s")])
    assert costs[0] < 0 < costs[1]
    smaller = Dataset.create(tmp_path / "smaller")
    smaller.add_from(dataset, [entry.sha256 for entry in entries[1:]])
    with dataset.answers() as store, smaller.answers() as copy:
        for rater_id, kind, info in store.rater_rows():
            copy.add_rater(rater_id, kind, info)
        copy.add_pairs(store.pairs())
        for _, answer in store.all_answers():
            copy.add_answer(answer)
    reward, report = fit_choices(smaller, names, seed=0, rater_id=wisher_of(wishes[0]))
    assert report.answers < 50
    assert reward.told == f"{report.answers} answers"


@pytest.mark.parametrize("name", ["length_s", "interrupt_margin"])
@pytest.mark.parametrize("value", [float("inf"), float("nan")])
def test_no_time_is_endless(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        replace(ChoosingCfg(), **{name: value})


@pytest.mark.parametrize("slope_rad", [1.6, float("inf"), float("nan")])
def test_a_slope_is_one(slope_rad: float) -> None:
    with pytest.raises(RobotError, match=r"slope_rad must lie in \(0, 1\]"):
        CourseCfg(slope_rad=slope_rad)


def test_the_command_says_what_is_wrong_in_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = ["--out", str(tmp_path / "out")]
    both = ["--policy", f"a={WALK}", "--policy", f"b={WALK}"]
    for given, said in (
        ([f"--policy=walk={WALK}"], "leave nothing to choose"),
        (["--policy", "walk", "--policy", f"b={WALK}"], "give NAME=FILE"),
        ([*both, "--wish", "speed=1"], "no column 'speed'; there are: a:open"),
        ([*both, "--wish", "power_w=much"], "give NAME=NUMBER"),
        ([*both, "--bar-m", "0.1"], "raise bar_m to at least"),
        ([*both, "--step-m", "0.2"], "lower step_m to at most"),
        ([*both, "--policy", f"b={WALK}"], "'b' is there twice"),
        ([*both, "--speed-m-s", "3"], "must lie in [0.1, 2], got 3"),
        ([*both, "--dataset", "set", "--wish", "power_w=-1"], "are two raters"),
        ([*both, "--slope-rad", "0.9"], "feet slip"),
        ([*both, "--interrupt", "-1"], "interrupt_margin must be at least 0"),
        ([*both, "--answers", "50"], "--wish gives them; leave it out"),
        ([*both, "--wish", "power_w=-1", "--answers", "999"], "32 clips make 496"),
        ([*both, "--course", "bar", "--slope-rad", "0.1"], "no slope on the course"),
        (
            [*both, "--termination", "learned", "--length-s", "2"],
            "--length-s: --termination learned says",
        ),
    ):
        assert main(["options", *given, *out]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/policy.pt").write_bytes(WALK.read_bytes())
    assert main(["options", *both, "--wish", "power_w=-1", *out]) == 2
    assert "holds another policy" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["policy.pt"]


@pytest.fixture(scope="module")
def wished(gaits: Gaits, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where `options --wish` was, to its end: gaits, clips, answers and a policy."""
    place = tmp_path_factory.mktemp("wished")
    bent(WALK, place / "crouch.pt")
    wish = ["--wish", "changes_per_s=-1", "--answers", "20"]
    out = ["--out", str(place / "wished")]
    assert main(["options", *gaits_given(place), *SHORT, *wish, *out]) == 0
    return place


# So fast that nobody gets far: an episode is short.
SHORT = ["--course", "bar", "--speed-m-s", "1.5", "--steps", "160", "--envs", "8"]


def gaits_given(place: Path) -> list[str]:
    return ["--policy", f"walk={WALK}", "--policy", f"crouch={place / 'crouch.pt'}"]


def test_a_wish_and_answers_are_learned_to_the_end(
    wished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The answers of a data set, here those of a wish, teach the same reward again; and
    what is written says whose choices it is about."""
    answers = ["--dataset", str(wished / "wished/dataset")]
    out = ["--out", str(wished / "answered")]
    capsys.readouterr()
    assert main(["options", *gaits_given(wished), *SHORT, *answers, *out]) == 0
    told = capsys.readouterr().err
    assert "fitted to 20 answers" in told
    assert "crouch alone" in told
    first, second = (load_choices(wished / name) for name in ("wished", "answered"))
    assert first == second
    assert (first.robot, first.control_dt_s) == ("go1", 0.02)
    for name in ("wished", "answered"):
        gaits = load_policy(wished / name / "policy.pt").info.ppo.gaits
        assert gaits is not None
        assert gaits.names == ("walk", "crouch")


def test_answers_about_something_else_are_refused(
    wished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Gaits of the same names: of another rate, of a heavier robot, elsewhere."""
    given = gaits_given(wished)
    slow, heavy = ([], [])
    for name, path in named_files((given[1], given[3])).items():
        slow += ["--policy", f"{name}={slower(path, tmp_path / f'{name}-slow.pt')}"]
        heavy += ["--policy", f"{name}={heavier(path, tmp_path / f'{name}-heavy.pt')}"]
    answers = ["--dataset", str(wished / "wished/dataset")]
    out = ["--out", str(tmp_path / "out")]
    for gaits, more, said in (
        (given, ["--bar-m", "0.35"], "a bar_m of 0.29 instead of 0.35"),
        (given, ["--course", "bar", "slope"], "course: bar instead of bar slope"),
        (slow, [], "acts at 50 Hz, and these gaits at 40 Hz"),
        (heavy, [], "go1 has a mass of"),
    ):
        assert main(["options", *gaits, *SHORT, *more, *answers, *out]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
        assert "answers about th" in line
    assert not (tmp_path / "out/policy.pt").exists()
    wish = ["--wish", "changes_per_s=-1", "--answers", "20", "--seed", "5"]
    out = ["--out", str(wished / "wished")]
    assert main(["options", *given, *SHORT, *wish, *out]) == 2
    assert "shows other gaits, another course, speed" in capsys.readouterr().err


def test_a_reward_of_choices_is_about_one_robot_at_one_rate(wished: Path) -> None:
    """And one course; one of an older file says of none, and is read as ever."""
    dataset = Dataset.open(wished / "wished/dataset")
    clip = Clip(dataset.entries()[0].sha256, 0, 5)
    reward = load_choices(wished / "wished")
    OfChoices(reward).side(dataset, clip)
    assert reward.model_sha256 == dataset.entries()[0].meta.model_sha256
    for other, said in (
        (replace(reward, robot="spot"), "choices of spot at 50 Hz, and .* shows go1"),
        (replace(reward, control_dt_s=0.04), "go1 at 25 Hz, and .* go1 at 50 Hz"),
        (replace(reward, model_sha256="0" * 64), "model of go1, or another course"),
    ):
        with pytest.raises(GaitprefError, match=said):
            OfChoices(other).side(dataset, clip)
    OfChoices(replace(reward, model_sha256="")).side(dataset, clip)
    OfChoices(replace(reward, robot="", control_dt_s=0.0)).side(dataset, clip)


def test_answers_are_about_a_course_that_is_told(wished: Path, gaits: Gaits) -> None:
    dataset = Dataset.open(wished / "wished/dataset")
    episode = dataset.read(dataset.entries()[0].sha256)
    (bar,) = course_of(episode).obstacles
    farther = replace(
        course_of(episode), obstacles=(replace(bar, start_m=bar.start_m + 0.1),)
    )
    with pytest.raises(GaitprefError, match="its obstacles lie elsewhere"):
        Asked(gaits.robot, 0.02, farther).require(episode)
    nowhere = replace(episode, meta=replace(episode.meta, extra={}))
    with pytest.raises(GaitprefError, match="says of no course that it was on"):
        Asked(gaits.robot, 0.02, farther).require(nowhere)


def test_a_liking_for_changes_is_paid() -> None:
    reward = written_reward({"changes_per_s": 1.0}, ("walk", "crouch"), "wish")
    assert reward.change_cost(0.02) == pytest.approx(-1.0)


FIXED = ChoosingCfg(termination="fixed", length_s=1.0)


@pytest.mark.parametrize(
    ("choosing", "paid", "steps"),
    [
        (FIXED, TASK, 50),
        # What is learned of where a gait may end is of each look.
        (ChoosingCfg(termination="learned"), TASK, 10),
        # Who is paid for changes leaves a gait at every look.
        (replace(FIXED, interrupt_margin=0.1), {CHANGES: 1.0}, 10),
    ],
    ids=["fixed", "learned", "interrupted"],
)
def test_a_training_goes_on_bit_for_bit(
    gaits: Gaits,
    tmp_path: Path,
    choosing: ChoosingCfg,
    paid: dict[str, float],
    steps: int,
) -> None:
    """However gaits end: it is learned from what ran as long as they say, and ends are
    learned where they are."""
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    cfg = replace(small(steps=960), choosing=choosing)
    reward = written_reward(paid, gaits.names, "paid")
    assert train_options(whole, gaits, cfg, reward)
    # As long for what chance does by how far a training is.
    assert train_options(cut, gaits, cfg, reward, most_looks=3) is False
    assert not (cut / "policy.pt").exists()
    assert train_options(cut, gaits, cfg, reward)
    policies = [(each / "policy.pt").read_bytes() for each in (whole, cut)]
    assert policies[0] == policies[1]
    ran_for = read_plain(whole / "resume.pt")["learner"]["memory"]
    assert set(ran_for["steps"][~ran_for["over"]].tolist()) == {steps}
    before = OptionsTraining(gaits, cfg, reward).model.state_dict()
    after = read_plain(whole / "policy.pt")["actor_state_dict"]
    kept = torch.equal(before["chooser.ends.0.weight"], after["chooser.ends.0.weight"])
    assert kept == (choosing.termination == "fixed")
    assert not torch.equal(
        before["chooser.values.0.weight"], after["chooser.values.0.weight"]
    )
    with pytest.raises(GaitprefError, match="other settings"):
        train_options(cut, gaits, replace(cfg, seed=4), reward)


@pytest.mark.filterwarnings("ignore:.torch.jit:DeprecationWarning")
@pytest.mark.parametrize("termination", ["fixed", "learned"])
def test_exported_it_chooses_and_acts_the_same(
    chosen: Path, tmp_path: Path, termination: Termination
) -> None:
    """Over episodes that end at their own time; what it remembers is handed in. Its
    chooser is one that leaves no gait for long."""
    onnxruntime = pytest.importorskip("onnxruntime", reason="extra onnx")
    file = restless(chosen, tmp_path / "restless.pt", termination)
    policy, out = load_policy(file), tmp_path / "out"
    assert main(["export", "--policy", str(file), "--out", str(out)]) == 0
    told = json.loads((out / "policy.json").read_text())
    assert policy.info.ppo.gaits is not None
    assert told["gaits"] == list(policy.info.ppo.gaits.names)
    assert told["observation"][-1]["start"] == 53
    session = onnxruntime.InferenceSession(str(out / "policy.onnx"))
    script = torch.jit.load(out / "policy.pt")
    env_cfg = replace(policy.info.env, episode_s=1.0)
    env = QuadrupedEnv(policy.robot(), env_cfg, 3, seed=0)
    memory = {each["name"]: np.zeros(3, dtype=np.int64) for each in told["memory"]}
    seen = list[list[int]]()
    for _ in range(120):
        obs = env.get_observations()["policy"]
        wanted = policy(obs)
        given = [torch.from_numpy(each) for each in memory.values()]
        scripted, _, *of_script = script(obs, *given)
        action, _, *memory_next = session.run(None, {"obs": obs.numpy(), **memory})
        limit = policy.info.env.action_limit
        assert action == pytest.approx(wanted.clamp(-limit, limit).numpy(), abs=1e-4)
        assert scripted.detach().numpy() == pytest.approx(action, abs=1e-4)
        assert [m.tolist() for m in of_script] == [m.tolist() for m in memory_next]
        memory = dict(zip(memory, memory_next, strict=True))
        assert policy.gait is not None
        assert memory["gait"].tolist() == policy.gait.tolist()
        seen.append(memory["gait"].tolist())
        env.step(wanted)
    changes = sum(a != b for a, b in pairwise(seen))
    assert changes > 2, seen


def test_gaits_that_cannot_follow_one_another_are_told(
    chosen: Path, tmp_path: Path
) -> None:
    slow = slower(WALK, tmp_path / "slow.pt")
    with pytest.raises(GaitprefError, match="heavy is of another robot than walk: it"):
        load_gaits({"walk": WALK, "heavy": heavier(WALK, tmp_path / "heavy.pt")})
    with pytest.raises(GaitprefError, match=r"control_dt_s of 0\.025 s, walk of 0\.02"):
        load_gaits({"walk": WALK, "slow": slow})
    with pytest.raises(GaitprefError, match="chooses among gaits itself"):
        load_gaits({"walk": WALK, "both": chosen})
    with pytest.raises(PolicyError, match="chooses among frozen gaits, which PPO"):
        as_team(chosen, TeamCfg())
    with pytest.raises(GaitprefError, match="1 policies leave nothing to choose"):
        named_files(("walk=a.pt",))


def test_a_course_nobody_could_pass_is_refused(gaits: Gaits) -> None:
    with pytest.raises(RobotError, match=r"raise bar_m to at least 0\.18"):
        stands_on(gaits.robot, replace(BAR, bar_m=0.1))
    with pytest.raises(RobotError, match="open ground before"):
        replace(BAR, obstacles=(Obstacle(kind="bar", start_m=0.1, length_m=1.0),))


@pytest.mark.parametrize(
    "runs", ["", "0x3", "2x5", "0x5 x", "0x99999999", "0x2 1x3 0x1"]
)
def test_runs_that_are_not_those_of_an_episode_say_nothing(runs: str) -> None:
    assert choices_of({"gaits": "walk,crouch", "gait_runs": runs}, 5) is None
    said = told_choices(("walk", "crouch"), np.array([0, 0, 1, 1, 0]))
    found = choices_of(said, 5)
    assert found is not None
    assert found.runs(slice(1, 4)) == [("walk", 0, 1), ("crouch", 1, 3)]
