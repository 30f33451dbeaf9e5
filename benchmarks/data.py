"""What data cost: logging, writing, reading, pairs to tensors, fitting, verifying, and
models of robots.

All figures but the memory are ratios or times taken in one run, one after the other and
alternating, in seconds of the processor: they mean the same beside other work.
`python -m benchmarks.data` takes some minutes and 6 GB of disk.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
import tyro
import zstandard

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset, EpisodeEntry
from data.datasets.verify import verify
from data.episodes.chunks import ZSTD_LEVEL
from data.episodes.clips import Clip
from data.episodes.episode import Episode, EpisodeMeta
from data.episodes.writer import encode_episode
from data.features import FEATURE_DIM, column
from data.files.files import write_atomically
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from rewardmodel.answers.answered_pairs import load_pairs

from .data_models import models_figures
from .harness import Figure, gaitpref, median, publish

Measured = Callable[[], dict[str, Figure]]
GOALS = {
    "logging_share": "at most 0.05",
    "write_over_npsave": "at least 0.15",
    "zstd_over_bare": "at least 0.75",
    "window_ms": "at most 2",
    "pairs_over_slicing": "at most 3",
    "fit_peak_gb": "at most 1",
    "verify_over_sha256": "at least 0.80",
}
Part = Literal["logging", "write", "window", "pairs", "fit", "models"]
PARTS: tuple[Part, ...] = ("logging", "write", "window", "pairs", "fit", "models")
STEPS = 500
"""Control steps of an episode: 10 s at 50 Hz."""
LOOP_STEPS = 60
"""1.2 s, what the loop asks about."""
LONG_STEPS = 100
META = EpisodeMeta(
    task="walk",
    seed=0,
    env_index=0,
    command=(0.5, 0.0, 0.0),
    policy_sha256="0" * 64,
    policy_step=0,
    stochastic=False,
    control_dt_s=0.02,
    physics_dt_s=0.004,
    robot="noise",
    model_sha256="0" * 64,
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure logging, writing, reading, pairs to tensors, fitting and verifying."""

    parts: tuple[Part, ...] = PARTS
    """Only these; fit also verifies what it was fitted to."""
    quick: bool = False
    """A small version that shows that everything runs; its figures mean little."""
    work: Path | None = None
    """Directory for some gigabytes of scratch; a temporary one by default."""
    json: Path | None = None
    """File for the figures."""


def noise_episode(seed: int, num_steps: int = STEPS) -> Episode:
    """An episode that hardly shrinks, like one with observation noise."""
    rng = np.random.default_rng(seed)

    def noise(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape, dtype=np.float32)

    features = noise(num_steps, FEATURE_DIM)
    features[:, column("foot_contact")] = features[:, column("foot_contact")] > 0
    features[:, column("fallen")] = 0
    return Episode(
        qpos=rng.standard_normal((num_steps + 1, 19)),
        qvel=rng.standard_normal((num_steps + 1, 18)),
        obs=noise(num_steps + 1, 48),
        action=noise(num_steps, 12),
        ctrl=noise(num_steps, 12),
        features=features,
        reward=noise(num_steps),
        end_reason="truncated",
        meta=replace(META, env_index=seed),
        mjcf="<mujoco/>" + "<!-- as long as a robot -->" * 500,
    )


def best_of(
    repeats: int,
    *work: Callable[[], object],
    clock: Callable[[], float] = time.process_time,
) -> list[float]:
    """Least seconds of each of several things done in turn."""
    best = [float("inf")] * len(work)
    for _ in range(repeats):
        for index, run in enumerate(work):
            start_s = clock()
            run()
            best[index] = min(best[index], clock() - start_s)
    return best


def write_figures(root: Path, repeats: int) -> dict[str, Figure]:
    """Writing one episode, with its fsync, against `numpy.save` and bare zstd."""
    episode = noise_episode(0)
    content = np.frombuffer(encode_episode(episode), dtype=np.uint8)
    compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
    npsave_s, write_s, bare_s, zstd_s = best_of(
        repeats,
        lambda: np.save(root / "array.npy", content),
        lambda: write_atomically(root / "episode.mcap", encode_episode(episode)),
        lambda: compressor.compress(content.data),
        lambda: encode_episode(episode, compression="zstd"),
    )
    return {
        "write_over_npsave": npsave_s / write_s,
        "zstd_over_bare": bare_s / zstd_s,
        "write_mb_per_s": content.nbytes / write_s / 1e6,
    }


def logging_figures(root: Path, quick: bool) -> dict[str, Figure]:
    """How much longer `gaitpref record` takes than its rollouts alone; wall time.

    Of the policy and its checkpoints, as is usual; without noise, with which robots
    that have hardly learned fall, and few steps are logged. The median of turns that
    follow each other closely: a machine is not equally fast for a minute.
    """
    env = EnvCfg()
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    ppo = PpoCfg(num_envs=16)
    cfg = TrainCfg(steps=4 * ppo.steps_per_iteration, env=env, ppo=ppo, checkpoints=3)
    train(root / "policy", robot, cfg)
    cut = RecordCfg(episodes=16 if quick else 64, noisy_share=0.0)
    policy = root / "policy" / "policy.pt"
    added: list[EpisodeEntry] = []
    shares: list[float] = []
    for turn in range(1 if quick else 9):
        start_s = time.perf_counter()
        deque(record(policy, cut, seed=0), maxlen=0)
        rolled_s = time.perf_counter()
        dataset = Dataset.create(root / f"logged{turn}")
        added = dataset.add_episodes(record(policy, cut, seed=0))
        logged_s = time.perf_counter() - rolled_s
        shares.append(logged_s / (rolled_s - start_s) - 1.0)
    return {
        "logging_share": median(shares),
        "logged_steps": sum(entry.num_steps for entry in added),
    }


