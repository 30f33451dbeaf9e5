"""Does the reward of a finished run point at the right moments?

`python -m studies.moments --run RUN [RUN ...]` takes clips that nobody was asked
about: the last reward should rank their steps as the criterion does, and be lowest
where a stumble is planted in walks of the newest policy.

Shapes: T steps, F feature columns.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from numpy.typing import ArrayLike

from data.datasets.dataset import Dataset
from data.features import column
from gaitpref.loop.run_config import read_config
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from policy.training.checkpoint import load_policy
from policy.training.reward_ppo import ScoreFn
from rewardmodel.answers.clip_batch import pad_clips
from rewardmodel.explain.attribution import explain
from rewardmodel.models.model import RewardModel
from rewardmodel.models.storage import load_reward

STUMBLE_STEPS = 3
NEAR_STEPS = 5
"""A minimum so near to the middle of the stumble has found it."""
_CLIPS = 40
_FIRST, _STEPS = 60, 60
"""First step and steps of what is looked at: the start from standing is over there."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """How reward and criterion rank the steps of a clip, and the share of walks in
    which a planted stumble is the worst moment."""

    run: tuple[Path, ...]
    """Finished runs of `gaitpref loop`."""
    seed: int = 0
    """Where in the clips it is planted."""


def stumble(clip: np.ndarray, step: int) -> np.ndarray:
    """The clip [T, F] with the trunk dropping and pitching for a few steps."""
    rows = clip.copy()
    moment = slice(step, step + STUMBLE_STEPS)
    rows[moment, column("base_lin_vel_b").start + 2] -= 0.6
    rows[moment, column("base_lin_vel_b").start] -= 0.3
    rows[moment, column("base_ang_vel_b").start + 1] += 3.0
    rows[moment, column("gravity_b").start] += 0.3
    rows[moment, column("base_height")] -= 0.04
    return rows


def share_found(
    model: RewardModel, clips: list[np.ndarray], rng: np.random.Generator
) -> float:
    """Share of `clips` [T, F] in which a stumble planted anywhere is the minimum."""
    found = 0
    for clip in clips:
        step = int(rng.integers(5, len(clip) - 10))
        lowest = int(explain(model, pad_clips([stumble(clip, step)])).reward.argmin())
        found += abs(lowest - (step + STUMBLE_STEPS // 2)) <= NEAR_STEPS
    return found / len(clips)


def spearman(one: ArrayLike, other: ArrayLike) -> float:
    """Rank correlation of values, hardly any of them equal."""
    first, second = (np.argsort(np.argsort(np.asarray(v))) for v in (one, other))
    return float(np.corrcoef(first, second)[0, 1])


def rank_correlation(
    model: RewardModel, score: ScoreFn, clip: np.ndarray
) -> float | None:
    """Spearman's, of the reward and the score of the steps of `clip` [T, F]; None where
    the score is the same throughout."""
    starts = (torch.arange(len(clip)) == 0)[:, None]
    scores = score(torch.tensor(clip)[:, None], starts)[:, 0].numpy()
    if np.ptp(scores) == 0:
        return None
    return spearman(explain(model, pad_clips([clip])).reward, scores)


def unasked(run: Path, model: RewardModel, round: int) -> list[np.ndarray]:
    """Clips [T, F] of a round's episodes that no answer is about, without falls."""
    dataset = Dataset.open(run / "dataset")
    names = json.loads((run / f"rounds/{round:02d}/episodes.json").read_text())
    fresh = [name for name in names if name not in model.provenance.episodes]
    rows = [dataset.features(name) for name in fresh[:_CLIPS]]
    clips = [r[_FIRST : _FIRST + _STEPS] for r in rows if len(r) >= _FIRST + _STEPS]
    return [clip for clip in clips if not clip[:, column("fallen")].any()]


def main(options: Options) -> int:
    torch.set_num_threads(1)
    for run in options.run:
        cfg = read_config(run)
        last = cfg.rounds - 1
        model = load_reward(run / f"rounds/{last:02d}/reward")
        policy = load_policy(run / f"rounds/{last:02d}/policy/policy.pt")
        context = criterion_context(policy.robot(), policy.info.env)
        score = score_of_criterion(load_criterion(cfg.criterion, context))
        by_round = [unasked(run, model, round) for round in range(cfg.rounds)]
        found = [rank_correlation(model, score, c) for clips in by_round for c in clips]
        ranked = [each for each in found if each is not None]
        share = share_found(model, by_round[-1], np.random.default_rng(options.seed))
        print(
            f"{run.name}: rank correlation {np.median(ranked):.2f} (median of "
            f"{len(ranked)} clips), stumble found in {share:.2f} of "
            f"{len(by_round[-1])} walks"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
