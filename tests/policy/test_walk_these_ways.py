"""A policy in the layout of Walk These Ways: what it sees and does, computed anew.

It sees 30 frames of 70 numbers: gravity, 15 commands of which 12 say the gait, joints,
the last two actions and a clock of four feet. Networks are small and of chance; widths
and files are the trainer's.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from policy.env.env import QuadrupedEnv
from policy.exported.policy_json import describe
from policy.imported.alternatives import others
from policy.imported.bring import bring, embodied, understand
from policy.imported.given_back import export_like
from policy.imported.meaning.draft import LEFT_FIRST
from policy.imported.meaning.law_toml import law_toml, read_law_toml
from policy.imported.meaning.own_words import of_own
from policy.imported.trial import measure
from policy.law.gait import Gait, clock
from policy.law.law import LawError, Term
from policy.networks.recipe import NetworkError
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import load_policy
from policy.training.setup import setting_of
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.foreign_layouts import law_in

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
PRESET = "walk-these-ways"
BODY, ADAPTATION = "body_latest.jit", "adaptation_module_latest.jit"
COMMAND = (0.6, -0.2, 0.3)
ASKED = [1.2, -0.4, 0.075, 0.0, 3.0, 0.5, 0.0, 0.0, 0.5, 0.012, 0, 0, 0.25, 0.4, 0]
"""The command and a trot, scaled as the trainer does."""
POSE = np.array([0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5])
"""FL FR RL RR, hip thigh calf."""
REACH = np.array([0.125, 0.25, 0.25] * 4)


class _Theirs:
    """The two networks of a run, by torch's own modules."""

    def __init__(self, folder: Path, seen: int = 2100) -> None:
        torch.manual_seed(5)
        self.guesses = nn.Sequential(nn.Linear(seen, 8), nn.ELU(), nn.Linear(8, 2))
        self.body = nn.Sequential(nn.Linear(seen + 2, 16), nn.ELU(), nn.Linear(16, 12))
        folder.mkdir(parents=True)
        for name, module in ((ADAPTATION, self.guesses), (BODY, self.body)):
            torch.jit.save(torch.jit.script(module), folder / name)

    def act(self, seen: Tensor) -> Tensor:
        with torch.no_grad():
            return self.body(torch.cat((seen, self.guesses(seen)), dim=-1))


