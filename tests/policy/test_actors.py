"""Actors on a real Ray: who dies is replaced, and nothing is used twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from gaitpref.watch.run_state import RunReader
from policy.engines.actors_cfg import ActorsCfg, ActorsError
from policy.engines.with_actors import WithActors
from policy.parallel import ray_connection
from policy.robots.robot import load_robot
from policy.training.checkpoint import load_policy, read_plain
from policy.training.ppo import IterationStats
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.required import needed
from tests.helpers.two_ranks import ENV, ONE_BATCH

ray = needed("ray", "RAY")

ROOT = Path(__file__).resolve().parents[2]
ITERATIONS = 12
CFG = TrainCfg(
    steps=ITERATIONS * ONE_BATCH.steps_per_iteration,
    env=ENV,
    ppo=ONE_BATCH,
    save_every=1,
)
# Ray leaves log files and sockets to the end of the process.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
SMALL = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": 80 * 2**20}


@pytest.fixture
def cluster() -> Iterator[Any]:
    """Two machines of one core each, on this one."""
    utils = needed("ray.cluster_utils", "RAY")
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}
    made = utils.Cluster(initialize_head=True, head_node_args=SMALL)
    try:
        yield made
    finally:
        made.shutdown()


def _actors_on(root: int) -> list[int]:
    """Process ids of actors that the process `root` has started in any generation."""
    parents = {}
    names = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                after = (entry / "stat").read_text().rpartition(")")[2].split()
                names[int(entry.name)] = (entry / "cmdline").read_bytes()
            except OSError:
                continue
            parents[int(entry.name)] = int(after[1])

    def descends(process: int) -> bool:
        while process in parents and process != root:
            process = parents[process]
        return process == root

    return [p for p, n in names.items() if b"RemoteActor" in n and descends(p)]


def require_told(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cluster of other versions is told, and the next may be joined."""
    # Asking whether it is a Ray takes seconds, and is done by the training.
    monkeypatch.setattr(ray_connection, "_require_answer", lambda address: None)
    monkeypatch.setattr(ray, "__version__", "1.2.3")
    told = "runs other versions than this machine .*: install the same Ray and Python"
    joined = ray_connection.connected(cluster.address, cores=1)
    with pytest.raises(ray_connection.RayError, match=told), joined:
        pass
    assert not ray.is_initialized()


def test_an_actor_that_is_killed_and_a_node_that_leaves(
    cluster: Any, tmp_path: Path
) -> None:
    """The training goes on with those that are left, on new rollouts alone."""
    with pytest.MonkeyPatch.context() as patched:
        require_told(cluster, patched)
    node = cluster.add_node(**SMALL)
    said: list[str] = []
    seen: list[IterationStats] = []
    numbers: list[dict[int, int]] = []

    def disturb(stats: IterationStats) -> None:
        seen.append(stats)
        numbers.append(read_plain(tmp_path / "resume.pt")["sequences"])
        if stats.iteration == 3:
            os.kill(_actors_on(os.getpid())[0], signal.SIGKILL)
        if stats.iteration == 6:
            cluster.remove_node(node)

    cfg = ActorsCfg(actors=2, address=cluster.address)
    engine = WithActors(cfg=cfg, tell=said.append)
    robot = load_robot(physics_dt_s=ENV.physics_dt_s)
    result = train(tmp_path, robot, CFG, engine=engine, on_iteration=disturb)
    assert result.finished
    last = seen[-1].scalars
    assert last["actors/replaced"] >= 2
    assert any("died and is replaced" in line for line in said)
    assert last["actors/used"] == 2 * ITERATIONS
    assert max(each.scalars["actors/lag_most"] for each in seen) <= cfg.most_lag
    ages = RunReader(tmp_path).read()["curves"][-1]
    assert ages["unit"] == "updates"
    (line,) = ages["lines"]
    assert [step for step, _ in line["points"]] == [each.steps for each in seen]
    # Every rollout that was used had a number of its own.
    assert sum(numbers[-1].values()) >= 2 * ITERATIONS
    for earlier, later in pairwise(numbers):
        assert all(later[actor] >= earlier[actor] for actor in earlier)
    with pytest.raises(ActorsError, match=r"--actors 2 needs as many cores.* has 1"):
        train(tmp_path / "more", robot, CFG, engine=engine)
    for update in ("sync", "gradients"):
        cfg = replace(cfg, actors=1, update=update)
        few = replace(CFG, steps=3 * ONE_BATCH.steps_per_iteration)
        out = tmp_path / update
        result = train(out, robot, few, engine=WithActors(cfg=cfg))
        assert result.finished
        assert result.stats is not None
        assert result.stats.scalars["actors/lag_most"] == 0.0


def test_a_learner_that_is_killed_goes_on(tmp_path: Path) -> None:
    """With the numbers it had saved, under the same update only."""
    out = tmp_path / "a"
    command = [sys.executable, "-m", "gaitpref", "train", "--out", str(out)]
    command += ["--reward", "task", "--envs", "8", "--actors", "1", "--steps"]
    learner = subprocess.Popen([*command, "2000000"], cwd=ROOT)
    while not (out / "resume.pt").exists():
        assert learner.poll() is None
        time.sleep(0.1)
    learner.kill()
    learner.wait()
    state = read_plain(out / "resume.pt")
    assert state["sequences"][0] >= state["iteration"]
    steps = str((state["iteration"] + 3) * 8 * 24)
    again = subprocess.run(
        [*command, steps, "--resume"], cwd=ROOT, timeout=120, check=False
    )
    assert again.returncode == 0
    assert load_policy(out / "policy.pt").info.steps == int(steps)
    after = read_plain(out / "resume.pt")
    assert after["sequences"][0] > state["sequences"][0]
    # One rollout an iteration, whoever was the learner.
    assert after["counts"]["used"] == int(steps) // (8 * 24)
