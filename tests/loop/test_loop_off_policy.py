"""A loop that learns off-policy: each training goes on with the memory of the last."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from data.errors import GaitprefError
from data.files.plain import from_plain, to_plain
from gaitpref.cli.options.options import Loop
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.loop import run as run_module
from gaitpref.loop.loop_cfg import LoopCfg, StepsCfg
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_config import read_config
from gaitpref.loop.run_dir import Round, trained_before
from policy.offpolicy.sac_cfg import PriorityCfg, SacCfg
from policy.robots.shipped import WALK
from policy.rollouts.record_cfg import RecordCfg
from policy.sim.making import SimCfg
from policy.training.checkpoint import load_policy, read_plain, saved_bytes
from policy.training.ppo import PpoCfg
from tests.helpers.two_ranks import ENV

LEARNER = SacCfg(
    critic_sizes=(16,), learn_from=200, memory=2000, updates_per_step=0.02, batch=32
)


def _cfg(**more: object) -> LoopCfg:
    """One round, a dozen answers, a base of its own."""
    asked = Loop(
        run=Path(),
        criterion="task",
        rounds=1,
        labels=12,
        base="task",
        algorithm="fastsac",
    )
    cfg = resolve(replace(asked, **more))
    return replace(
        cfg,
        method=replace(cfg.method, learner=replace(LEARNER, priorities=PriorityCfg())),
        steps=StepsCfg(base=512, round=512, last=512),
        evaluation_episodes=8,
        ppo=PpoCfg(num_envs=16, hidden_sizes=(16,)),
        record=RecordCfg(episodes=16, episode_s=2.0),
        env=replace(cfg.env, episode_s=ENV.episode_s),
    )


def test_a_round_goes_on_with_what_the_one_before_remembers(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """All of it, scored by the reward that was fitted since, step by step; the run
    tells its learner, and the same command finds nothing to do."""
    # Its films take longer than the loop.
    monkeypatch.setattr(run_module, "write_report", lambda *_: None)
    cfg = _cfg()
    run_loop(tmp_path, cfg)
    told = " ".join(capsys.readouterr().err.split())
    assert told.count("following commands worse costs nothing more") == 1
    first, last = (Round(tmp_path, number) for number in (0, 1))
    assert trained_before(last) == (first.policy.parent,)
    # The last policy has to be preferred to stay; its training is there either way.
    folder = next(
        path for path in (last.candidate, last.policy.parent) if path.exists()
    )
    before, after = (
        read_plain(path / "resume.pt") for path in (first.policy.parent, folder)
    )
    rings = before["ring"], after["ring"]
    assert torch.equal(rings[1]["features"][:32], rings[0]["features"])
    assert len(rings[1]["features"]) == 64
    assert len(rings[1]["version"].unique()) == 1
    alike = rings[0]["reward"] == rings[1]["reward"][:32]
    assert alike[~rings[0]["cut"]].float().mean() < 0.01
    assert min(each["updates"] for each in (before, after)) > 0
    assert read_config(tmp_path) == cfg
    stamp = last.report.stat().st_mtime_ns
    run_loop(tmp_path, cfg)
    assert last.report.stat().st_mtime_ns == stamp
    assert (load_policy(first.policy).std > 0).all()


def test_who_learns_is_told_and_older_runs_are_as_they_were() -> None:
    plain, fast = (resolve(Loop(run=Path(), algorithm=a)) for a in ("ppo", "fastsac"))
    assert "learner" not in to_plain(plain, whole=True)["method"]
    assert fast.method == replace(plain.method, learner=SacCfg(), exploration=None)
    told = to_plain(fast, whole=True)
    assert told["method"]["learner"]["gamma"] == SacCfg().gamma
    assert from_plain(LoopCfg, told) == fast


def test_networks_of_a_loop_are_as_wide_as_is_said() -> None:
    """A policy it begins with has sizes already, and PPO knows only its own."""
    own = Loop(run=Path(), actor_sizes=(16, 8), critic_sizes=(24,))
    cfg = resolve(replace(own, algorithm="fastsac", base="task"))
    assert cfg.ppo.hidden_sizes == (16, 8)
    assert cfg.method.learner == SacCfg(critic_sizes=(24,))
    with pytest.raises(GaitprefError, match="--base walk has networks of its own"):
        resolve(replace(own, algorithm="fastsac"))
    with pytest.raises(GaitprefError, match="give --algorithm fastsac too"):
        resolve(replace(own, actor_sizes=()))


def test_what_cannot_be_learned_so_is_refused_before_anybody_answers(
    tmp_path: Path,
) -> None:
    cfg = _cfg()
    cuda = replace(cfg.steps, sim=SimCfg(device="cuda"))
    with pytest.raises(GaitprefError, match="on the processor: leave --device out"):
        replace(cfg, steps=cuda)
    short = replace(cfg.method, learner=replace(LEARNER, memory=50))
    with pytest.raises(GaitprefError, match="give --memory"):
        replace(cfg, method=short)
    foreign = tmp_path / "foreign.pt"
    payload = read_plain(WALK)
    actor = payload["actor_state_dict"]
    others = {name.replace("mlp.0.", "mlp.w"): value for name, value in actor.items()}
    foreign.write_bytes(saved_bytes({**payload, "actor_state_dict": others}))
    with pytest.raises(GaitprefError, match="its network came from elsewhere"):
        run_loop(tmp_path / "run", replace(cfg, base=str(foreign)))
    assert not (tmp_path / "run" / "config.yaml").exists()