def window_figures(root: Path, episodes: int) -> dict[str, Figure]:
    """One clip of 100 steps from a reader that knows nothing yet."""
    dataset = Dataset.create(root / "large")
    dataset.add_episodes(noise_episode(seed, 200) for seed in range(episodes))
    hashes = [entry.sha256 for entry in dataset.entries()]
    rng = np.random.default_rng(0)
    times_s: list[float] = []
    for sha256 in rng.choice(hashes, 200):
        start_s = time.process_time()
        Dataset.open(dataset.root).clip_features(Clip(str(sha256), 40, LONG_STEPS))
        times_s.append(time.process_time() - start_s)
    shutil.rmtree(dataset.root)
    return {"window_ms": 1000 * median(times_s), "window_episodes": episodes}


def answered_dataset(root: Path, episodes: int, pairs: int, steps: int) -> Dataset:
    """Noise, and answers to random pairs of clips of it."""
    dataset = Dataset.create(root)
    added = dataset.add_episodes(noise_episode(seed) for seed in range(episodes))
    rng = np.random.default_rng(0)

    def clip() -> Clip:
        entry = added[rng.integers(len(added))]
        return Clip(entry.sha256, int(rng.integers(STEPS - steps)), steps)

    asked = [Pair.make(clip(), clip(), strategy="", round=0) for _ in range(pairs)]
    with dataset.answers() as store:
        store.add_rater("noise", "scripted")
        store.add_pairs(asked)
        for number, pair in enumerate(asked):
            store.add_answer(
                Answer(
                    answer_id=str(number),
                    pair_id=pair.pair_id,
                    rater_id="noise",
                    choice="a" if rng.random() < 0.5 else "b",
                    shown_left="a",
                    created_utc="2030-01-31T12:00:00Z",
                )
            )
    return dataset


def pairs_figures(root: Path, pairs: int, repeats: int) -> dict[str, Figure]:
    """A training tensor from files and answers, against slicing arrays in memory."""
    dataset = answered_dataset(root / "pairs", 200, pairs, LONG_STEPS)
    arrays = {e.sha256: np.array(dataset.features(e.sha256)) for e in dataset.entries()}
    with dataset.answers_copy() as store:
        asked = [pair for pair, _ in store.current_answers()]
    clips = [side for pair in asked for side in (pair.a, pair.b)]
    warm = Dataset.open(dataset.root)
    load_pairs([warm])
    slicing_s, cold_s, warm_s = best_of(
        repeats,
        lambda: torch.from_numpy(np.stack([arrays[c.rollout][c.rows] for c in clips])),
        lambda: load_pairs([Dataset.open(dataset.root)]),
        lambda: load_pairs([warm]),
    )
    return {
        "pairs_over_slicing": warm_s / slicing_s,
        "pairs_over_slicing_cold": cold_s / slicing_s,
    }


def fit_figures(root: Path, episodes: int, pairs: int) -> dict[str, Figure]:
    """The peak of a whole `gaitpref fit`, in a process of its own."""
    dataset = answered_dataset(root / "fit", episodes, pairs, LOOP_STEPS)
    run = gaitpref("fit", "--dataset", dataset.root, "--out", root / "reward")
    return {"fit_peak_gb": run.peak_mb / 1024, "fit_pairs": pairs, "fit_s": run.wall_s}


def verify_figures(root: Path, repeats: int) -> dict[str, Figure]:
    """Verifying a data set, answers too, against sha256 of its episodes; wall time."""
    dataset = Dataset.open(root)
    paths = [dataset.path_of(entry) for entry in dataset.entries()]

    def plain() -> None:
        for path in paths:
            with path.open("rb") as file:
                hashlib.file_digest(file, "sha256")

    plain_s, verify_s = best_of(
        repeats, plain, lambda: verify(root), clock=time.perf_counter
    )
    return {"verify_over_sha256": plain_s / verify_s}


def measure(root: Path, quick: bool) -> Iterator[tuple[Part, Measured]]:
    """All parts, each of which is measured when it is called."""
    repeats = 5 if quick else 30
    yield "logging", lambda: logging_figures(root, quick)
    yield "write", lambda: write_figures(root, 10 * repeats)
    yield "window", lambda: window_figures(root, 200 if quick else 10_000)
    yield "pairs", lambda: pairs_figures(root, 200 if quick else 2000, repeats)
    fitted = (200, 200) if quick else (5000, 20_000)
    yield "fit", lambda: fit_figures(root, *fitted) | verify_figures(root / "fit", 3)
    yield "models", lambda: models_figures(root)


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure, print, and write the figures if asked to."""
    torch.set_num_threads(1)
    figures: dict[str, Figure] = {}
    if options.work is not None:
        options.work.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.work) as root:
        for part, measured in measure(Path(root), options.quick):
            if part in options.parts:
                figures |= measured()
    publish("data", figures, GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
