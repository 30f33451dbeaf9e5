"""A directory as a reader of the how-tos has it, small: what the pages build upon."""

from __future__ import annotations

import re
from pathlib import Path

import torch

from data.features import JOINTS
from gaitpref.cli.main import main
from policy.env.env_cfg import EnvCfg
from policy.imported.meaning.draft import LEFT_FIRST
from policy.robots.robot import load_robot
from policy.robots.shipped import WALK
from policy.training.checkpoint import load_policy
from tests.helpers.foreign_layouts import checkpoint_of, toml_of
from tests.helpers.local_host import certificate
from tests.helpers.older_run import older_run
from tests.helpers.ros2_bag import Motion, write_bag

ROOT = Path(__file__).resolve().parents[2]
_TOML = re.compile(r"```toml\n(.*?)```", re.DOTALL)
_WISH = re.compile(r"```python\n(from data import column\n.*?)```", re.DOTALL)

_LOOKER = re.compile(r"```python\n(from gaitpref import SeenPair\n.*?)```", re.DOTALL)


def make_readers_world(world: Path) -> None:
    """Write into `world` a finished run, an answered data set and files of others."""
    older_run(world / "runs" / "demo")
    clips, reward = world / "runs" / "clips", world / "runs" / "reward"
    archive, theirs = world / "clips.zip", world / "logs" / "my_run"
    for line in (
        f"record --dataset {clips} --episodes 60 --episode-s 2 --method style",
        f"pairs --dataset {clips} --count 80",
        f"answer --dataset {clips} --criterion crouch",
        f"fit --dataset {clips} --out {reward} --model linear",
        f"raters --dataset {clips} add bob",
        f"data pack --dataset {clips} --out {archive}",
        f"export --policy {WALK} --out {theirs}",
    ):
        if code := main(line.split()):
            raise RuntimeError(f"{line} ended with {code}")
    _write_checkpoint(world)
    robot = load_robot(physics_dt_s=EnvCfg().physics_dt_s)
    for folder in ("go2", "unitree_go2"):
        (world / folder).mkdir()
        (world / folder / "scene.xml").write_text(robot.mjcf)
    _write_bag(world, Motion(robot))
    _write_segments(world)
    wish = _WISH.search((ROOT / "README.md").read_text())
    assert wish
    (world / "mymodule.py").write_text(wish[1])
    page = (ROOT / "docs" / "how-to" / "raters-that-are-programs.md").read_text()
    looker = _LOOKER.search(page)
    assert looker
    (world / "looker.py").write_text(looker[1])
    (world / "examples").symlink_to(ROOT / "examples")
    certificate(world)


def _write_checkpoint(world: Path) -> None:
    """The walk that ships as rsl_rl keeps a policy, and a law as a person fills it."""
    ours = load_policy(WALK)
    torch.save(checkpoint_of(ours, "5", LEFT_FIRST), world / "model_1500.pt")
    (world / "filled.toml").write_text(toml_of(ours, LEFT_FIRST, scaled=False))


def _write_bag(world: Path, motion: Motion) -> None:
    """A bag by the names of the page's first map; what it lacks leaves the map."""
    found = _TOML.search((ROOT / "docs" / "how-to" / "robot-log.md").read_text())
    assert found
    names = [f"{joint}_joint" for joint in JOINTS]
    write_bag(world / "walk.mcap", motion, names, base="odometry")
    text = found[1][: found[1].index("[imu]")].replace('"/odom"', '"/base"')
    (world / "walk.toml").write_text(text)


def _write_segments(world: Path) -> None:
    """Twenty segments in the layout of the page, the fast one of each pair liked."""
    segments, answers = ["segment,step,speed,jerk"], ["left,right,answer,rater"]
    for clip in range(20):
        segments += [
            f"s{clip},{step},{0.05 * clip + 0.01 * step},{clip % 3 * 0.1}"
            for step in range(3)
        ]
    for left in range(0, 20, 2):
        answers += [f"s{left},s{left + 1},right,ada", f"s{left + 1},s{left},left,ada"]
    (world / "segments.csv").write_text("\n".join(segments) + "\n")
    (world / "answers.csv").write_text("\n".join(answers) + "\n")
