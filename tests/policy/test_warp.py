"""MuJoCo Warp behind the environment, on Warp's CPU device.

Kernels compile once a machine, half a minute of one core; one environment of either
kind serves all tests.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from benchmarks import gpu, gpu_speed, gpu_table
from benchmarks.gpu_bench import PARTS, Options
from benchmarks.gpu_parity import MOST_APART, converging, nudged, run_of
from benchmarks.throughput import learned_reward
from data.features import column
from gaitpref.cli.main import main
from policy.env.curriculum import CurriculumCfg
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import RANDOMISE, EnvCfg
from policy.env.randomise import RandomisedEnv, make_env
from policy.robots.robot import Robot, load_robot
from policy.robots.shipped import WALK
from policy.sim.chosen import Rows
from policy.sim.draw import Draw
from policy.sim.making import SimCfg
from policy.sim.sim import SimError
from policy.training.checkpoint import load_policy, read_plain
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.required import needed

# Warp opens every GPU it sees.
os.environ["CUDA_VISIBLE_DEVICES"] = ""
needed("mujoco_warp", "WARP")
wp = needed("warp", "WARP")

N = 256
ENV = EnvCfg(randomise=RANDOMISE["full"])
WARP = SimCfg(kind="warp")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return converging(load_robot(physics_dt_s=ENV.physics_dt_s))


@pytest.fixture(scope="module")
def env(robot: Robot) -> RandomisedEnv:
    """Robots that differ: what holds of them holds of those that are alike."""
    made = make_env(robot, ENV, N, seed=0, sim=WARP)
    assert isinstance(made, RandomisedEnv)
    return made


def _everyone(env: QuadrupedEnv) -> Rows:
    return _rows(env, torch.ones(N, dtype=torch.bool))


def _rows(env: QuadrupedEnv, mask: Tensor) -> Rows:
    rows = env.sim.rows(mask)
    assert rows is not None
    return rows


def test_features_are_those_of_the_cpu(robot: Robot, env: RandomisedEnv) -> None:
    """Robots that differ in friction, masses, strength, delay and encoders, 50 control
    steps of random actions, every one of them looked at.

    Where the last digits decide no touchdown, every feature is within 1e-3 (as a share
    of one plus its size) and the same feet touch. Where they do, robots may part: no
    more of them than of MuJoCo's own, put a micrometre off at the start.
    """
    other = make_env(robot, ENV, N, seed=1)
    assert isinstance(other, RandomisedEnv)
    env.sim.vary(_everyone(env), Draw.of_columns(other.sim.draw.columns))
    start, command = other.sim.raw_state(), other.command.clone()
    rng = torch.Generator().manual_seed(0)
    actions = 0.5 * torch.randn(50, N, 12, generator=rng)
    cpu = run_of(other, start, command, actions, watch=True)
    own = run_of(other, nudged(start, 1e-6, rng=rng), command, actions)
    warp = run_of(env, start, command, actions)
    decided, apart = cpu.decided, warp.apart(cpu)
    assert decided.float().mean() > 0.75
    assert apart[:, decided].max() < MOST_APART
    assert warp.touches_alike(cpu)[:, decided].all()
    assert apart[-1].median() < 2e-5
    parted = (apart > MOST_APART).any(dim=0).sum()
    assert parted <= (own.apart(cpu) > MOST_APART).any(dim=0).sum()
    touching = cpu.rows[..., column("foot_contact")].mean()
    assert 0.2 < touching < 1.0


def test_a_reset_leaves_the_others_as_they_were(env: RandomisedEnv) -> None:
    """Some are where they were put, and nothing of the others has changed by a bit."""
    for _ in range(5):
        env.step(torch.randn(N, 12))
    before, (qpos, qvel) = env.sim.snapshot(), env.sim.raw_state()
    seen = env.sim.read()
    mask = torch.arange(N) % 3 == 0
    env.sim.reset(_rows(env, mask), qpos + 0.01, torch.zeros_like(qvel))
    state, after = env.sim.read(), env.sim.snapshot()
    assert after[~mask].equal(before[~mask])
    assert state.joint_pos[mask].sub(seen.joint_pos[mask]).sub(0.01).abs().max() < 1e-6
    assert state.foot_height[~mask].equal(seen.foot_height[~mask])
    assert not state.foot_height[mask].equal(seen.foot_height[mask])


def test_a_robot_that_diverged_is_ended_and_no_other(env: RandomisedEnv) -> None:
    """A row of zeros, bootstrapped, and a new episode of numbers behind it."""
    action = torch.zeros(N, 12)
    env.step(action)
    action[7] = float("nan")
    _, _, dones, extras = env.step(action)
    # Its targets may come one step late.
    again = env.step(torch.zeros(N, 12))
    aborted = extras["aborted"] | again[3]["aborted"]
    assert aborted.nonzero().flatten().tolist() == [7]
    assert again[0]["policy"].isfinite().all()
    first = extras["aborted"][7]
    told, ended = (extras, dones) if first else (again[3], again[2])
    assert ended[7]
    assert told["time_outs"][7]
    assert (told["features"][7] == 0).all()


def test_it_goes_on_from_a_snapshot_bit_for_bit(env: RandomisedEnv) -> None:
    """On Warp's CPU device; a GPU adds in another order every time."""
    snapshot = {name: value.clone() for name, value in env.snapshot().items()}
    actions = 0.3 * torch.randn(3, N, 12)
    both = []
    for _ in range(2):
        env.restore(snapshot)
        both.append(torch.stack([env.step(each)[3]["features"] for each in actions]))
    assert both[0].equal(both[1])


