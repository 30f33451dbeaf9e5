"""Learning off-policy: what is remembered, what it is worth, and what comes of it."""

from __future__ import annotations

import json
import math
import os
import signal
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from data.features import FEATURE_DIM, column
from gaitpref.cli.main import main
from gaitpref.cli.options.options import Train
from gaitpref.cli.shared.off_policy import off_policy_of
from gaitpref.formats.logs.from_qpos import steps_from_qpos
from gaitpref.options.gait_files import load_gaits
from gaitpref.training.total_reward import total_reward
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import CommandCfg, EnvCfg, TerrainCfg
from policy.env.known_terms import KnownTermsCfg
from policy.env.own_law import imu_law
from policy.env.team_cfg import TeamCfg
from policy.offpolicy import ring as ring_module
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.offpolicy.remembered import Place, rows_of_episode, side_by_side
from policy.offpolicy.ring import Batch, Chunk, Ring
from policy.offpolicy.sac import Sac, half_mirrored
from policy.offpolicy.sac_cfg import SacCfg
from policy.parallel.ranks import Ranks
from policy.robots.robot import Robot, load_robot
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.team.team_start import as_team
from policy.training.checkpoint import holding_home, load_policy, read_plain
from policy.training.mirror import mirror_of
from policy.training.policy_error import PolicyError
from policy.training.ppo import IterationStats, PpoCfg
from policy.training.session import Session, TrainResult
from policy.training.setup import setting_of
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.foreign_robots import Drawing, mjcf
from tests.helpers.retold_policies import getting_up

ENV = EnvCfg(episode_s=0.4, commands=CommandCfg(resample_s=math.inf))
PPO = PpoCfg(num_envs=4, steps_per_env=24, hidden_sizes=(16,))
SAC = SacCfg(
    critic_sizes=(16,),
    memory=400,
    learn_from=90,
    batch=32,
)
HEIGHT = column("base_height")
ACTION = column("action")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=ENV.physics_dt_s)


def _trained(
    out: Path, robot: Robot, iterations: int, engine: OffPolicy, **more: object
) -> TrainResult:
    cfg = TrainCfg(steps=iterations * PPO.steps_per_iteration, env=ENV, ppo=PPO)
    return train(out, robot, cfg, engine=engine, **more)  # type: ignore[arg-type]


def _chunk(first: int, rows: int, **marks: list[tuple[int, int]]) -> Chunk:
    """Rows of two columns whose height and observation are the time, from `first`."""
    time = torch.arange(first, first + rows, dtype=torch.float32)
    features = torch.zeros(rows, 2, FEATURE_DIM)
    features[..., HEIGHT] = time[:, None, None]
    found = {}
    for name in ("starts", "fallen", "cut"):
        found[name] = torch.zeros(rows, 2, dtype=torch.bool)
        for place in marks.get(name, []):
            found[name][place] = True
    obs = time[:, None, None].expand(-1, 2, 1).clone()
    return Chunk(obs=obs, features=features, **found)


def _height(features: Tensor, starts: Tensor) -> Tensor:
    return features[..., HEIGHT][..., 0]


def _minus_height(features: Tensor, starts: Tensor) -> Tensor:
    return -_height(features, starts)


@dataclass(frozen=True)
class OfThree:
    """The sum of the heights of the last three steps of the episode."""

    history_steps: int = 2

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        height, total = _height(features, starts), []
        for step in range(len(height)):
            sums = torch.zeros(height.shape[1])
            for env in range(height.shape[1]):
                for back in range(3):
                    if step - back < 0:
                        break
                    sums[env] += height[step - back, env]
                    if starts[step - back, env]:
                        break
            total.append(sums)
        return torch.stack(total)


def test_a_new_reward_is_that_of_all_steps_of_a_full_ring() -> None:
    """Also of those behind the place that is written next: two rows of eight are
    before it here."""
    ring = Ring(8, 2, 1, device="cpu")
    for first in (0, 5):
        ring.add(_chunk(first, 5))
    assert (ring.head, ring.filled) == (2, 8)
    assert ring.score(_height, 0) == 16
    assert not ring.stale(0)
    assert ring.stale(1)
    assert ring.score(_minus_height, 1) == 16
    assert not ring.stale(1)
    assert ring.reward[:, 0].tolist() == [-8, -9, -2, -3, -4, -5, -6, -7]


