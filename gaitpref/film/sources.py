"""What can be filmed: a clip, both clips of a pair, policies told the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.files.telling import Tell, silent
from policy.rollouts.record import record
from policy.rollouts.record_cfg import Command, RecordCfg, recorded_commands
from policy.training.checkpoint import load_policy

from .shot import Shot, shot_of


def shot_of_clip(dataset: Dataset, clip: Clip, caption: str = "") -> Shot:
    """The clip of a data set."""
    return shot_of(dataset.read(clip.rollout), clip, caption=caption)


def shots_of_pair(dataset: Dataset, pair: Pair) -> tuple[Shot, Shot]:
    """Both clips of a pair, A and B."""
    a, b = ((pair.a, "A"), (pair.b, "B"))
    return shot_of_clip(dataset, *a), shot_of_clip(dataset, *b)


def shot_of_policy(
    path: Path,
    command: Command,
    *,
    duration_s: float,
    seed: int = 0,
    tell: Tell = silent,
) -> Shot:
    """What a policy does without exploration noise, under the recorded command that is
    nearest to `command`; equal seeds begin alike. `tell` gets control steps.

    Raises:
        GaitprefError: the file holds no policy.
    """
    policy = load_policy(path)
    recorded = recorded_commands(policy.info.env.commands)
    nearest = min(recorded, key=lambda each: np.abs(np.subtract(each, command)).sum())
    cfg = RecordCfg(episodes=1, episode_s=duration_s, noisy_share=0.0)
    (episode,) = record(
        path, cfg, seed=seed, policies=[policy], commands=[nearest], tell=tell
    )
    told = ", ".join(f"{number:g}" for number in nearest)
    name = "/".join(path.parts[-3:-1])
    return shot_of(episode, caption=f"{name}  {policy.info.steps:,} steps  ({told})")


def before_and_after(
    dataset: Dataset, first: str, last: str, *, most_s: float
) -> tuple[Shot, Shot] | None:
    """Two policies, by their SHA-256, from equal starts under the same command, the
    fastest one straight ahead; None where the data set does not show both so."""
    entries = dataset.entries()
    round_ = max((entry.meta.round for entry in entries), default=0)
    recorded = [
        {
            (e.meta.env_index, e.meta.command): e
            for e in entries
            if e.meta.policy_sha256 == sha256 and e.meta.round == round_
        }
        for sha256 in (first, last)
    ]
    both = [key for key in recorded[0] if key in recorded[1]]
    if first == last or not both:
        return None
    key = max(both, key=lambda k: (k[1][0] - abs(k[1][1]) - abs(k[1][2]), -k[0]))
    shots = []
    for of_policy, caption in zip(recorded, ("before", "after"), strict=True):
        entry = of_policy[key]
        steps = min(entry.num_steps, round(most_s / entry.meta.control_dt_s))
        shots.append(shot_of_clip(dataset, Clip(entry.sha256, 0, steps), caption))
    return shots[0], shots[1]
