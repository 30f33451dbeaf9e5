"""A robot that trots on rails: states worked out by hand, for viewers and exports."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.episode import Episode
from data.features import FEATURE_DIM, column
from policy.robots.robot import Robot, load_robot
from tests.data.test_dataset import META

DT_S = 0.02


def trot_qpos(robot: Robot, times_s: np.ndarray, speed_m_s: float) -> np.ndarray:
    """States [S, 19] of a trot at 2 Hz straight ahead."""
    qpos = np.tile(robot.home_qpos, (len(times_s), 1))
    qpos[:, 0] += speed_m_s * times_s
    swing = 0.3 * np.sin(4 * np.pi * times_s)
    for leg, sign in enumerate((1, -1, -1, 1)):
        qpos[:, robot.qpos_adr[3 * leg + 1]] += sign * swing
    return qpos


def trot(robot: Robot, num_steps: int = 60, speed_m_s: float = 0.5) -> Episode:
    """An episode of the trot; what is not its motion is noise, and finite."""
    rng = np.random.default_rng(num_steps)
    times_s = np.arange(num_steps + 1) * DT_S
    qpos = trot_qpos(robot, times_s, speed_m_s)
    qvel = np.zeros((num_steps + 1, 18))
    qvel[:, 0] = speed_m_s

    def noise(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape, dtype=np.float32)

    features = noise(num_steps, FEATURE_DIM)
    features[:, column("fallen")] = 0
    features[:, column("foot_contact")] = features[:, column("foot_contact")] > 0
    features[:, column("base_height")] = qpos[1:, 2:3]
    return Episode(
        qpos=qpos,
        qvel=qvel,
        obs=noise(num_steps + 1, 48),
        action=noise(num_steps, 12),
        ctrl=noise(num_steps, 12),
        features=features,
        reward=noise(num_steps),
        end_reason="truncated",
        meta=replace(
            META, control_dt_s=DT_S, robot=robot.name, model_sha256=robot.model_sha256
        ),
        mjcf=robot.mjcf,
    )


def trotting_dataset(root: Path, *, models_apart: bool | None = None) -> Dataset:
    """Three episodes, one of which falls, and four pairs with three answers."""
    robot = load_robot(physics_dt_s=0.004)
    fall = replace(trot(robot, 70, 0.3), end_reason="terminated")
    dataset = Dataset.create(root)
    added = dataset.add_episodes(
        [trot(robot, 60), trot(robot, 80, 0.8), fall], models_apart=models_apart
    )
    first, second, third = (entry.sha256 for entry in added)
    clips = [Clip(first, 5, 40), Clip(second, 10, 40), Clip(third, 30, 40)]
    pairs = [
        Pair.make(clips[0], clips[1], strategy="u", round=0),
        Pair.make(clips[1], clips[2], strategy="u", round=0),
        Pair.make(clips[0], clips[2], strategy="u", round=0),
        Pair.make(Clip(first, 0, 40), clips[1], strategy="u", round=0),
    ]
    with dataset.answers() as store:
        store.add_rater("ada", "human")
        store.add_pairs(pairs)
        for number, choice in enumerate(("a", "b", "equal", "skip")):
            store.add_answer(
                Answer(
                    answer_id=f"answer-{number}",
                    pair_id=pairs[number].pair_id,
                    rater_id="ada",
                    choice=choice,
                    shown_left="a",
                    created_utc="2030-01-31T12:00:00Z",
                )
            )
    return dataset
