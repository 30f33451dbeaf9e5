"""Whether a run's last reward foresees answers nobody gave it.

The questions of a loop are its hardest: those on which the ensemble disagrees. Nor can
a hundred of them show a calibration error of a few hundredths. Here the criterion
answers `PAIRS` pairs drawn at random from all the run's episodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data.dataset import Dataset
from gaitpref.criteria import Criterion
from gaitpref.loop_cfg import LoopCfg
from gaitpref.questions import clips_of
from gaitpref.rater import ClipScores
from rewardmodel import RewardModel, Uniform, choose_pairs
from rewardmodel.calibration import calibration
from rewardmodel.clips import ClipBatch, read_clips
from rewardmodel.foresight import accuracy_of
from rewardmodel.storage import load_reward

PAIRS = 400
_SEED = 1_000_004


@dataclass(frozen=True, eq=False)
class FreshPairs:
    """Pairs nobody was asked about, and what the criterion says of them."""

    left: ClipBatch
    right: ClipBatch
    target: Tensor
    """[B] 1, 0.5 or 0: left, neither, right is better."""

    def leads(self, model: RewardModel) -> Tensor:
        """What `model` says of them: logit [B] of the left clips."""
        return model.lead(self.left, self.right)


def fresh_pairs(run: Path, cfg: LoopCfg, criterion: Criterion) -> FreshPairs:
    """Pairs drawn at random from all episodes of a run."""
    dataset = Dataset.open(run / "dataset")
    entries = dataset.entries()
    with dataset.answers_copy() as store:
        known = store.pairs()
    pairs = choose_pairs(
        entries,
        clips_of(entries, cfg.clips),
        PAIRS,
        strategy=Uniform(),
        round=0,
        known_pairs=known,
        rng=np.random.default_rng(_SEED),
    )
    scores = ClipScores(dataset.features, criterion)
    better = [scores(pair.a).mean() - scores(pair.b).mean() for pair in pairs]
    left, right = (
        read_clips(clips, dataset.clip_features)
        for clips in zip(*((pair.a, pair.b) for pair in pairs), strict=True)
    )
    target = (torch.tensor(np.array(better)).sign() + 1) / 2
    return FreshPairs(left, right, target)


def on_fresh_pairs(
    run: Path, cfg: LoopCfg, criterion: Criterion
) -> dict[str, float | None]:
    """Accuracy and calibration error of a run's last fit on pairs drawn at random.

    None where the criterion prefers no clip to another.
    """
    model = load_reward(run / f"rounds/{cfg.rounds - 1:02d}/reward")
    pairs = fresh_pairs(run, cfg, criterion)
    lead = pairs.leads(model)
    accuracy = accuracy_of(lead, pairs.target)
    found = calibration(lead / model.provenance.report.temperature, pairs.target)
    return {
        "fresh_accuracy": accuracy.share if accuracy else None,
        "fresh_ece": found.ece if found else None,
    }
