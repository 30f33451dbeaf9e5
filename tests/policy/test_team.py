"""Two robots in one world: physics, what they see, recording, and who earned what."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.episode import decode_episode
from data.episodes.episode_records import Episode
from data.episodes.team_rows import (
    SIGHT_DIM,
    sight_column,
    team_rows,
    team_sight,
)
from data.episodes.writer import encode_episode
from data.errors import CorruptEpisode, GaitprefError
from data.features import FEATURE_DIM, column
from gaitpref.cli.main import main
from gaitpref.report.crediting import load_crediting
from gaitpref.team.team_credit import Credit, verdict_of
from gaitpref.team.team_pay import SharedPay
from gaitpref.team.team_sets import first_team, require_alike, require_kind
from labeling_ui.scene.geometry import instance_poses, robot_geometry
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.env.team_cfg import TeamCfg
from policy.env.terrain import TerrainCfg
from policy.robots.robot import SHIPPED_XML, load_robot, load_robot_xml
from policy.robots.shipped import WALK
from policy.sim.batch_sim import BatchSim
from policy.sim.chosen import Listed
from policy.team.pair_model import first_alone
from policy.team.pair_sim import PairSim
from policy.team.team_env import TeamEnv
from policy.team.team_record import TeamRecordCfg, record_team
from policy.team.team_start import as_team
from policy.training.checkpoint import Policy, load_policy
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES, describe
from rewardmodel.errors import RewardError
from rewardmodel.models.fit_report import FitReport
from rewardmodel.team.pair_habits import PAIR_NAMES, describe_pair
from rewardmodel.team.stood_still import StandingCfg, had_stood
from rewardmodel.team.team_reward import TeamReward, Walkers
from rewardmodel.team.team_storage import TEAM_FACTS, load_team, save_team
from tests.helpers.retold_policies import heavier, slower

STANDING = StandingCfg(height_m=0.28)


@pytest.fixture(scope="module")
def walkers(tmp_path_factory: pytest.TempPathFactory) -> Policy:
    """The walk that ships, as a team that does not look yet."""
    file = tmp_path_factory.mktemp("team") / "policy.pt"
    file.write_bytes(as_team(WALK, TeamCfg()))
    return load_policy(file)


@pytest.fixture(scope="module")
def episodes(walkers: Policy) -> Sequence[Episode]:
    """Forty teams of 4 s, in every second one of which a robot is lazy."""
    cfg = TeamRecordCfg(episodes=40, episode_s=4.0, lazy_share=0.5)
    return tuple(record_team(walkers, cfg, seed=0))


@pytest.fixture(scope="module")
def dataset(
    episodes: Sequence[Episode], tmp_path_factory: pytest.TempPathFactory
) -> Dataset:
    """These episodes on disk, and 120 answers about them."""
    found = Dataset.create(tmp_path_factory.mktemp("teams") / "set")
    found.add_episodes(episodes)
    given = ["--dataset", str(found.root)]
    assert main(["pairs", *given, "--count", "120"]) == 0
    assert main(["team", "answer", *given]) == 0
    return found


def any_reward(seed: int = 0) -> TeamReward:
    """A reward with weights drawn at random."""
    rng = torch.Generator().manual_seed(seed)
    count = len(DESCRIPTOR_NAMES) + len(PAIR_NAMES)
    return TeamReward(
        own=Normaliser(len(DESCRIPTOR_NAMES)),
        pair=Normaliser(len(PAIR_NAMES)),
        weights=torch.randn(4, count, generator=rng),
        scale=2.0,
        report=_no_report(),
        answers_sha256="",
        episodes=frozenset(),
    )


def _no_report() -> FitReport:
    nothing = {
        name: None
        for name in (
            *("train_accuracy", "held_out_accuracy", "held_out_interval"),
            *("at_random_accuracy", "held_out_log_likelihood"),
            *("held_out_ece", "held_out_brier"),
        )
    }
    return FitReport(
        answers=0,
        answers_without_target=0,
        ties=0,
        train_log_likelihood=0.0,
        held_out_pairs=0,
        at_random_pairs=0,
        temperature=1.0,
        seconds=0.0,
        **nothing,  # type: ignore[arg-type]
    )


def rows_of(episode: Episode) -> torch.Tensor:
    return torch.from_numpy(team_rows(episode))


def test_far_apart_each_moves_as_if_it_were_alone() -> None:
    """One world with two robots is the same physics as two worlds with one."""
    robot = load_robot(physics_dt_s=0.005)
    pair, alone = PairSim(robot, 2, threads=1), BatchSim(robot, 2, threads=1)
    qpos = torch.tensor(robot.home_qpos).repeat(2, 1)
    qpos[1, 1] += 3.0
    targets = torch.tensor(robot.home_joint_pos).float().repeat(2, 1)
    targets[1] += 0.2
    for sim in (pair, alone):
        sim.reset(Listed(torch.arange(2)), qpos, torch.zeros(2, 18).double())
        sim.set_targets(targets)
        for _ in range(20):
            assert not sim.advance(4).any()
    ours, theirs = pair.read(), alone.read()
    for name in (
        "base_pos_w",
        "joint_pos",
        "foot_contact",
        "foot_vel_w",
        "base_height",
    ):
        torch.testing.assert_close(
            getattr(ours, name), getattr(theirs, name), atol=2e-4, rtol=0
        )
    torch.testing.assert_close(
        pair.raw_state()[0], alone.raw_state()[0], atol=2e-4, rtol=0
    )


def test_they_bump() -> None:
    """Thrown at each other, neither gets through; and a bump is no fall."""
    robot = load_robot(physics_dt_s=0.005)
    sim = PairSim(robot, 2, threads=1)
    qpos = torch.tensor(robot.home_qpos).repeat(2, 1)
    qpos[1, 1] -= 0.6
    qvel = torch.zeros(2, 18).double()
    qvel[0, 1], qvel[1, 1] = -1.0, 1.0
    sim.reset(Listed(torch.arange(2)), qpos, qvel)
    sim.set_targets(torch.tensor(robot.home_joint_pos).float().repeat(2, 1))
    least = 1.0
    for _ in range(20):
        sim.advance(4)
        places = sim.read().base_pos_w[:, 1]
        least = min(least, float(places[0] - places[1]))
    assert 0.05 < least < 0.5
    assert not sim.read().base_contact.any()


def test_what_is_seen_of_the_other_by_hand() -> None:
    """The first looks north from the origin, the second east, a metre to the east."""
    half = np.sqrt(0.5)
    qpos = np.array([[0, 0, 0.3, half, 0, 0, half], [1.0, 0, 0.3, 1, 0, 0, 0]])
    qvel = np.array([[0, 1.0, 0], [0.5, 0, 0]])
    first, second = team_sight(qpos, qvel)
    # The east is to the right of who looks north.
    np.testing.assert_allclose(first, [0, -1, 0, -1, -1, -0.5], atol=1e-6)
    np.testing.assert_allclose(second, [-1, 0, 0, 1, -0.5, 1], atol=1e-6)


def test_a_team_has_one_command_and_one_end(walkers: Policy) -> None:
    """Rows and observations tell of the other; who resets, resets both."""
    env = TeamEnv(walkers.robot(), walkers.info.env, 6, seed=3)
    obs = env.get_observations()["policy"]
    assert obs.shape == (6, 48 + SIGHT_DIM)
    assert torch.equal(env.command[::2], env.command[1::2])
    env.episode_length_buf = torch.randint(0, 500, (6,))
    assert torch.equal(env.episode_length_buf[::2], env.episode_length_buf[1::2])
    env.episode_length_buf = torch.tensor([499, 499, 0, 0, 0, 0])
    _, _, dones, extras = env.step(torch.zeros(6, 12))
    assert dones.tolist() == [True, True, False, False, False, False]
    assert extras["features"].shape == (6, FEATURE_DIM + SIGHT_DIM)
    gap = extras["features"][:, sight_column("mate_pos_h")].norm(dim=-1)
    assert torch.all((gap > 0.4) & (gap < 1.2))
    saved, action = env.snapshot(), torch.ones(6, 12)
    once = env.step(action)[0]["policy"]
    env.restore(saved)
    torch.testing.assert_close(env.step(action)[0]["policy"], once, atol=1e-5, rtol=0)


def test_what_no_team_does_is_said() -> None:
    robot, cfg = load_robot(physics_dt_s=0.005), EnvCfg()
    with pytest.raises(GaitprefError, match="in a team of two and is blind"):
        QuadrupedEnv(robot, replace(cfg, team=TeamCfg()), 2, seed=0)
    with pytest.raises(GaitprefError, match="this policy walks alone"):
        TeamEnv(robot, cfg, 2, seed=0)
    with pytest.raises(GaitprefError, match="an even number of robots: 3"):
        TeamEnv(robot, replace(cfg, team=TeamCfg()), 3, seed=0)
    hills = replace(cfg, team=TeamCfg(), terrain=TerrainCfg(kind="steps"))
    with pytest.raises(GaitprefError, match="other ground than a plane"):
        TeamEnv(robot, hills, 2, seed=0)


def test_a_team_walks_as_its_robots_did_alone(walkers: Policy) -> None:
    """Until it learns to look, what is seen changes no action."""
    alone = load_policy(WALK)
    obs = torch.randn(5, 48, generator=torch.Generator().manual_seed(0))
    seen = torch.cat([obs, torch.full((5, SIGHT_DIM), 3.0)], dim=-1)
    torch.testing.assert_close(walkers(seen), alone(obs))


def test_an_episode_file_holds_both(episodes: Sequence[Episode]) -> None:
    """Both are read back, the world draws both, and a damaged one is damaged."""
    content = encode_episode(episodes[0])
    again = decode_episode(content, "x")
    assert again.mate is not None
    assert encode_episode(again) == content
    np.testing.assert_array_equal(again.world_qpos[:, 19:], again.mate.qpos)
    model = mujoco.MjModel.from_xml_string(again.mjcf)
    assert model.nq == again.world_qpos.shape[1] == 38
    positions, _ = instance_poses(robot_geometry(again.mjcf), again.world_qpos[:1])
    across = positions[0, :, 1]
    assert across.max() - across.min() > 0.8
    spoilt = content.replace(b"team/mate.mcap", b"team/mate.mcbp")
    with pytest.raises(CorruptEpisode):
        decode_episode(spoilt, "x")
    with pytest.raises(ValueError, match="share steps"):
        replace(again, mate=replace_length(again.mate))


def replace_length(mate: Episode) -> Episode:
    """The mate without its last step."""
    cut = {
        name: getattr(mate, name)[:-1]
        for name in ("qpos", "qvel", "obs", "action", "ctrl", "features", "reward")
    }
    return replace(mate, **cut)


def test_rows_read_from_a_file_are_those_of_the_run(
    episodes: Sequence[Episode],
) -> None:
    """What is seen of the other follows from both states."""
    rows = team_rows(episodes[0])
    assert rows.shape == (episodes[0].num_steps, 2, FEATURE_DIM + SIGHT_DIM)
    np.testing.assert_array_equal(rows[:, 0, :FEATURE_DIM], episodes[0].features)
    first, second = rows[:, 0], rows[:, 1]
    place = sight_column("mate_pos_h")
    np.testing.assert_allclose(
        np.linalg.norm(first[:, place], axis=-1),
        np.linalg.norm(second[:, place], axis=-1),
        atol=1e-5,
    )


def test_shares_add_up_to_the_whole(episodes: Sequence[Episode]) -> None:
    """What both are paid is what the team got, in every step, however it is parted."""
    model, rows = any_reward(), rows_of(episodes[0])
    shares = model.shares(rows)
    w, v = model.agreed
    whole = (describe(rows).clamp(-5, 5) @ w).mean(-1) + describe_pair(rows).clamp(
        -5, 5
    ) @ v
    torch.testing.assert_close(shares.of_each.sum(-1), whole, atol=1e-4, rtol=1e-4)
    groups = torch.stack(tuple(model.by_group(rows).values())).sum(dim=0)
    torch.testing.assert_close(groups, whole, atol=1e-4, rtol=1e-4)
    features = rows.unsqueeze(1).repeat(1, 3, 1, 1).flatten(1, 2)  # [T, N, F + V]
    starts = torch.zeros(features.shape[:2], dtype=torch.bool)
    for how in ("shares", "same"):
        paid = SharedPay(model, how, STANDING, 0.02)(features, starts)
        both = paid.unflatten(1, (3, 2)).sum(dim=-1)
        torch.testing.assert_close(both[:, 0], whole, atol=1e-4, rtol=1e-4)


def test_who_stands_already_is_worth_nothing(episodes: Sequence[Episode]) -> None:
    """The other world is this one where the robot stood anyway."""
    model, rows = any_reward(), rows_of(episodes[0])[:, None].clone()
    starts = torch.zeros(len(rows), 1, dtype=torch.bool)
    starts[0] = True
    once = had_stood(rows, starts, 0, STANDING, control_dt_s=0.02)
    again = had_stood(once, starts, 0, STANDING, control_dt_s=0.02)
    torch.testing.assert_close(again, once, atol=1e-5, rtol=1e-5)
    worth = model.difference(once, starts, STANDING, control_dt_s=0.02)
    assert worth[..., 0].abs().max() < 1e-3
    assert worth[..., 1].abs().max() > 0.1


def test_where_it_stood_is_where_it_was(episodes: Sequence[Episode]) -> None:
    """The other world, worked out from velocities, agrees with the states."""
    episode = next(e for e in episodes if e.num_steps > 100)
    rows = rows_of(episode)[:, None]
    starts = torch.zeros(len(rows), 1, dtype=torch.bool)
    starts[0] = True
    found = had_stood(rows, starts, 0, STANDING, control_dt_s=0.02)[100, 0, 0]
    assert episode.mate is not None
    # A state after step t is row t + 1 of the episode's.
    then, now = episode.qpos[51], episode.mate.qpos[101]
    still = np.stack([then, now])
    seen = team_sight(still, np.zeros((2, 3)))[0]
    place = found[sight_column("mate_pos_h")].numpy()
    np.testing.assert_allclose(place, seen[:2], atol=0.05)
    assert float(found[column("base_lin_vel_b")].abs().sum()) == 0.0


def test_motors_may_be_in_another_order_and_home_is_kept() -> None:
    """Those of FL before those of FR; and a home that is not the pose of the file."""
    before, rest = SHIPPED_XML.read_text().split("<actuator>")
    motors, after = rest.split("</actuator>")
    lines = motors.strip().splitlines()
    ordered = "\n".join(lines[3:6] + lines[:3] + lines[6:])
    text = f"{before}<actuator>{ordered}</actuator>{after}"
    text, changed = re.subn(r'(<body name="trunk" pos="0 0 )[\d.]+', r"\g<1>0.5", text)
    assert changed == 1
    robot = load_robot_xml(text, name="other", physics_dt_s=EnvCfg().physics_dt_s)
    assert list(robot.actuator_ids) != sorted(robot.actuator_ids)
    env = TeamEnv(robot, replace(EnvCfg(), team=TeamCfg()), 8, seed=0)
    fallen = [env.step(torch.zeros(8, 12))[3]["fallen"].any() for _ in range(20)]
    assert not any(fallen)
    again = load_robot_xml(
        first_alone(env.sim.mjcf), name="other", physics_dt_s=EnvCfg().physics_dt_s
    )
    np.testing.assert_allclose(again.home_qpos, robot.home_qpos, atol=1e-6)


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_who_is_lazy_is_not_who_is_shaky(walkers: Policy, share: float) -> None:
    cfg = TeamRecordCfg(episodes=40, episode_s=0.04, lazy_share=share)
    seen = {
        (episode.meta.stochastic, episode.meta.extra.get("lazy_robot", ""))
        for episode in record_team(walkers, cfg, seed=0)
    }
    assert seen == {(noisy, who) for noisy in (False, True) for who in ("", "1", "2")}


def test_the_lazy_one_is_named(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From answers about teams alone: whoever stands still on purpose earns less."""
    reward, given = tmp_path / "reward", ["--dataset", str(dataset.root)]
    assert main(["team", "fit", *given, "--out", str(reward)]) == 0
    capsys.readouterr()
    shown = ["team", "shares", "--reward", str(reward), *given, "--json"]
    assert main(shown) == 0
    told = json.loads(capsys.readouterr().out)["lazy_on_purpose"]
    less = 0.0
    for lazy in ("1", "2"):
        own, still = told[lazy]["mean"]["share"], told[lazy]["mean"]["still"]
        behind, ahead = int(lazy) - 1, 2 - int(lazy)
        less += own[ahead] - own[behind]
        assert still[behind] > still[ahead] + 0.1
        verdict = told[lazy]["verdict"]
        assert f"robot {lazy} " in verdict
        assert "is lazy" in verdict
        assert f"robot {ahead + 1} " not in verdict
    assert less > 0.05