def test_only_what_is_new_is_scored_on_the_way() -> None:
    ring = Ring(8, 2, 1, device="cpu")
    ring.add(_chunk(0, 6))
    ring.score(_height, 0)
    ring.add(_chunk(6, 1))
    assert ring.stale(0)
    assert ring.score(_height, 0, newest=1) == 2
    assert not ring.stale(0)


@pytest.mark.parametrize("at_once", [2, 6, 100])
def test_a_reward_that_looks_back_sees_the_order_of_time(
    at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In parts of any size and over the end of the ring. Of 2 to 9, an episode begins
    with 6: 2, 2+3, 2+3+4, ... and 6, 6+7, 6+7+8, ..."""
    monkeypatch.setattr(ring_module, "SCORED_AT_ONCE", at_once)
    ring = Ring(8, 2, 1, device="cpu")
    ring.add(_chunk(0, 5))
    ring.add(_chunk(5, 5, starts=[(1, 0), (1, 1)]))
    ring.score(OfThree(), 0)
    in_time = ring.reward[(torch.arange(8) + 2) % 8, 0]
    assert in_time.tolist() == [2, 5, 9, 12, 6, 13, 21, 24]


def _outcomes(ring: Ring) -> dict[tuple[float, float], tuple[float, float, float]]:
    """Gain, discount and later observation by time and column drawn."""
    # The columns are told apart by their action.
    ring.features[:, 1, ACTION] = 1.0
    torch.manual_seed(0)
    batch = ring.sample(2000, n_step=3, gamma=0.5)
    rows = zip(
        batch.obs[:, 0].tolist(),
        batch.action[:, 0].tolist(),
        batch.gain.tolist(),
        batch.discount.tolist(),
        batch.later_obs[:, 0].tolist(),
        strict=True,
    )
    return {(time, col): (g, d, later) for time, col, g, d, later in rows}


def test_a_fall_ends_a_return_and_a_time_out_is_bootstrapped() -> None:
    """Rewards are the time, three steps count, each half of the one before.

    Column 0 falls at 3; of column 1, time is up at 3, so what step 3 led to is not
    known: a critic is asked about the state before it. Nor is what the last led to.
    """
    ring = Ring(9, 2, 1, device="cpu")
    ring.add(_chunk(0, 6, fallen=[(3, 0)], cut=[(3, 1)], starts=[(4, 0), (4, 1)]))
    ring.score(_height, 0)
    found = _outcomes(ring)
    assert found[0, 0] == (0 + 0.5 + 0.5, 0.125, 3)
    assert found[1, 0][:2] == (1 + 1 + 0.75, 0)
    assert found[3, 0][:2] == (3, 0)
    assert found[4, 0] == (4, 0.5, 5)
    assert found[1, 1] == (1 + 1, 0.25, 3)
    assert found[2, 1] == (2, 0.5, 3)
    assert {place for place in found if place[0] == 5} == set()
    assert (3, 1) not in found


def test_what_is_newest_is_not_followed_by_what_is_oldest() -> None:
    ring = Ring(8, 2, 1, device="cpu")
    ring.add(_chunk(0, 8))
    ring.add(_chunk(8, 3))
    ring.score(_height, 0)
    found = _outcomes(ring)
    assert found[9, 0] == (9, 0.5, 10)
    assert found[8, 0] == (8 + 4.5, 0.25, 10)
    assert (10, 0) not in found
    assert found[7, 0] == (7 + 4 + 2.25, 0.125, 10)


class Reaching:
    """Pays for actions near 1.5, which a tanh that ends at 1 cannot reach."""

    history_steps = 0

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        return 1.0 - (features[..., ACTION] - 1.5).square().mean(dim=-1)


@pytest.fixture(scope="module")
def reaching(tmp_path_factory: pytest.TempPathFactory, robot: Robot) -> Path:
    """A training towards actions of 1.5."""
    out = tmp_path_factory.mktemp("reaching")
    cfg = replace(SAC, gamma=0.0, n_step=1, updates_per_step=0.5, reward_scale=1.0)
    _trained(out, robot, 8, OffPolicy(cfg=cfg), reward_fn=Reaching())
    return out


def test_actions_reach_what_the_environment_takes(reaching: Path, robot: Robot) -> None:
    """It is an ordinary policy file, and its actions came nearer to 1.5 than 1."""
    policy = load_policy(reaching / "policy.pt")
    env = QuadrupedEnv(robot, ENV, 4, seed=3)
    actions = policy(env.get_observations()["policy"])
    assert actions.mean() > 1.1
    assert actions.abs().max() <= ENV.action_limit
    assert policy.info.steps == 8 * PPO.steps_per_iteration
    assert (policy.std > 0).all()


def test_no_joint_is_asked_for_more_than_its_range(robot: Robot) -> None:
    """The bound of an action is what reaches the farther end, and at most the limit."""
    env = QuadrupedEnv(robot, replace(ENV, action_scale_rad=0.9), 1, seed=0)
    home, ends = robot.home_joint_pos, robot.joint_range
    farther = abs(ends - home[:, None]).max(axis=1) / 0.9
    assert env.reach().tolist() == pytest.approx(farther.tolist(), rel=1e-5)
    assert env.reach().min() < ENV.action_limit


def test_one_that_learned_nothing_can_be_made_to_stand(
    robot: Robot, tmp_path: Path
) -> None:
    """And is trained on from there; it remembers nothing."""
    first = _trained(tmp_path / "first", robot, 0, OffPolicy(cfg=SAC)).policy
    standing = tmp_path / "standing.pt"
    standing.write_bytes(holding_home(first))
    on = _trained(tmp_path / "on", robot, 0, OffPolicy(cfg=SAC), init=standing).policy
    obs = torch.randn(8, 48)
    assert load_policy(first)(obs).abs().max() > 0.0
    for path in (standing, on):
        assert load_policy(path)(obs).abs().max() == 0.0
    engine = OffPolicy(cfg=SAC, replay=(tmp_path / "first",))
    with pytest.raises(GaitprefError, match="took no step yet, and remembers none"):
        _trained(tmp_path / "replayed", robot, 1, engine)


def test_ppo_goes_on_from_it_and_it_from_ppo(
    reaching: Path, robot: Robot, tmp_path: Path
) -> None:
    first = reaching / "policy.pt"
    setting = setting_of(first, None)
    cfg = TrainCfg(
        steps=96, env=ENV, ppo=replace(setting.ppo, num_envs=4, steps_per_env=24)
    )
    train(tmp_path / "ppo", robot, cfg, init=first)
    plain = train(tmp_path / "plain", robot, replace(cfg, ppo=PPO))
    engine = OffPolicy(cfg=SAC)
    for init in (first, plain.policy):
        out = tmp_path / f"from-{init.parent.name}"
        result = _trained(out, robot, 0, engine, init=init)
        obs = 0.1 * torch.randn(8, 48)
        before, after = load_policy(init)(obs), load_policy(result.policy)(obs)
        # Of PPO, tanh bends what is large.
        expected = before if init == first else 3.0 * (before / 3.0).tanh()
        assert torch.allclose(after, expected, atol=1e-5)


def test_interrupted_and_resumed_it_ends_with_the_same_files(
    robot: Robot, tmp_path: Path
) -> None:
    """Memory, networks, temperature and chance: to the last byte, over the wrap."""
    engine = OffPolicy(cfg=SAC)
    _trained(tmp_path / "whole", robot, 6, engine)

    def interrupt(stats: IterationStats) -> None:
        if stats.iteration == 3:
            os.kill(os.getpid(), signal.SIGINT)

    out = tmp_path / "cut"
    assert not _trained(out, robot, 6, engine, on_iteration=interrupt).finished
    assert _trained(out, robot, 6, engine, resume=True).finished
    for name in ("policy.pt", "resume.pt"):
        whole = (tmp_path / "whole" / name).read_bytes()
        assert (out / name).read_bytes() == whole, name
    assert json.loads((out / "summary.json").read_text())["memory/steps"] == 400


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory, reaching: Path) -> Path:
    """A data set of episodes of that policy, of which half acts with noise."""
    root = tmp_path_factory.mktemp("recorded") / "set"
    dataset = Dataset.create(root)
    cfg = RecordCfg(episodes=10, episode_s=0.4, checkpoints=0)
    dataset.add_episodes(record(reaching / "policy.pt", cfg, seed=0))
    return root


def test_offline_it_learns_from_a_data_set_alone(
    recorded: Path, robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No step is taken; summary.json says how far it went from what was done.
    Interrupted and resumed it ends with the same files, and only with the same
    episodes."""
    lines: list[str] = []
    cfg = replace(SAC, clone_weight=2.0, updates_per_step=0.5)
    engine = OffPolicy(cfg=cfg, replay=(recorded,), offline=True, tell=lines.append)
    result = _trained(tmp_path, robot, 4, engine, reward_fn=_height)
    cut = tmp_path / "cut"

    def resumed(engine: OffPolicy = engine) -> TrainResult:
        return _trained(cut, robot, 4, engine, reward_fn=_height, resume=True)

    def interrupt(stats: IterationStats) -> None:
        if stats.iteration == 2:
            os.kill(os.getpid(), signal.SIGINT)

    first = _trained(cut, robot, 4, engine, reward_fn=_height, on_iteration=interrupt)
    assert not first.finished
    smaller = Dataset.create(tmp_path / "smaller")
    smaller.add_from(Dataset.open(recorded), [e.sha256 for e in _entries(recorded)[1:]])
    with pytest.raises(PolicyError, match="what --replay names holds other episodes"):
        resumed(replace(engine, replay=(smaller.root,)))

    def killed(session: Session, path: Path, steps: int) -> None:
        raise ProcessLookupError

    # Killed when the state says that it is finished, and the policy is not there.
    with monkeypatch.context() as patch:
        patch.setattr(Session, "_save_policy", killed)
        with pytest.raises(ProcessLookupError):
            resumed()
    assert resumed().stats is None
    for name in ("policy.pt", "resume.pt"):
        assert (cut / name).read_bytes() == (tmp_path / name).read_bytes(), name
    both = [json.loads((at / "summary.json").read_text()) for at in (tmp_path, cut)]
    for name in ("steps", "finished", "offline/action_distance", "train/return"):
        assert both[0][name] == both[1][name], name
    episodes = [Dataset.open(recorded).read(e.sha256) for e in _entries(recorded)]
    held = read_plain(tmp_path / "resume.pt")["ring"]
    steps = sum(len(each.action) for each in episodes)
    fell = sum(each.end_reason == "terminated" for each in episodes)
    assert f"{steps} steps of 10 episodes" in lines[0]
    # Each column but the last may end in the middle of an episode.
    assert steps - 3 <= int((~held["cut"]).sum()) <= steps
    assert int(held["fallen"].sum()) == fell
    known = torch.from_numpy(episodes[0].features.copy())
    columns = held["features"].unbind(1)
    assert any((each[: len(known)] == known).all() for each in columns)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert 0.0 < summary["offline/action_distance"] < 2.0
    assert result.stats is not None


def _entries(root: Path) -> tuple:
    return Dataset.open(root).entries()


@pytest.mark.parametrize("columns", [1, 3, 128])
@pytest.mark.parametrize("rows", [7, 40, 1000])
def test_of_a_data_set_as_much_is_kept_as_there_is_room_for(
    recorded: Path, robot: Robot, columns: int, rows: int
) -> None:
    """However long its episodes are and however many columns: the newest steps, each
    followed by what followed it."""
    dataset = Dataset.open(recorded)
    held = [rows_of_episode(dataset.read(e.sha256)) for e in _entries(recorded)]
    for each, episode in enumerate(held):
        episode["obs"] = episode["obs"].copy()
        episode["obs"][:, 0] = 1000 * each + np.arange(len(episode["cut"]))
    env = QuadrupedEnv(robot, ENV, 1, seed=0)
    place = Place(env=env, robot_sha256="", rows=rows, columns=columns)
    chunk = side_by_side(held, place)
    assert len(chunk.cut) <= rows
    all_rows = np.concatenate([each["cut"] for each in held])
    kept = all_rows[-rows * columns :]
    assert int((~chunk.cut).sum()) >= (~kept).sum() - columns
    follows = ~chunk.cut[:-1] & ~chunk.fallen[:-1]
    later = (chunk.obs[1:] - chunk.obs[:-1])[follows]
    assert (later[:, 0] == 1.0).all()
    assert (chunk.cut | chunk.fallen)[-1].all()
    assert chunk.starts[0].all()


def test_a_memory_of_another_ground_is_replayed_on_it(
    robot: Robot, tmp_path: Path
) -> None:
    """The robot is the same, whatever it stands on; and refused on flat ground."""
    on_steps = replace(ENV, terrain=TerrainCfg(kind="steps"))
    cfg = TrainCfg(steps=96, env=on_steps, ppo=PPO)
    train(tmp_path / "first", robot, cfg, engine=OffPolicy(cfg=SAC))
    engine = OffPolicy(cfg=SAC, replay=(tmp_path / "first",))
    train(tmp_path / "on", robot, cfg, engine=engine)
    assert read_plain(tmp_path / "on/resume.pt")["ring"]["reward"].numel() == 2 * 96
    with pytest.raises(PolicyError, match="trained with another env"):
        _trained(tmp_path / "flat", robot, 1, engine)


def test_what_the_data_do_not_hold_is_refused(
    recorded: Path, robot: Robot, tmp_path: Path
) -> None:
    """A reward that pays all steps alike, another robot, ground or rate, no episodes,
    other memory."""
    engine = OffPolicy(cfg=SAC, replay=(recorded,), offline=True)

    def same(features: Tensor, starts: Tensor) -> Tensor:
        return torch.ones(starts.shape)

    with pytest.raises(GaitprefError, match=r"pays all .* remembered steps alike"):
        _trained(tmp_path / "same", robot, 1, engine, reward_fn=same)
    beside = total_reward(same, robot, ENV, known=KnownTermsCfg(), keep_task=True)
    with pytest.raises(GaitprefError, match=r"pays all .* remembered steps alike"):
        _trained(tmp_path / "beside", robot, 1, engine, reward_fn=beside)
    uneven = replace(ENV, terrain=TerrainCfg(kind="steps"))
    xml = tmp_path / "other.xml"
    xml.write_text(mjcf(Drawing()))
    other = load_robot(xml, physics_dt_s=ENV.physics_dt_s)
    for on, env in ((robot, uneven), (other, ENV)):
        elsewhere = TrainCfg(steps=96, env=env, ppo=PPO)
        with pytest.raises(GaitprefError, match="it is of another robot or ground"):
            train(tmp_path / "elsewhere", on, elsewhere, engine=engine)
    slower = TrainCfg(steps=96, env=replace(ENV, substeps=8), ppo=PPO)
    with pytest.raises(GaitprefError, match=r"controlled at 50 Hz.* at 25 Hz"):
        train(tmp_path / "rate", robot, slower, engine=engine)
    wider = TrainCfg(steps=96, env=replace(ENV, action_scale_rad=0.5), ppo=PPO)
    with pytest.raises(GaitprefError, match="ask for other joint positions"):
        train(tmp_path / "scale", robot, wider, engine=engine)
    Dataset.create(tmp_path / "empty")
    with pytest.raises(GaitprefError, match="holds no episode"):
        _trained(
            tmp_path / "a", robot, 1, OffPolicy(cfg=SAC, replay=(tmp_path / "empty",))
        )
    with pytest.raises(GaitprefError, match="give --replay DATASET too"):
        _trained(tmp_path / "b", robot, 1, OffPolicy(cfg=SAC, offline=True))
    with pytest.raises(GaitprefError, match="give --memory"):
        _trained(tmp_path / "c", robot, 1, OffPolicy(cfg=replace(SAC, memory=10**7)))


def test_what_is_of_another_kind_is_refused(
    reaching: Path, recorded: Path, robot: Robot, tmp_path: Path
) -> None:
    """A memory of PPO, of other environments; what sees other things; networks of
    others among gaits, in a team, and of other sizes."""

    def untrained(name: str, env: EnvCfg) -> Path:
        cfg = TrainCfg(steps=0, env=env, ppo=PPO)
        return train(tmp_path / name, robot, cfg).policy

    imu = ENV.under(imu_law(robot, ENV, frames=1))
    plain, blind = untrained("plain", ENV), untrained("blind", imu)
    lying = getting_up(WALK, tmp_path / "lying.pt")
    more = TrainCfg(steps=192, env=ENV, ppo=replace(PPO, num_envs=8))
    unlike = TrainCfg(steps=96, env=imu, ppo=PPO)
    for out, cfg, replay, said in (
        ("a", more, plain.parent, "that training keeps no memory"),
        ("b", more, reaching, "4 columns, one an environment; give --envs 4"),
        ("c", unlike, recorded, "this policy sees something else"),
    ):
        engine = OffPolicy(cfg=SAC, replay=(replay,))
        with pytest.raises(GaitprefError, match=said):
            train(tmp_path / out, robot, cfg, engine=engine)
    wide = OffPolicy(cfg=replace(SAC, critic_sizes=(24,)))
    with pytest.raises(PolicyError, match=r"its critic does not fit: .*same sizes"):
        _trained(tmp_path / "d", robot, 1, wide, init=reaching / "policy.pt")
    fast = reaching / "policy.pt"
    for policy, of_gaits, of_team in (
        (fast, "is none of PPO's, as that of --algorithm", "and a team is trained by"),
        (blind, "sees and acts under a law of its own", "does not see the velocity"),
        (lying, "gets up and does not walk", ""),
    ):
        with pytest.raises(GaitprefError, match=of_gaits):
            load_gaits({"walk": WALK, "other": policy})
        if of_team:
            with pytest.raises(PolicyError, match=of_team):
                as_team(policy, TeamCfg())


def test_a_log_that_lacks_nothing_but_what_a_policy_saw_is_refused(
    recorded: Path, robot: Robot, tmp_path: Path
) -> None:
    """Its actions are known and its rows complete; and what of a data set can be
    replayed beside it, is."""
    lines: list[str] = []
    dataset = Dataset.open(recorded)
    truth = dataset.read(_entries(recorded)[0].sha256)

    def led(name: str) -> np.ndarray:
        rows = truth.features[:, column(name)]
        return np.vstack([rows[:1], rows])

    log = steps_from_qpos(
        robot,
        truth.qpos,
        truth.qvel,
        ENV.control_dt_s,
        command=truth.meta.command,
        contact=led("foot_contact"),
        torque=led("joint_torque"),
        action=led("action"),
    )
    assert np.isfinite(log.features).all()
    assert np.isfinite(log.action).all()
    alone = Dataset.create(tmp_path / "log")
    alone.add_episodes([log])
    engine = OffPolicy(cfg=SAC, replay=(alone.root,), tell=lines.append)
    refused = "none of its 1 episodes fits: it lacks numbers, as what a robot does not"
    with pytest.raises(GaitprefError, match=refused):
        _trained(tmp_path / "alone", robot, 1, engine)
    alone.add_episodes([truth])
    _trained(tmp_path / "beside", robot, 1, engine)
    assert "of 1 episodes are replayed, 1 left out: it lacks numbers" in lines[0]


def test_an_earlier_memory_is_scored_by_the_present_reward(
    reaching: Path, robot: Robot, tmp_path: Path
) -> None:
    """All of it, though it is full and was written over."""
    engine = OffPolicy(cfg=replace(SAC, memory=1000), replay=(reaching,))
    _trained(tmp_path, robot, 1, engine, reward_fn=_height, init=reaching / "policy.pt")
    ring = read_plain(tmp_path / "resume.pt")["ring"]
    assert len(ring["reward"]) == 400 // 4 + 24
    expected = ring["features"][..., HEIGHT][..., 0] * ~ring["cut"]
    assert torch.equal(ring["reward"], expected)
    assert (ring["version"] == 0).all()


@pytest.mark.parametrize("per_step", ["0", "-1", "nan", "inf"])
def test_updates_that_are_none_are_refused(
    per_step: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    given = ["train", "--out", str(out), "--reward", "task", "--algorithm", "fastsac"]
    assert main([*given, f"--updates-per-step={per_step}"]) == 2
    assert "--updates-per-step must be a number above 0" in capsys.readouterr().err
    assert not out.exists()


def test_networks_are_as_wide_as_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of actor and critics; one that goes on with a policy has the actor's sizes."""

    def trained(out: str, *more: str) -> int:
        given = ["train", "--out", str(tmp_path / out), "--reward", "task"]
        given += ["--algorithm", "fastsac", "--steps", "4", "--envs", "4"]
        return main([*given, *more])

    critic = ("--critic-sizes", "24")
    actor = ("--actor-sizes", "16", "8")
    assert trained("new", *critic, *actor) == 0
    made = tmp_path / "new" / "policy.pt"
    assert trained("on", *critic, "--init", str(made)) == 0
    for name in ("new", "on"):
        state = read_plain(tmp_path / name / "policy.pt")["offpolicy_state_dict"]
        assert [state[f"actor.hidden.{n}.weight"].shape[0] for n in (0, 1)] == [16, 8]
        assert state["critic.weights.0"].shape == (2, 60, 24)
        info = load_policy(tmp_path / name / "policy.pt").info
        assert info.ppo.hidden_sizes == (16, 8)
    assert trained("both", *actor, "--init", str(made)) == 2
    assert "--init has networks of its own" in capsys.readouterr().err
    for given in (actor, critic):
        assert trained("ppo", *given, "--algorithm", "ppo") == 2
        assert "is about off-policy learning" in capsys.readouterr().err
    for given, said in (
        (("--critic-sizes", "100000000"), "--critic-sizes must be at most 4096"),
        (("--actor-sizes", "16", "5000"), "--actor-sizes must be at most 4096"),
        (("--exploration", "rnd"), "an exploration bonus and a KL penalty are PPO's"),
        (("--kl-penalty", "fixed"), "an exploration bonus and a KL penalty are PPO's"),
    ):
        assert trained("ppo", *given) == 2
        assert said in capsys.readouterr().err
    command = Train(out=tmp_path, reward="task", algorithm="fastsac")
    with pytest.raises(GaitprefError, match="start it without torchrun"):
        off_policy_of(command, None, Ranks(rank=1, size=2), print)
    with pytest.raises(GaitprefError, match="learns from all of them"):
        off_policy_of(replace(command, most_lag=1), None, Ranks(), print)


@pytest.mark.parametrize(
    ("done", "entropy"), [(0.0, 0.4), (0.5, 0.4), (0.7, -0.3), (0.9, -1.0), (1.0, -1.0)]
)
def test_noise_comes_down_over_most_of_the_other_half(
    done: float, entropy: float
) -> None:
    cfg = SacCfg(joint_entropy=0.4, last_joint_entropy=-1.0)
    assert cfg.joint_entropy_at(done) == pytest.approx(entropy)


@pytest.mark.parametrize(("wanted", "rises"), [(5.0, True), (-20.0, False)])
def test_the_temperature_goes_where_the_noise_is_wanted(
    wanted: float, rises: bool
) -> None:
    """Up while there is less than is wanted, down while there is more."""
    torch.manual_seed(0)
    learner = Sac(replace(SAC, actor_every=1), 48, torch.ones(12), (16,))
    learner.joint_entropy = wanted
    figures, _ = learner.update(_batch())
    assert (float(figures["entropy"]) < 12 * wanted) == rises
    assert (float(figures["temperature"]) > SAC.first_alpha) == rises


def _batch() -> Batch:
    return Batch(
        obs=torch.randn(8, 48),
        action=torch.randn(8, 12).tanh(),
        gain=torch.randn(8),
        later_obs=torch.randn(8, 48),
        discount=torch.rand(8),
        place=torch.arange(8),
    )


def test_half_of_a_batch_is_learned_from_in_the_mirror(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was seen, done and led to; with `--mirror`, and what is paid stays."""
    mirror, batch = mirror_of(robot), _batch()
    mirrored = half_mirrored(batch, mirror)
    for name, image in (
        ("obs", mirror.obs),
        ("action", mirror.action),
        ("later_obs", mirror.obs),
    ):
        before, after = getattr(batch, name), getattr(mirrored, name)
        assert torch.equal(after[:4], image(before[:4]))
        assert not torch.equal(after[:4], before[:4])
        assert torch.equal(after[4:], before[4:])
    assert torch.equal(mirrored.gain, batch.gain)
    seen: list[Tensor] = []

    def learned(self: Sac, given: Batch) -> tuple[dict[str, Tensor], Tensor]:
        seen.append(given.obs)
        return {}, given.gain

    monkeypatch.setattr(Ring, "sample", lambda *_, **__: batch)
    monkeypatch.setattr(Ring, "learned", lambda *_: None)
    monkeypatch.setattr(Sac, "update", learned)
    for on in (True, False):
        cfg = TrainCfg(steps=96, env=ENV, ppo=replace(PPO, mirror=on))
        runner = OffPolicy(cfg=SAC)(robot, cfg, 0)
        runner.alg.learn(runner.ring, 1)
    assert torch.equal(seen[0], mirrored.obs)
    assert torch.equal(seen[1], batch.obs)