def test_what_is_trained_on_it_plays_and_goes_on(robot: Robot, tmp_path: Path) -> None:
    """A policy file and a state to resume; episodes of the policy come from the CPU."""
    out, dataset = tmp_path / "run", tmp_path / "data"
    cfg = TrainCfg(
        steps=768,
        env=replace(EnvCfg(), episode_s=1.0),
        ppo=PpoCfg(num_envs=16, steps_per_env=24),
        sim=WARP,
    )
    assert train(out, robot, replace(cfg, steps=384)).finished
    assert train(out, robot, cfg, resume=True).steps == 768
    assert load_policy(out / "policy.pt").info.steps == 768
    recorded = ["record", "--policy", str(out / "policy.pt"), "--episodes", "4"]
    assert main([*recorded, "--dataset", str(dataset), "--episode-s", "0.5"]) == 0
    assert len(list(dataset.glob("rollouts/*/*.mcap"))) == 4


def test_a_policy_of_the_cpu_trains_on_there(robot: Robot, tmp_path: Path) -> None:
    """On a learned reward, under commands that widen; where its critic only looks on,
    it still acts as it did."""
    widening = CurriculumCfg(start=0.4, end=1.0, widen=0.2, good=0.01, window_s=0.1)
    cfg = TrainCfg(
        steps=384,
        env=replace(EnvCfg(), episode_s=1.0, curriculum=widening),
        ppo=PpoCfg(num_envs=16, steps_per_env=24),
        sim=WARP,
    )
    result = train(tmp_path, robot, cfg, init=WALK, reward_fn=learned_reward())
    assert result.finished
    state = read_plain(tmp_path / "resume.pt")
    assert state["env"]["curriculum"][0] == 1.0
    obs = torch.randn(64, 48, generator=torch.Generator().manual_seed(0))
    before, after = (load_policy(p)(obs) for p in (WALK, result.policy))
    assert (after - before).abs().mean() < 0.1 * before.std()


