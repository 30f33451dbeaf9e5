"""Whether a run's last reward foresees answers nobody gave it.

The questions of a loop are its hardest: those on which the ensemble disagrees. Nor can
a hundred of them show a calibration error of a few hundredths. Here the criterion
answers `PAIRS` pairs drawn at random from all the run's episodes; and as calibration is
about answers, the row's own rater answers them too, errors and all.

Shapes: B pairs, R times that each is answered.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.raters.criteria import Criterion
from gaitpref.raters.error_model import judge
from gaitpref.raters.simulated import ClipScores, standards_among
from rewardmodel import RewardModel, Uniform, choose_pairs
from rewardmodel.answers.clip_batch import ClipBatch, read_clips
from rewardmodel.asking.clip_questions import clips_of
from rewardmodel.measures.calibration import Calibration, calibration
from rewardmodel.models.storage import load_reward
from rewardmodel.trust.held_out_report import accuracy_of

PAIRS = 400
_SEED = 1_000_004
_TARGETS = {"a": 1.0, "b": 0.0}
_TIMES = 20
"""That each pair is answered: of a rater who errs, 400 answers alone show a calibration
error of a few hundredths."""


@dataclass(frozen=True, eq=False)
class FreshPairs:
    """Pairs nobody was asked about, what the criterion says of them, and the rater."""

    left: ClipBatch
    right: ClipBatch
    target: Tensor
    """[B] 1, 0.5 or 0: left, neither, right is better."""
    answers: Tensor
    """[B, R] the same as the rater says it; 0.5 where nothing is preferred."""

    def leads(self, model: RewardModel) -> Tensor:
        """What `model` says of them: logit [B] of the left clips."""
        return model.lead(self.left, self.right)

    def calibration(self, logit: Tensor) -> Calibration | None:
        """How well logits [B] foretell what the rater says."""
        repeated = logit[:, None].expand_as(self.answers)
        return calibration(repeated.flatten(), self.answers.flatten())


def fresh_pairs(run: Path, cfg: LoopCfg, criterion: Criterion) -> FreshPairs:
    """Pairs drawn at random from all episodes of a run."""
    dataset = Dataset.open(run / "dataset")
    entries = dataset.entries()
    with dataset.answers_copy() as store:
        asked = store.pairs()
    pairs = choose_pairs(
        entries,
        clips_of(entries, cfg.clips),
        PAIRS,
        strategy=Uniform(),
        round=0,
        known_pairs=asked,
        rng=np.random.default_rng(_SEED),
    )
    scores = ClipScores(dataset.features, criterion)
    known = standards_among(asked, scores, cfg.simulated)
    rng = np.random.default_rng(_SEED)

    def answer(pair: Pair) -> float:
        said = judge(scores(pair.a), scores(pair.b), cfg.simulated, known, rng)
        return _TARGETS.get(said, 0.5)

    answers = [[answer(pair) for _ in range(_TIMES)] for pair in pairs]
    better = [scores(pair.a).mean() - scores(pair.b).mean() for pair in pairs]
    left, right = (
        read_clips(clips, dataset.clip_features)
        for clips in zip(*((pair.a, pair.b) for pair in pairs), strict=True)
    )
    target = (torch.tensor(np.array(better)).sign() + 1) / 2
    return FreshPairs(left, right, target, torch.tensor(answers))


def on_fresh_pairs(
    run: Path, cfg: LoopCfg, criterion: Criterion
) -> dict[str, float | None]:
    """Accuracy and calibration error of a run's last fit on pairs drawn at random.

    Accuracy is about what the criterion prefers, calibration about what the rater would
    answer, beside what a calibrated reward would show on as many. None where there is
    no preference.
    """
    model = load_reward(run / f"rounds/{cfg.rounds - 1:02d}/reward")
    pairs = fresh_pairs(run, cfg, criterion)
    accuracy = accuracy_of(pairs.leads(model), pairs.target)
    found = pairs.calibration(model.logit(pairs.left, pairs.right))
    return {
        "fresh_accuracy": accuracy.share if accuracy else None,
        "fresh_ece": found.ece if found else None,
        "fresh_ece_by_chance": found.ece_by_chance if found else None,
    }
