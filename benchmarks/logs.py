"""How right an imported log is: `python -m benchmarks.logs`.

The shipped walk is recorded, what a robot would log of it is imported again, and the
feature rows are compared with those of the recording.

Shapes: N states.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from data.episodes.episode import Episode
from data.errors import GaitprefError
from data.features import column
from gaitpref.formats.logs.log_map import Columns, LogMap
from gaitpref.formats.tables.table_episodes import table_episodes
from policy.robots.robot import load_robot
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg

from .harness import Figure, publish

_PLACE = {"base_pos": "base_pos", "base_quat": "quat", "joint_pos": "joint_pos"}
_IMU = {
    "base_quat": "quat",
    "base_ang_vel": "gyro",
    "joint_pos": "joint_pos",
    "joint_vel": "joint_vel",
}
_ROWS = {
    "odometry": (_PLACE, 0.0),
    "legs": (_IMU, 0.0),
    "legs_told_contacts": (_IMU | {"contact": "contact"}, 0.0),
    "legs_noisy": (_IMU, 1.0),
}
"""Columns that are told, and the share of the noise of `_noisy`."""


@dataclass(frozen=True, kw_only=True)
class Logs:
    """Record walks, import them as logs that tell less, compare."""

    episodes: int = 20
    """Walks, four of each command."""
    episode_s: float = 10.0
    """Length of each."""
    json: Path | None = None
    """File for the figures."""


def main(options: Logs) -> int:
    """Print the table of errors."""
    cfg = RecordCfg(episodes=options.episodes, episode_s=options.episode_s)
    truth = list(record(WALK, cfg, seed=0, round=0))
    figures: dict[str, Figure] = {}
    for name, (columns, noise) in _ROWS.items():
        for figure, value in errors(truth, columns, noise).items():
            figures[f"{name}_{figure}"] = round(value, 4)
    forward = np.concatenate([e.features[:, column("base_lin_vel_b")] for e in truth])
    for axis, rms in zip(
        ("forward", "left", "up"), np.sqrt((forward**2).mean(0)), strict=True
    ):
        figures[f"truth_{axis}_m_s"] = round(float(rms), 4)
    publish("imported logs against the truth", figures, {}, options.json)
    return 0


def errors(
    truth: list[Episode], columns: dict[str, Any], noise: float
) -> dict[str, float]:
    """Root mean square errors of velocities and height, share of equal contacts."""
    rng = np.random.default_rng(0)
    log_map = LogMap(
        robot="go1", episode_s=1000.0, columns=Columns(rate_hz=50.0, **columns)
    )
    speeds, heights, touches = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "walk.npz"
        for episode in truth:
            np.savez(place, **_logged(episode, noise, rng))
            (found,) = table_episodes(place, "npz", log_map, place.parent).episodes
            own, told = episode.features, found.features
            for kept, name in (
                (speeds, "base_lin_vel_b"),
                (heights, "base_height"),
                (touches, "foot_contact"),
            ):
                kept.append(told[:, column(name)] - own[:, column(name)])
    speed = np.concatenate(speeds)
    rms = np.sqrt((speed**2).mean(axis=0))
    means = np.array([np.abs(part.mean(axis=0)) for part in speeds])
    return {
        "forward_m_s": float(rms[0]),
        "left_m_s": float(rms[1]),
        "up_m_s": float(rms[2]),
        "mean_forward_m_s": float(means[:, 0].max()),
        "height_m": float(np.sqrt((np.concatenate(heights) ** 2).mean())),
        "equal_contacts": float((np.concatenate(touches) == 0).mean()),
    }


def _logged(episode: Episode, noise: float, rng: np.random.Generator) -> dict[str, Any]:
    """What sensors tell of an episode: with `noise` 1, encoders to 0.003 rad and 0.1
    rad/s, a gyroscope to 0.05 rad/s, attitudes to 0.5 degrees (1 sigma)."""
    robot = load_robot(physics_dt_s=episode.meta.physics_dt_s)
    qpos, qvel = episode.qpos, episode.qvel
    contact = episode.features[:, column("foot_contact")]

    def noisy(values: np.ndarray, sigma: float) -> np.ndarray:
        return values + noise * sigma * rng.standard_normal(values.shape)

    quat = noisy(qpos[:, 3:7], np.radians(0.25))
    return {
        "base_pos": qpos[:, :3],
        "quat": quat / np.linalg.norm(quat, axis=1, keepdims=True),
        "gyro": noisy(qvel[:, 3:6], 0.05),
        "joint_pos": noisy(qpos[:, robot.qpos_adr], 0.003),
        "joint_vel": noisy(qvel[:, robot.qvel_adr], 0.1),
        "contact": np.vstack([contact[:1], contact]),
    }


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(Logs)))
    except GaitprefError as error:
        sys.exit(f"benchmarks.logs: {error}")