class _Synced(TorchDispatchMode):
    """Notes what would make the CPU wait for a GPU."""

    def __init__(self, seen: list[str]) -> None:
        super().__init__()
        self._seen = seen

    def __torch_dispatch__(
        self, func: Any, types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        name = func.overloadpacket.__name__
        waits = {"is_nonzero", "item", "_local_scalar_dense"}
        waits |= {"nonzero", "equal", "masked_select", "_unique2"}
        chosen = args[1] if name in ("index", "index_put_") else ()
        by_mask = any(each is not None and each.dtype == torch.bool for each in chosen)
        if name in waits or by_mask:
            self._seen.append(name)
        return func(*args, **(kwargs or {}))


def test_a_step_copies_nothing_to_the_cpu(
    env: RandomisedEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Noise, pushes, falls and resets included. What is captured as a graph on a GPU is
    left out: there a copy would be an error."""
    from policy.sim.warp_graphs import Graphs

    seen: list[str] = []
    inside: list[bool] = []
    run = Graphs._run

    def captured(self: Graphs, key: Any, work: Callable[[], None]) -> None:
        inside.append(True)
        run(self, key, work)
        inside.pop()

    def noted(kind: type, name: str) -> None:
        own = getattr(kind, name)

        def call(self: Any, *args: Any, **more: Any) -> Any:
            if not inside:
                seen.append(name)
            return own(self, *args, **more)

        monkeypatch.setattr(kind, name, call)

    monkeypatch.setattr(Graphs, "_run", captured)
    for kind, names in (
        (torch.Tensor, ("numpy", "cpu", "tolist", "__array__")),
        (wp.array, ("numpy", "list")),
    ):
        for name in names:
            noted(kind, name)
    assert torch.zeros(1).tolist() == [0.0]
    assert seen.pop() == "tolist"
    env.episode_length_buf[::2] = env.max_episode_length - 2
    ended = torch.zeros(N, dtype=torch.bool)
    with torch.inference_mode(), _Synced(seen):
        for _ in range(3):
            ended |= env.step(torch.randn(N, 12), score=False)[2]
    assert seen == []
    assert ended.any()


def test_what_measures_a_gpu_runs_on_warps_cpu_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each part writes the rows that the table has; its figures mean nothing here."""

    def walks(path: Path, *, episodes: int) -> Any:
        assert path.parent.parent.name.startswith("walk-1-")
        return SimpleNamespace(
            steps=load_policy(path).info.steps,
            evaluation=SimpleNamespace(tracking_error_m_s=0.1),
            walking=SimpleNamespace(walks=True),
        )

    monkeypatch.setattr(gpu_speed, "look", walks)
    # A control step costs some 0.1 s here, however few the worlds are.
    monkeypatch.setattr(gpu_speed, "PpoCfg", partial(PpoCfg, steps_per_env=4))
    assert Options().seeds == (0, 1)
    options = Options(
        device="cpu",
        # One is no check and no figure, the other is "env" once more.
        parts=tuple(part for part in PARTS if part not in ("profile", "varied")),
        sizes=(4,),
        envs=4,
        turn_s=1e-3,
        iterations=1,
        walk_iterations=2,
        walk_every=1,
        seeds=(1,),
        out=tmp_path / "rows",
        work=tmp_path / "work",
    )
    gpu.main(options)
    rows = {p.stem: json.loads(p.read_text()) for p in options.out.glob("*.json")}
    small = {re.sub("-(1024|4096|8192)$", "-4", name) for name in gpu_table.FILES}
    assert small - {"varied-4", "walk-0"} == rows.keys()
    assert rows["parity"]["decided_within_1e-3"] >= 0.999
    assert rows["reset"]["passed"]
    assert rows["diverged"]["passed"]
    assert rows["walk-1"]["steps"] == 16
    assert 0.0 < rows["walk-1"]["walk_s"] < rows["walk-1"]["trained_s"] + 1.0
    page = tmp_path / "page.md"
    page.write_text("<!-- gpu: begin -->\n<!-- gpu: end -->\n")
    gpu_table.main(gpu_table.Options(rows=options.out, page=page))
    told = "| a reset leaves the others alone | True | True | Warp's CPU device |"
    assert told in page.read_text()


def test_a_gpu_that_is_not_there_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    told = ["train", "--out", str(tmp_path / "run"), "--reward", "task"]
    assert main([*told, "--device", "cuda"]) == 2
    line = capsys.readouterr().err.strip()
    assert "--device cuda needs an NVIDIA GPU" in line
    assert "\n" not in line
    assert not (tmp_path / "run" / "resume.pt").exists()
    with pytest.raises(SimError, match="--sim threads runs on the processor alone"):
        SimCfg(device="cuda", kind="threads")


def test_a_package_that_is_not_installed_is_told_with_its_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a machine without it: Python does not import a module that is None."""
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    told = ["train", "--out", str(tmp_path / "run"), "--reward", "task"]
    assert main([*told, "--sim", "warp"]) == 2
    line = capsys.readouterr().err.strip()
    assert "pip install -e '.[gpu]'" in line
    assert "\n" not in line
