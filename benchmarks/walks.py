"""Episodes that look like walking, made in milliseconds without a simulator."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.datasets.manifest import EpisodeEntry
from data.episodes.clips import Clip
from data.episodes.episode import Episode, EpisodeMeta
from data.features import FEATURE_DIM, column

ROBOT_XML = Path(__file__).parents[1] / "policy" / "robots" / "go1.xml"
DT_S = 0.02
HOME_JOINTS = np.tile((0.0, 0.9, -1.8), 4)
AHEAD = (0.5, 0.0, 0.0)
"""Forward m/s, left m/s, yaw rad/s."""
PHASES = (0.0, 0.5, 0.5, 0.0)
"""Phases of the legs FR FL RR RL: a trot."""


def walk(
    steps: int,
    *,
    seed: int,
    step_hz: float = 2.0,
    lift: float = 0.35,
    fell: bool = False,
    task: str = "walk",
    command: tuple[float, float, float] = AHEAD,
) -> Episode:
    """A trot at 0.5 m/s, whatever the command; with `fell`, the base sinks in the last
    half second."""
    time_s = np.arange(steps + 1) * DT_S
    qpos = np.zeros((steps + 1, 19))
    qpos[:, 0] = 0.5 * time_s
    qpos[:, 2] = 0.29 + 0.01 * np.sin(4 * np.pi * step_hz * time_s)
    qpos[:, 3] = 1.0
    qpos[:, 7:] = HOME_JOINTS
    features = np.zeros((steps, FEATURE_DIM), dtype=np.float32)
    for leg, phase in enumerate(PHASES):
        angle = 2 * np.pi * (step_hz * time_s + phase)
        qpos[:, 8 + 3 * leg] += 0.25 * np.cos(angle)
        qpos[:, 9 + 3 * leg] -= lift * np.maximum(np.sin(angle), 0.0)
        features[:, column("foot_contact")][:, leg] = np.sin(angle[1:]) <= 0
    if fell:
        sinking = np.clip(1 - (time_s[-1] - time_s) / 0.5, 0.0, 1.0)
        qpos[:, 2] -= 0.17 * sinking
        features[-1, column("fallen")] = 1.0
    features[:, column("base_height")] = qpos[1:, 2:3]
    features[:, column("base_lin_vel_b")] = (0.5, 0.0, 0.0)
    features[:, column("joint_torque")] = 3.0
    return Episode(
        qpos=qpos,
        qvel=np.zeros((steps + 1, 18)),
        obs=np.zeros((steps + 1, 48), dtype=np.float32),
        action=np.zeros((steps, 12), dtype=np.float32),
        ctrl=np.zeros((steps, 12), dtype=np.float32),
        features=features,
        reward=np.zeros(steps, dtype=np.float32),
        end_reason="terminated" if fell else "truncated",
        meta=EpisodeMeta(
            task=task,
            seed=seed,
            env_index=0,
            command=command,
            policy_sha256="0" * 64,
            policy_step=0,
            stochastic=False,
            control_dt_s=DT_S,
            physics_dt_s=0.005,
            robot="go1",
            model_sha256="0" * 64,
        ),
        mjcf=ROBOT_XML.read_text(),
    )


def walking_dataset(
    root: Path,
    *,
    pairs: int,
    clip_steps: int = 60,
    episodes: int = 12,
    steps: int = 300,
    task: str = "walk",
    command: tuple[float, float, float] = AHEAD,
) -> Dataset:
    """A data set of trots of different pace, with `pairs` open pairs.

    Every fourth episode of the usual length ends early, in a fall.
    """
    dataset = Dataset.create(root)
    entries = dataset.add_episodes(
        walk(
            steps // 2 if _falls(index, steps) else steps,
            seed=index,
            step_hz=1.5 + 0.1 * index,
            lift=0.2 + 0.03 * index,
            fell=_falls(index, steps),
            task=task,
            command=command,
        )
        for index in range(episodes)
    )
    clips = walking_clips(entries, clip_steps)
    rng = np.random.default_rng(0)
    chosen = []
    while len(chosen) < pairs:
        a, b = rng.choice(len(clips), size=2, replace=False)
        if clips[a].rollout != clips[b].rollout:
            chosen.append(Pair.make(clips[a], clips[b], strategy="random", round=0))
    with dataset.answers() as store:
        store.add_pairs(chosen)
    return dataset


def walking_clips(entries: Iterable[EpisodeEntry], clip_steps: int) -> list[Clip]:
    """What pairs of `walking_dataset` are made of."""
    return [
        Clip(entry.sha256, start, min(clip_steps, entry.num_steps - start))
        for entry in entries
        for start in range(0, max(entry.num_steps - clip_steps, 1) + 20, 20)
        if entry.num_steps - start >= 20
    ]


def _falls(index: int, steps: int) -> bool:
    return index % 4 == 0 and steps <= 300
