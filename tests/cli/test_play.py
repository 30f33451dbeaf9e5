"""`gaitpref play`: policies are driven, pushed and compared on their page."""

from __future__ import annotations

import asyncio
import re
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.visitor import Visitor
from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from gaitpref.cli.commands.looking.play import live_policy, run
from gaitpref.cli.main import parse
from gaitpref.cli.options.policy_options import Play
from gaitpref.raters.liked import Liked
from labeling_ui.scene.live_robot import HISTORY_S, Drive, LiveState, StepFn
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import SHIPPED_XML, load_robot
from policy.robots.shipped import WALK
from policy.rollouts.driven_policy import DrivenPolicy
from policy.training.checkpoint import load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.ended_server import ends_well
from tests.helpers.foreign_robots import Drawing, mjcf

LIMIT_S = 120.0
"""For anything to come: the machine may be busy."""
STAND = Drive(command=(0.0, 0.0, 0.0))
_SPEED = re.compile(r"<b>([AB])</b>.*?([+-]\d+\.\d+) m/s forward", re.DOTALL)


@pytest.fixture(scope="module")
def policies(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two policies that can hardly more than stand."""
    ppo = PpoCfg(num_envs=4, hidden_sizes=(8,))
    robot = load_robot(physics_dt_s=EnvCfg().physics_dt_s)

    def trained(seed: int) -> Path:
        cfg = TrainCfg(steps=96, env=EnvCfg(), ppo=ppo, seed=seed)
        return train(tmp_path_factory.mktemp("policy"), robot, cfg).policy

    return [trained(seed) for seed in (0, 1)]


def _after(step: StepFn, drive: Drive, steps: int) -> LiveState:
    state = step(drive)
    for _ in range(steps - 1):
        state = step(drive)
    return state


def test_command_push_and_reset_reach_the_robot(policies: list[Path]) -> None:
    """Equal starts part under other commands; a push adds speed; a reset ends it."""
    policy = live_policy(policies[0], None)
    one, same, other = (policy.new_step() for _ in range(3))
    still = _after(one, STAND, 10)
    assert np.array_equal(still.qpos, _after(same, STAND, 10).qpos)
    asked = Drive(command=(1.0, 0.0, 0.5))
    assert not np.array_equal(still.qpos, _after(other, asked, 10).qpos)
    pushed = one(Drive(command=STAND.command, push_m_s=(0.7, 0.0)))
    assert pushed.speed_m_s - same(STAND).speed_m_s > 0.4
    moved = _after(one, STAND, 25)
    anew = one(Drive(command=STAND.command, reset=True))
    assert np.linalg.norm(anew.qpos[:2]) < np.linalg.norm(moved.qpos[:2])


def test_another_robot_than_the_policys_is_told(
    policies: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the page and in the terminal, and in what they differ; the same is not."""
    xml = tmp_path / "stranger.xml"
    xml.write_text(mjcf(Drawing()))
    played = live_policy(policies[0], xml)
    assert played.name.endswith(", on stranger, trained on go1")
    said = capsys.readouterr().out
    assert "stranger.xml is another robot: it has a mass of 15 kg instead of" in said
    assert live_policy(policies[0], SHIPPED_XML).name.endswith("96 steps")
    assert not capsys.readouterr().out


def test_what_is_liked_is_kept_with_an_answer(tmp_path: Path) -> None:
    """Of both robots the same last seconds, from the last push or other command on."""
    policy = load_policy(WALK)
    robot = policy.robot()
    one, other, twin = (
        DrivenPolicy(policy, robot, seed=seed, memory_s=HISTORY_S) for seed in (0, 1, 1)
    )
    dataset = Dataset.create(tmp_path / "set")
    like = Liked(dataset, "ann")
    for driven in (one, other):
        for _ in range(20):
            driven.step((0.3, 0.0, 0.0))
    assert "not kept: 0.4 s since the last push" in like((one, other), 0)
    assert dataset.entries() == ()
    last = [driven.step((0.5, 0.0, 0.2)) for driven in (one, other) for _ in range(200)]
    assert "kept: B is better, of the last 3.0 s; answers so far: 1" in like(
        (one, other), 1
    )
    with dataset.answers() as store:
        ((pair, answer),) = store.current_answers()
        assert store.raters() == {"ann": "human"}
    assert (answer.rater_id, answer.target) == ("ann", 0.0)
    a, b = (dataset.read(clip.rollout) for clip in (pair.a, pair.b))
    assert a.meta.policy_sha256 == b.meta.policy_sha256 == policy.sha256
    assert a.meta.command == b.meta.command == (0.5, 0.0, 0.2)
    assert pair.a.steps == pair.b.steps == len(b.features) == 150
    assert np.array_equal(b.features[-1], last[-1].features[0].numpy())
    assert np.array_equal(b.qpos[0], last[-150].qpos[0].numpy())
    one.push((0.3, 0.0))
    assert "not kept: 0.0 s" in like((one, other), 0)
    for driven in (other, twin):
        driven.begin()
        for _ in range(80):
            driven.step((0.5, 0.0, 0.0))
    assert "both robots did exactly the same" in like((other, twin), 0)


def test_beside_is_another_word_for_against() -> None:
    assert parse(["play", "--beside", "p"]) == Play(against=Path("p"))


def test_one_robot_is_liked_more_than_none(policies: list[Path]) -> None:
    with pytest.raises(GaitprefError, match="give --against POLICY too"):
        run(Play(policy=policies[0], dataset=Path("set")))


def test_two_policies_are_driven_and_judged_on_one_page(
    policies: list[Path], tmp_path: Path
) -> None:
    """Both robots move in the same command; the page tells their speeds. The command is
    ended while it is open, and says nothing of a fault."""
    arguments = ["play", "--policy", policies[0], "--against", policies[1]]
    arguments += ["--dataset", tmp_path / "set"]
    ends_well(arguments, _driven, limit_s=LIMIT_S)


async def _driven(server: subprocess.Popen[str], url: str) -> None:
    async with asyncio.timeout(LIMIT_S):
        visitor = Visitor(url, None)
        page = asyncio.create_task(visitor.run())
        await _until(page, lambda: {"robot_A", "robot_B"} <= visitor.moved.keys())
        await visitor.press("Stand still")
        await visitor.press("A walks as it should")
        await _until(page, lambda: "kept: " in "".join(visitor.texts.values()))
        await visitor.set("forward, m/s", 0.9)
        await visitor.press("Faster")
        await _until(page, lambda: set(_speeds(visitor)) == {"A", "B"})
        before = _fastest(visitor)
        while _fastest(visitor) < before + 0.2:
            # A push goes anywhere, and it takes a few until one goes along the robot.
            await visitor.press("Push")
            last = visitor.moved["robot_A"] + 150
            await _until(page, partial(_pushed, visitor, before + 0.2, last))
        server.terminate()
        await page
        assert visitor.close_code == 1001


async def _until(page: asyncio.Task[None], condition: Callable[[], bool]) -> None:
    while not condition():
        assert not page.done(), page
        await asyncio.sleep(0.02)


def _speeds(visitor: Visitor) -> dict[str, float]:
    """Forward speed of each robot, as the page tells it."""
    everything = "".join(visitor.texts.values())
    return {name: float(speed) for name, speed in _SPEED.findall(everything)}


def _fastest(visitor: Visitor) -> float:
    return max(map(abs, _speeds(visitor).values()))


def _pushed(visitor: Visitor, speed_m_s: float, poses: int) -> bool:
    """A robot shows that speed, or that many poses have come."""
    return _fastest(visitor) >= speed_m_s or visitor.moved["robot_A"] >= poses