def credits_of(gaps: Sequence[float], still: tuple[float, float]) -> list[Credit]:
    """Episodes in which robot 1 earns so much more than robot 2."""
    nothing = (0.0, 0.0)
    return [
        Credit(share=(1.0 + gap, 1.0), own=nothing, worth=nothing, still=still)
        for gap in gaps
    ]


@pytest.mark.parametrize(
    ("gaps", "still", "behind", "sentence"),
    [
        (
            (-0.4, -0.6, -0.5, -0.5),
            (0.5, 0.1),
            1,
            "robot 1 earns 0.50 +- 0.04 a second less than the other: it is lazy; it "
            "stands still 50% of the time, the other 10%",
        ),
        (
            (0.4, 0.6, 0.5, 0.5),
            (0.1, 0.15),
            2,
            "robot 2 earns 0.50 +- 0.04 a second less than the other: not by standing "
            "still; it stands still 15% of the time, the other 10%",
        ),
        (
            (1.0, -1.0, 0.5, -0.3),
            (0.1, 0.1),
            None,
            "both robots earn alike: the difference is 0.05 +- 0.44 a second; they "
            "stand still 10% and 10% of the time",
        ),
        (
            (1.0, -1.0, 0.5, -0.3),
            (0.1, 0.4),
            None,
            "both robots earn alike: the difference is 0.05 +- 0.44 a second; they "
            "stand still 10% and 40% of the time: robot 2 is lazy, and no answer tells "
            "what that costs",
        ),
        (
            (-2.0,),
            (0.9, 0.0),
            None,
            "both robots earn alike: the difference is 2.00 +- inf a second; they "
            "stand still 90% and 0% of the time: robot 1 is lazy, and no answer tells "
            "what that costs",
        ),
        (
            (0.01, 0.01, 0.01),
            (0.0, 0.0),
            None,
            "both robots earn alike: the difference is 0.01 +- 0.00 a second; they "
            "stand still 0% and 0% of the time",
        ),
    ],
)
def test_a_verdict_names_who_earns_less_and_why(
    gaps: Sequence[float],
    still: tuple[float, float],
    behind: int | None,
    sentence: str,
) -> None:
    """Two standard errors and five hundredths make a difference; one episode none."""
    verdict = verdict_of(credits_of(gaps, still))
    assert (verdict.behind, verdict.still) == (behind, still)
    assert verdict.sentence == sentence