class _Seen:
    """Observations of one robot as its trainer keeps them: a clock that is counted on,
    frames that are pushed."""

    def __init__(self) -> None:
        self.turn, self.history = 0.0, np.zeros(2100)
        self.action, self.before = np.zeros(12), np.zeros(12)

    def look(self, gravity: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> None:
        trot = [self.turn + 0.5, self.turn, self.turn, self.turn + 0.5]
        feet = [np.sin(2 * np.pi * turn) for turn in trot]
        frame = [gravity, ASKED, angle - POSE, 0.05 * speed, self.action, self.before]
        self.history = np.concatenate([self.history[70:], *frame, feet])

    def done(self, action: np.ndarray) -> None:
        self.before, self.action = self.action, np.clip(action, -10, 10)
        self.turn = (self.turn + 0.02 * 3.0) % 1.0


def test_what_it_sees_and_does_is_as_computed_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To 1e-5 from rest, over a new episode and a resumed one; its papers name what was
    guessed; it is recorded, trained on, described, and goes out in two files."""
    # How it walks is of no interest: nobody trained it.
    short = partial(measure, walk_s=0.2)
    monkeypatch.setattr("policy.imported.bring.measure", short)
    run = tmp_path / "run"
    theirs = _Theirs(run / "checkpoints")
    known = understand(run, preset=PRESET)
    policy = bring(known, None, tmp_path / "in")
    robot, law = policy.robot(), policy.info.env.law
    assert law is not None
    assert law.obs_dim == 2100
    assert policy.info.origin is not None
    assert policy.info.origin.kind == "TorchScript in two files"
    named = {"gait", "gait_clock", "before", "frames", "kp_nm_per_rad", "action_limit"}
    assert named <= policy.info.origin.guessed.keys()

    env = QuadrupedEnv(robot, replace(policy.info.env, episode_s=0.4), 1, seed=4)
    env.fix_commands(torch.tensor([COMMAND]))
    order = [robot.qpos_adr[i] for i in law.from_canonical]
    speeds = [robot.qvel_adr[i] for i in law.from_canonical]
    assert law.joints == LEFT_FIRST
    seen, rotation, restored = _Seen(), np.empty(9), 0
    for step in range(1, 31):
        qpos, qvel = (rows[0].numpy() for rows in env.sim.raw_state())
        mujoco.mju_quat2Mat(rotation, qpos[3:7])
        seen.look(-rotation[6:], qpos[order], qvel[speeds])
        obs = env.get_observations()["policy"]
        assert obs[0].numpy() == pytest.approx(seen.history, abs=1e-5)
        wanted = theirs.act(obs)[0].numpy()
        action = policy(obs)
        assert law.canonical(wanted.tolist()) == pytest.approx(
            action[0].numpy(), abs=1e-5
        )
        _, _, dones, extras = env.step(action)
        target = law.canonical((POSE + REACH * wanted.clip(-10, 10)).tolist())
        assert extras["targets"][0].numpy() == pytest.approx(target, abs=1e-5)
        seen.done(wanted)
        if dones[0]:
            seen = _Seen()
        if step == 10:
            # Another environment goes on where this one was stopped.
            other = QuadrupedEnv(robot, env.cfg, 1, seed=9)
            other.fix_commands(torch.tensor([COMMAND]))
            other.restore(env.snapshot())
            env, restored = other, restored + 1
    assert restored == 1

    told = json.dumps(describe(policy.info, robot, policy.sha256))
    assert of_own(told, "policy.json").gait == law.gait
    told = json.loads(told)["law_record"]
    assert (told["before"], told["gait"]["frequency_hz"]) == ("zeros", 3.0)
    cfg = RecordCfg(episodes=1, episode_s=0.2, checkpoints=0)
    (episode,) = record(tmp_path / "in" / "policy.pt", cfg, seed=1)
    # What was seen before each of 10 steps and after the last is ours, as of all.
    assert episode.obs.shape == (11, 48)

    setting = setting_of(tmp_path / "in" / "policy.pt", None)
    ppo = replace(setting.ppo, num_envs=2, steps_per_env=8, epochs=1, minibatches=1)
    steps = 12 * ppo.steps_per_iteration
    on = train(
        tmp_path / "on",
        setting.robot,
        TrainCfg(steps=steps, env=setting.env, ppo=ppo),
        init=tmp_path / "in" / "policy.pt",
    )
    export_like(load_policy(on.policy), run, tmp_path / "out")
    again = understand(tmp_path / "out", preset=PRESET)
    obs = torch.randn(4, 2100, generator=torch.Generator().manual_seed(3))
    acted = again.found.network(tuple(law.to_canonical.tolist()))(obs).detach()
    assert acted.numpy() == pytest.approx(load_policy(on.policy)(obs).numpy(), abs=1e-5)
    first = dict(again.found.tensors)
    moved = {
        n.split(".")[0] for n, t in known.found.tensors.items() if (t != first[n]).any()
    }
    assert moved == {"body", "adaptation_module"}


def test_a_clock_stands_for_half_of_its_sine() -> None:
    """By hand, of feet that stand for a quarter of each cycle of a second."""
    gait = Gait(frequency_hz=1.0, phase=0.5, offset=0.25, bound=0.0, duration=0.25)
    feet = clock(gait, torch.tensor([0.0, 0.125, 1.125], dtype=torch.float64))
    # At 0: FL 0.75 is 2/3 of a swing, FR 0.25 lands or lifts, RL begins, RR 0.5.
    halves = [0.5 + 0.5 * 2 / 3, 0.5, 0.0, 0.5 + 0.5 / 3]
    assert feet[0].numpy() == pytest.approx(np.sin(2 * np.pi * np.array(halves)))
    assert feet[1, 2] == pytest.approx(1.0)
    assert feet[2].numpy() == pytest.approx(feet[1].numpy())


def test_another_gait_is_said_in_a_toml(tmp_path: Path) -> None:
    """--explain prints what --law takes; numbers that make no gait are refused."""
    _Theirs(tmp_path / "run", seen=70 * 3)
    run, file = tmp_path / "run", tmp_path / "law.toml"
    known = understand(run, preset=PRESET)
    file.write_text(law_toml(known.draft))
    alone = understand(run, law=file)
    assert embodied(alone, None)[0] == embodied(known, None)[0]
    file.write_text("[gait]\nfrequency_hz = 2\nphase = 0.0\n")
    known = understand(run, law=file, preset=PRESET)
    assert known.draft.gait == Gait(frequency_hz=2.0, phase=0.0)
    assert known.draft.terms is not None
    assert known.draft.terms[0].frames == 3
    assert "gait" not in known.draft.guessed
    told = dict(others(known))
    assert told["hips at twice their scale"].draft.action_scale_rad == (0.25,) * 12
    for bad in ("gait = 3", "[gait]\nhop = 1", "before = 3", "[gait]\nphase = 'a'"):
        file.write_text(bad)
        with pytest.raises(LawError, match=r"\[gait\] holds|before must be"):
            read_law_toml(file)
    file.write_text("[gait]\nduration = 1.0\n")
    with pytest.raises(LawError, match="the gait needs"):
        embodied(understand(run, law=file, preset=PRESET), None)
    with pytest.raises(LawError, match="need a gait"):
        law_in(LEFT_FIRST, terms=(Term(name="gait_clock"),))


def test_one_file_of_two_is_not_enough(tmp_path: Path) -> None:
    """The other is named, and files that do not fit each other are refused."""
    run = tmp_path / "run"
    theirs = _Theirs(run, seen=210)
    torch.jit.save(torch.jit.script(nn.Linear(210, 3)), run / ADAPTATION)
    with pytest.raises(NetworkError, match=r"body_latest\.jit: its operations do not"):
        understand(run, preset=PRESET)
    (run / ADAPTATION).unlink()
    with pytest.raises(NetworkError, match=f"by what {ADAPTATION} guesses"):
        understand(run, preset=PRESET)
    assert theirs.act(torch.zeros(1, 210)).shape == (1, 12)
