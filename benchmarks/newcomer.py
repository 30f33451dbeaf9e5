"""A newcomer's five minutes: `python -m benchmarks.newcomer`.

Who has a policy, a robot or a log types what the page about it says
(docs/how-to/own-policy.md, own-robot.md, robot-log.md). Each line is a command in a
process of its own, imports included, and is timed. What serves a page until Ctrl-C is
left out; in the place of a person a simulated rater answers. Trainings are short, so
that a way is seen in minutes: they show that it works, not that anybody walks.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro

from data.errors import GaitprefError
from policy.imported.meaning.draft import LEFT_FIRST
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import load_policy
from tests.helpers.foreign_layouts import checkpoint_of, toml_of
from tests.helpers.rosbags_bag import write_rosbag

from .harness import Figure, gaitpref, publish

Way = Literal["policy", "robot", "log"]
Line = tuple[str | Path, ...]
"""What is typed behind `gaitpref`."""
GOAL_S = 300


@dataclass(frozen=True, kw_only=True)
class Options:
    """Type what the pages teach a newcomer, and time each line."""

    policy: Path | None = None
    """Policy of others, or the directory of its run; by default the walk that ships as
    a checkpoint of rsl_rl 5, its joints in the order of Isaac Gym."""
    law: Path | None = None
    """TOML that says what the policy's numbers mean, where nothing beside it does."""
    robot: Path | None = None
    """MJCF of the robot of policy and log, which is the new robot too; by default the
    one that ships, as a file."""
    log: Path | None = None
    """Bag of ROS 2; by default a walk of 30 s, joints and odometry, by rosbags."""
    map: Path | None = None
    """TOML that says what is called how in the log."""
    ways: tuple[Way, ...] = ("policy", "robot", "log")
    """Only these."""
    steps: int = 50_000
    """Environment steps of each training."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    work: Path | None = None
    """New directory for what is made; a temporary one by default."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True, kw_only=True)
class Brought:
    """What a newcomer comes with."""

    policy: Path
    law: Path | None
    robot: Path
    log: Path
    map: Path


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """What is typed behind a command, so that it is short."""

    train: Line
    loop: Line
    evaluate: Line
    rounds: int
    """Of the loop, whose last policy goes out."""


def sizes_of(options: Options) -> Sizes:
    """What is typed; a loop of the quick preset has two rounds."""
    if options.quick:
        loop = ("--rounds", "1", "--labels", "8", "--steps", "96")
        few = ("--episodes", "4")
        train = ("--steps", "96", "--envs", "4")
        return Sizes(train=train, loop=loop, evaluate=few, rounds=1)
    steps = ("--steps", str(options.steps))
    return Sizes(train=steps, loop=("--preset", "quick", *steps), evaluate=(), rounds=2)


def brought(options: Options, work: Path) -> Brought:
    """What was given, and in `work` files of others' kinds for the rest."""
    ours = load_policy(WALK)
    robot = options.robot or work / "robot" / "scene.xml"
    if options.robot is None:
        robot.parent.mkdir(parents=True)
        robot.write_text(ours.robot().mjcf)
    policy, law = options.policy, options.law
    if policy is None:
        policy, law = work / "model_1500.pt", work / "law.toml"
        torch.save(checkpoint_of(ours, "5", LEFT_FIRST), policy)
        law.write_text(toml_of(ours, LEFT_FIRST, scaled=False))
    log, log_map = options.log, options.map
    if log is None:
        cfg = RecordCfg(episodes=1, episode_s=6.0 if options.quick else 30.0)
        (walk,) = record(WALK, replace(cfg, change_s=cfg.episode_s / 5), seed=0)
        topics = ("/joint_states", "/odom")
        log = write_rosbag(work / "walk_bag", walk, ours.robot(), topics)
    if log_map is None:
        log_map = work / "walk.toml"
        whose = "go1" if options.log is None else str(robot.absolute())
        log_map.write_text(f"robot = {json.dumps(whose)}\n")
    return Brought(policy=policy, law=law, robot=robot, log=log, map=log_map)


def of_policy(has: Brought, sizes: Sizes, out: Path) -> list[Line]:
    """docs/how-to/own-policy.md: in, which measures it, taught a style, out again."""
    law: Line = () if has.law is None else ("--law", has.law)
    mine, style = out / "mine", out / "style"
    base = mine / "policy.pt"
    taught = style / "rounds" / f"{sizes.rounds:02d}" / "policy" / "policy.pt"
    return [
        ("policy", "import", has.policy, *law, "--robot", has.robot, "--out", mine),
        ("loop", "--run", style, "--base", base, *sizes.loop),
        ("export", "--policy", taught, "--out", out / "out", "--like", has.policy),
    ]


def of_robot(has: Brought, sizes: Sizes, out: Path) -> list[Line]:
    """docs/how-to/own-robot.md: looked at, trained a little, measured, in a loop."""
    walk, robot = out / "walk", ("--robot", has.robot)
    return [
        ("robot", "inspect", has.robot, "--out", out),
        ("train", *robot, "--reward", "task", "--out", walk, *sizes.train),
        ("evaluate", "--policy", walk / "policy.pt", *sizes.evaluate),
        ("loop", *robot, "--run", out / "loop", *sizes.loop),
    ]


def of_log(has: Brought, sizes: Sizes, out: Path) -> list[Line]:
    """docs/how-to/robot-log.md: in, asked about, answered, a reward fitted."""
    dataset = ("--dataset", out / "logs")
    return [
        ("data", "import", "ros2", has.log, "--map", has.map, *dataset),
        ("pairs", *dataset, "--count", "50"),
        ("answer", *dataset, "--criterion", "high_step"),
        ("fit", *dataset, "--out", out / "reward"),
    ]


LINES: dict[Way, Callable[[Brought, Sizes, Path], list[Line]]] = {
    "policy": of_policy,
    "robot": of_robot,
    "log": of_log,
}


def name_of(line: Line) -> str:
    """The command's words, without what it is given."""
    words = [str(word) for word in line[:2]]
    two = words[0] in ("policy", "robot", "data")
    return "_".join(words if two else words[:1])


def timed(has: Brought, options: Options, work: Path) -> dict[str, Figure]:
    """Seconds of each line and of each way, and how long a processor was at work, which
    says the same on busy cores."""
    figures: dict[str, Figure] = {"steps": options.steps}
    for way in options.ways:
        whole_s = whole_cpu_s = 0.0
        for line in LINES[way](has, sizes_of(options), work / "typed" / way):
            ran = gaitpref(*line)
            whole_s, whole_cpu_s = whole_s + ran.wall_s, whole_cpu_s + ran.cpu_s
            name = f"{way}_{name_of(line)}"
            figures |= {f"{name}_s": ran.wall_s, f"{name}_cpu_s": ran.cpu_s}
            print(f"{name}: {ran.wall_s:.1f} s, {ran.cpu_s:.1f} s of a processor")
        figures |= {f"{way}_s": whole_s, f"{way}_cpu_s": whole_cpu_s}
    return figures


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> int:
    """Make what is not given, type the lines, print the seconds."""
    goals = {f"{way}_s": f"at most {GOAL_S}" for way in options.ways}
    with tempfile.TemporaryDirectory() as folder:
        work = options.work or Path(folder)
        work.mkdir(parents=True, exist_ok=True)
        figures = timed(brought(options, work), options, work)
    publish("A newcomer's five minutes", figures, goals, options.json)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
    except GaitprefError as error:
        sys.exit(f"benchmarks.newcomer: {error}")
