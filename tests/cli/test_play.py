"""`gaitpref play`: policies are driven, pushed and compared on their page."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.visitor import Visitor
from gaitpref.cli.commands.looking.play import live_policy
from labeling_ui.scene.live_robot import Drive, LiveState, StepFn
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import SHIPPED_XML, load_robot
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
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


def test_two_policies_are_driven_and_pushed_on_one_page(policies: list[Path]) -> None:
    """Both robots move in the same command; the page tells their speeds."""
    command = [sys.executable, "-m", "gaitpref", "play", "--port", "0"]
    arguments = ["--policy", policies[0], "--against", policies[1]]
    with subprocess.Popen(
        [*command, *arguments], stdout=subprocess.PIPE, text=True
    ) as server:
        try:
            assert server.stdout is not None
            url = server.stdout.readline().split()[-1]
            asyncio.run(_driven(url))
            server.terminate()
            assert server.wait(LIMIT_S) == 0
        finally:
            server.kill()


async def _driven(url: str) -> None:
    async with asyncio.timeout(LIMIT_S):
        visitor = Visitor(url, None)
        page = asyncio.create_task(visitor.run())
        await _until(page, lambda: {"robot_A", "robot_B"} <= visitor.moved.keys())
        await visitor.press("Stand still")
        await visitor.slide("forward, m/s", 1.0)
        await _until(page, lambda: set(_speeds(visitor)) == {"A", "B"})
        before = _fastest(visitor)
        while _fastest(visitor) < before + 0.2:
            # A push goes anywhere, and it takes a few until one goes along the robot.
            await visitor.press("Push")
            last = visitor.moved["robot_A"] + 150
            await _until(page, partial(_pushed, visitor, before + 0.2, last))
        await visitor.press("Pause or go on")
        page.cancel()


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
