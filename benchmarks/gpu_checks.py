"""Whether a GPU does what the CPU does: features, resets, robots that diverge."""

from __future__ import annotations

import torch
from torch import Tensor

from policy.env.randomise import make_env

from .gpu_bench import ENV, Bench
from .gpu_parity import MOST_APART, converging, nudged, run_of


@torch.inference_mode()
def parity(bench: Bench) -> None:
    """Features and contacts of 50 control steps against those of the CPU, and those of
    the CPU against its own from starts that are float32's last digit off."""
    count, steps = bench.options.envs, 50
    rng = torch.Generator().manual_seed(1)
    actions = 0.5 * torch.randn(steps, count, 12, generator=rng)
    robot = converging(bench.robot)
    ours = make_env(robot, ENV, count, seed=0, sim=bench.cfg)
    theirs = make_env(robot, ENV, count, seed=0)
    start, command = theirs.sim.raw_state(), theirs.command.clone()
    run = run_of(theirs, start, command, actions, watch=True)
    again = run_of(theirs, nudged(start, 1e-7, rng=rng), command, actions)
    found = run_of(ours, start, command, actions)
    apart, own = found.apart(run), again.apart(run)
    alike, decided = found.touches_alike(run), run.decided
    within = _share(apart[:, decided] <= MOST_APART)
    touching = _share(alike[:, decided])
    bench.write(
        "parity",
        {
            "worlds": count,
            "within_1e-3": _share(apart[-1] <= MOST_APART),
            "cpu_itself_within_1e-3": _share(own[-1] <= MOST_APART),
            "decided": _share(decided),
            "decided_within_1e-3": within,
            "decided_contacts_alike": touching,
            "contacts_alike": _share(alike),
            "median_apart": float(apart[-1].median()),
            "cpu_itself_median_apart": float(own[-1].median()),
            "passed": within >= 0.999 and touching >= 0.999,
        },
    )


def _share(what: Tensor) -> float:
    return float(what.double().mean())


@torch.inference_mode()
def reset(bench: Bench) -> None:
    """A reset of every third robot leaves the others as they were, to the last bit."""
    count = bench.options.envs
    env = make_env(bench.robot, ENV, count, seed=0, sim=bench.cfg)
    for action in bench.actions(count):
        env.step(action)
    before = env.sim.snapshot()
    mask = torch.arange(count, device=env.device) % 3 == 0
    rows = env.sim.rows(mask)
    assert rows is not None
    qpos, qvel = (state * 0 for state in env.sim.raw_state())
    qpos += torch.tensor(bench.robot.home_qpos, device=env.device)
    env.sim.reset(rows, qpos, qvel)
    env.sim.read()
    after = env.sim.snapshot()
    others = bool((before[~mask] == after[~mask]).all())
    fresh = bool(((env.sim.raw_state()[0] - qpos)[mask].abs() < 1e-5).all())
    bench.write(
        "reset",
        {"worlds": count, "others_alike": others, "reset": fresh, "passed": others},
    )


@torch.inference_mode()
def diverged(bench: Bench) -> None:
    """A robot that is no number any more is found, ended and started anew."""
    count = bench.options.envs
    env = make_env(bench.robot, ENV, count, seed=0, sim=bench.cfg)
    actions = bench.actions(count)
    env.step(actions[0])
    poisoned = actions[1].clone()
    poisoned[1] = float("nan")
    _, _, dones, extras = env.step(poisoned)
    found = extras["aborted"].nonzero().flatten().tolist()
    obs = env.step(actions[2])[0]["policy"]
    sound = bool(obs.isfinite().all()) and bool(dones[1])
    bench.write(
        "diverged",
        {"found": str(found), "sound": sound, "passed": found == [1] and sound},
    )