def test_each_way_to_pay_trains_and_goes_on(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A few steps of each; a training resumes; what cannot be used is said."""
    reward = tmp_path / "reward"
    given = ["--dataset", str(dataset.root)]
    assert main(["team", "fit", *given, "--out", str(reward)]) == 0
    assert load_team(reward).walkers == Walkers.of(first_team(dataset).meta)
    small = ["--steps", "192", "--robots", "4", "--checkpoints", "0"]
    for pay in ("shares", "same", "counterfactual"):
        out = ["--out", str(tmp_path / pay), "--reward", str(reward), "--pay", pay]
        assert main(["team", "train", *out, *small]) == 0
    out = ["--out", str(tmp_path / "shares"), "--reward", str(reward)]
    assert main(["team", "train", *out, *small]) == 2
    assert main(["team", "train", *out, *small, "--steps", "288", "--resume"]) == 0
    policy = str(tmp_path / "shares" / "policy.pt")
    fresh = ["team", "train", "--out", str(tmp_path / "fresh"), "--reward", "task"]
    capsys.readouterr()
    for args, words in (
        (["evaluate", "--policy", policy], "in a team of two"),
        (["export", "--policy", policy, "--out", str(tmp_path / "x")], "a team of two"),
        (["team", "record", "--policy", str(WALK), *given], "this policy walks alone"),
        (["team", "shares", "--reward", str(tmp_path), *given], "no reward of a team"),
        (["team", "answer", *given, "--criterion", "dance"], "is called 'dance'"),
        (["fit", *given, "--out", str(tmp_path / "y")], "`gaitpref team fit --dataset"),
        (["record", *given, "--episodes", "1"], "show teams: keep one robot alone in"),
        ([*fresh, "--pay", "same"], "pays both alike"),
        ([*fresh, "--weight", "2"], "a reward beside the task"),
        ([*fresh, "--robots", "5"], "give an even number"),
    ):
        assert main(args) == 2, args
        assert words in capsys.readouterr().err
    assert not (tmp_path / "fresh" / "start.pt").exists()


def test_a_reward_of_other_teams_pays_nobody(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It says of which robots and rate it is; an older file does not, and is read."""
    given = ["--dataset", str(dataset.root)]
    walkers = Walkers.of(first_team(dataset).meta)
    assert (walkers.robot, walkers.control_dt_s) == ("go1", 0.02)
    train = ["team", "train", "--steps", "96", "--robots", "4", "--checkpoints", "0"]
    for name, changed, said in (
        ("spot", replace(walkers, robot="spot"), "teams of spot at 50 Hz, and"),
        ("slow", replace(walkers, control_dt_s=0.04), "go1 at 25 Hz, and"),
        ("heavy", replace(walkers, model_sha256="0" * 64), "another model of go1:"),
    ):
        reward, out = tmp_path / name, tmp_path / f"{name}-out"
        save_team(replace(any_reward(), walkers=changed), reward)
        used = ["--reward", str(reward)]
        for command in ([*train, "--out", str(out)], ["team", "shares", *given]):
            assert main([*command, *used]) == 2
            (line,) = capsys.readouterr().err.splitlines()
            assert said in line
            assert "`gaitpref team fit` about such teams" in line
        assert not out.exists() or not list(out.glob("*.pt"))
        with pytest.raises(RewardError, match=re.escape(said)):
            load_crediting(reward).side(
                dataset, Clip(dataset.entries()[0].sha256, 0, 5)
            )
    older = tmp_path / "older"
    save_team(any_reward(), older)
    facts = json.loads((older / TEAM_FACTS).read_text())
    del facts["walkers"]
    (older / TEAM_FACTS).write_text(json.dumps(facts))
    assert load_team(older).walkers is None
    assert main(["team", "shares", *given, "--reward", str(older)]) == 0


def test_sets_of_other_teams_are_not_mixed(
    dataset: Dataset,
    episodes: Sequence[Episode],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Nor are teams and robots alone, whichever came first."""
    for kind, change, words, both in (
        ("slow", slower, "go1 at 40 Hz", "go1 at 40 Hz and go1 at 50 Hz: "),
        ("heavy", heavier, "another model of go1", "go1 at 50 Hz (2 models of it): "),
    ):
        policy, root = tmp_path / f"{kind}.pt", tmp_path / kind
        policy.write_bytes(as_team(change(WALK, tmp_path / "alone.pt"), TeamCfg()))
        assert (
            main(shlex.split(f"team record --policy {policy} --dataset {dataset.root}"))
            == 2
        )
        assert f"and this policy walks {words}: " in capsys.readouterr().err
        record_in = f"team record --policy {policy} --dataset {root} --episodes 1"
        for _ in range(2):
            assert main(shlex.split(f"{record_in} --episode-s 0.1")) == 0
        other = Dataset.open(root)
        with pytest.raises(GaitprefError, match=f"teams of {words}, .* fit them apart"):
            require_alike([dataset, other])
        capsys.readouterr()
        for line, said in (
            (f"team fit --dataset {root} --out {root}-reward", "`gaitpref team answer"),
            (
                f"train --reward task --algorithm fastsac --replay {root} --steps 4 "
                f"--envs 4 --out {root}-trained",
                "it shows a team of two go1",
            ),
        ):
            assert main(shlex.split(line)) == 2
            assert said in capsys.readouterr().err
        # One further down the list, as an older version wrote it.
        other.add_episodes(episodes[:1])
        with pytest.raises(GaitprefError, match=re.escape(f"holds teams of {both}")):
            first_team(other)
    alone = Dataset.create(tmp_path / "alone")
    require_kind(alone, team=True)
    with pytest.raises(GaitprefError, match="show teams: keep one robot alone in"):
        require_kind(dataset, team=False)
