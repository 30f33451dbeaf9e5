"""Training on two processes that torchrun started."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDict

from data.errors import GaitprefError
from policy.env.env import QuadrupedEnv
from policy.parallel.ranks import Ranks
from policy.robots.robot import load_robot
from policy.training.checkpoint import load_policy, read_plain
from policy.training.clipped_update import clipped_update
from policy.training.ppo import Runner
from tests.helpers.two_ranks import ENV, ONE_BATCH

ROOT = Path(__file__).resolve().parents[2]
TORCHRUN = (sys.executable, "-m", "torch.distributed.run", "--standalone")


def torchrun(*command: str) -> subprocess.Popen[str]:
    """Two processes of `command`, a module and what it is given."""
    # It tells on standard error that it sets this, where nobody has.
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [*TORCHRUN, "--nproc-per-node", "2", "-m", *command],
        cwd=ROOT,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What two ranks left that did all of `two_ranks`."""
    out = tmp_path_factory.mktemp("ranks")
    process = torchrun("tests.helpers.two_ranks", str(out))
    _, said = process.communicate(timeout=240)
    assert process.returncode == 0, said
    return out


def halves(left: Path) -> list[dict[str, Any]]:
    return [torch.load(left / f"update_{rank}.pt") for rank in range(2)]


def of_both(left: Path, name: str) -> torch.Tensor:
    """What the storages of both have, side by side as environments are."""
    return torch.cat([half[name] for half in halves(left)], dim=1)


def test_two_ranks_collect_different_rollouts(left: Path) -> None:
    first, second = halves(left)
    assert not first["observations"].allclose(second["observations"], atol=1e-3)


def test_two_ranks_learn_what_one_does_from_both_halves(left: Path) -> None:
    """Gradients, weights, statistics of the observations, and the step size."""
    torch.manual_seed(0)
    robot = load_robot(physics_dt_s=ENV.physics_dt_s)
    alg = Runner(QuadrupedEnv(robot, ENV, 8, seed=0), ONE_BATCH).alg
    alg.train_mode()
    storage = alg.storage
    storage.observations = TensorDict(
        {"policy": of_both(left, "observations")}, batch_size=[24, 8]
    )
    for name in ("actions", "values", "returns", "actions_log_prob"):
        setattr(storage, name, of_both(left, name))
    params = zip(*(half["distribution"] for half in halves(left)), strict=True)
    storage.distribution_params = tuple(torch.cat(each, dim=1) for each in params)
    advantages = storage.returns - storage.values
    advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    assert of_both(left, "advantages").allclose(advantages, atol=1e-5)
    storage.advantages = advantages
    clipped_update(alg)
    for half in halves(left):
        networks = (alg.actor, alg.critic)
        own = [p.grad for network in networks for p in network.parameters()]
        for gradient, expected in zip(half["gradients"], own, strict=True):
            assert expected is not None
            assert gradient.allclose(expected, atol=1e-6)
        for key, weights in half["weights"].items():
            for name, expected in getattr(alg, key).state_dict().items():
                assert weights[name].allclose(expected, atol=1e-5), name
        assert half["learning_rate"] == alg.learning_rate
    assert alg.learning_rate != ONE_BATCH.learning_rate


def test_two_ranks_have_the_same_networks_to_the_last_bit(left: Path) -> None:
    first, second = (half["weights"] for half in halves(left))
    for key in first:
        assert all(first[key][n].equal(second[key][n]) for n in first[key])


def test_a_resumed_run_of_two_ranks_is_bit_equal(left: Path) -> None:
    """With what each has for itself: environments, chance, a bonus, steps before."""
    whole, parts = (left / name / "policy.pt" for name in ("whole", "parts"))
    assert load_policy(whole).info.steps == 8 * 24 * 4
    assert whole.read_bytes() == parts.read_bytes()
    ends = [read_plain(left / name / "resume.pt") for name in ("whole", "parts")]
    firsts, others = (end["env"]["sim"] for end in ends), (e["others"] for e in ends)
    assert torch.equal(*firsts)
    assert all(map(torch.equal, *others))


