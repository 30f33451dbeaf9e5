"""Whether a run's last reward foresees answers nobody gave it.

The questions of a loop are its hardest: those on which the ensemble disagrees. Nor can
a hundred of them show a calibration error of a few hundredths. Here the criterion
answers `PAIRS` pairs drawn at random from all the run's episodes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from data.dataset import Dataset
from gaitpref.criteria import Criterion
from gaitpref.questions import clips_of
from gaitpref.rater import ClipScores
from gaitpref.run_config import LoopCfg
from rewardmodel import Uniform, choose_pairs
from rewardmodel.calibration import calibration
from rewardmodel.clips import pad_clips
from rewardmodel.storage import load_reward
from rewardmodel.trust import accuracy_of

PAIRS = 400
_SEED = 1_000_004


def on_fresh_pairs(
    run: Path, cfg: LoopCfg, criterion: Criterion
) -> dict[str, float | None]:
    """Accuracy and calibration error of a run's last fit on pairs drawn at random.

    None where the criterion prefers no clip to another.
    """
    dataset = Dataset.open(run / "dataset")
    model = load_reward(run / f"rounds/{cfg.rounds - 1:02d}/reward")
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
    target = (torch.tensor(np.array(better)).sign() + 1) / 2
    left, right = (
        pad_clips([dataset.clip_features(clip) for clip in clips])
        for clips in zip(*((pair.a, pair.b) for pair in pairs), strict=True)
    )
    lead = model.leads(left, right).mean(dim=0)
    accuracy = accuracy_of(lead, target)
    found = calibration(lead / model.provenance.report.temperature, target)
    return {
        "fresh_accuracy": accuracy.share if accuracy else None,
        "fresh_ece": found.ece if found else None,
    }