def test_ranks_that_were_given_different_things_do_not_train(left: Path) -> None:
    for rank in range(2):
        refused = (left / f"refused_{rank}").read_text()
        assert refused.startswith("rank 1 was started with other settings")
        assert not (left / f"other_{rank}" / "policy.pt").exists()


def test_environments_are_shared_evenly_or_not_at_all() -> None:
    assert Ranks(size=4).share_of(128) == 32
    with pytest.raises(GaitprefError, match="give --envs 129"):
        Ranks(size=3).share_of(128)


def _trained(out: Path, *more: str) -> subprocess.Popen[str]:
    command = ("train", "--reward", "task", "--envs", "8", "--out", str(out))
    return torchrun("gaitpref", *command, *more)


def _told(process: subprocess.Popen[str]) -> list[str]:
    """Lines of the command itself, once it has ended."""
    _, said = process.communicate(timeout=60)
    return [line for line in said.splitlines() if line.startswith("gaitpref: ")]


def _ends(process: subprocess.Popen[str]) -> int:
    process.communicate(timeout=60)
    return process.returncode


def _second_rank(process: subprocess.Popen[str]) -> int:
    """Its process id; torchrun is its parent, and names ranks in the environment."""
    own = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    for child in own.split():
        if b"\0RANK=1\0" in Path(f"/proc/{child}/environ").read_bytes():
            return int(child)
    raise AssertionError(f"torchrun has no second rank among {own}")


def test_a_killed_rank_ends_the_others_and_the_run_goes_on(tmp_path: Path) -> None:
    process = _trained(tmp_path / "a", "--steps", "2000000")
    while not (tmp_path / "a" / "resume.pt").exists():
        assert process.poll() is None
        time.sleep(0.1)
    os.kill(_second_rank(process), signal.SIGKILL)
    killed_s = time.monotonic()
    (line,) = _told(process)
    assert time.monotonic() - killed_s < 30
    assert process.returncode
    assert "--resume" in line
    done = read_plain(tmp_path / "a" / "resume.pt")["iteration"]
    steps = (done + 2) * 8 * 24
    process = _trained(tmp_path / "a", "--steps", str(steps), "--resume")
    assert not _told(process)
    assert process.returncode == 0
    assert load_policy(tmp_path / "a" / "policy.pt").info.steps == steps


def test_the_trainings_of_a_loop_are_done_together(tmp_path: Path) -> None:
    """A rank that is killed ends the others; the same command goes on."""
    command = ("tests.helpers.small_loop", str(tmp_path / "run"))
    process = torchrun(*command)
    # The first training is done, and the second rank waits to be called to the next.
    while not (tmp_path / "run/rounds/00/policy/policy.pt").exists():
        assert process.poll() is None
        time.sleep(0.1)
    os.kill(_second_rank(process), signal.SIGKILL)
    killed_s = time.monotonic()
    process.communicate(timeout=60)
    assert time.monotonic() - killed_s < 30
    assert process.returncode
    process = torchrun(*command)
    _, said = process.communicate(timeout=240)
    assert process.returncode == 0, said
    for number in range(3):
        state = read_plain(tmp_path / f"run/rounds/{number:02d}/policy/resume.pt")
        assert len(state["others"]) == 1
    assert (tmp_path / "run/report/index.html").exists()


def test_a_loop_is_started_as_its_help_says(tmp_path: Path) -> None:
    """Without `--`, torchrun takes `--run` for one of its own options."""
    asked = ("gaitpref", "loop", "--run", str(tmp_path), "--help")
    assert _ends(torchrun("--", *asked)) == 0
    assert _ends(torchrun(*asked)) != 0


def test_what_cannot_be_done_together_is_told_once() -> None:
    (line,) = _told(torchrun("gaitpref", "evaluate", "--policy", "policy.pt"))
    assert "torchrun is for `train`" in line
