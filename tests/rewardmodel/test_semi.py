"""Pairs nobody answered: which opinions count, and what they may not see."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.data import answered_dataset
from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from rewardmodel import RewardError
from rewardmodel.answers.answered_pairs import AnsweredPairs, load_pairs
from rewardmodel.answers.likelihood import Errors
from rewardmodel.cfg import FitCfg
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.extensions.questions.unanswered import unanswered_pairs
from rewardmodel.extensions.semi_supervised import Unanswered, with_opinions
from rewardmodel.extensions_cfg import SemiSupervisedCfg
from rewardmodel.fitting.fit_reward import fit_reward
from rewardmodel.measures.held_out import fold_of
from rewardmodel.models.storage import load_reward
from rewardmodel.prepared.described import DescribedPairs

SEMI = SemiSupervisedCfg(confidence=0.9, error_share=0.6, pairs_per_answer=2)
CFG = FitCfg(semi_supervised=SEMI)


def _pairs(count: int, num_steps: int) -> DescribedPairs:
    return DescribedPairs(
        steps=torch.arange(2.0 * count * num_steps).view(2, count, num_steps, 1),
        scored=torch.ones(2, count, num_steps, dtype=torch.bool),
        fall_lead=torch.zeros(count),
        target=torch.full((count,), 0.5),
        errors=Errors.alike(0.3, count, tie_threshold=1.0),
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Noise with 40 answers; all episodes obey one command."""
    return answered_dataset(tmp_path_factory.mktemp("semi") / "set", 12, 40, 30)


@pytest.fixture(scope="module")
def others(dataset: Dataset) -> AnsweredPairs:
    found = unanswered_pairs(
        [dataset], load_pairs([dataset]), SEMI, rng=np.random.default_rng(0)
    )
    assert found is not None
    return found


def test_only_what_all_members_are_sure_of_counts() -> None:
    """Sure and agreed, agreed but unsure, sure and at odds, sure of the right."""
    leads = torch.tensor([[5.0, 0.5, 5.0, -5.0], [5.0, 0.5, -5.0, -5.0]])
    both = with_opinions(_pairs(3, 4), _pairs(4, 2), leads, CFG)
    assert both.target.tolist() == [0.5, 0.5, 0.5, 1.0, 0.0]
    assert both.errors.share.tolist() == pytest.approx([0.3, 0.3, 0.3, 0.6, 0.6])
    # Shorter clips are padded, and what is padded does not count.
    assert both.steps.shape == (2, 5, 4, 1)
    assert both.scored[:, 3:].sum(dim=-1).tolist() == [[2, 2], [2, 2]]
    blank = Normaliser(1)
    blank.std.fill_(100.0)
    difference = both.standardised(blank).difference[3:, 0]
    assert difference.tolist() == pytest.approx([-0.08, -0.08])
    unsure = with_opinions(_pairs(3, 4), _pairs(4, 2), torch.zeros(2, 4), CFG)
    assert len(unsure) == 3


def test_pairs_nobody_was_asked_about(dataset: Dataset, others: AnsweredPairs) -> None:
    """As many as wanted, from different episodes, as long as what was judged."""
    assert 40 <= len(others) <= 80
    assert others.left.features.shape[1] == 30
    assert all(left != right for left, right in others.episodes)
    # They are questions to the reward alone.
    with dataset.answers_copy() as store:
        assert len(store.pairs()) == 40
    empty = Dataset.create(dataset.root.parent / "other")
    empty.add_from(dataset, [dataset.entries()[0].sha256])
    # A single episode has nobody to be compared with.
    with pytest.raises(RewardError, match="come from different episodes"):
        unanswered_pairs(
            [empty], load_pairs([dataset]), SEMI, rng=np.random.default_rng(0)
        )


def test_a_fold_hears_no_opinion_about_its_episodes(others: AnsweredPairs) -> None:
    """Else the model it measures would have seen the clips it is asked about."""
    folds = torch.tensor([[fold_of(sha) for sha in pair] for pair in others.episodes])
    all_of_them = Unanswered(_pairs(len(others), 2), folds)
    for fold in range(5):
        kept = all_of_them.without(fold)
        assert (kept.folds != fold).all()
        assert len(kept.pairs) == int((folds != fold).all(dim=1).sum()) < len(others)


def test_opinions_change_the_reward_only_where_asked_for(
    dataset: Dataset, others: AnsweredPairs
) -> None:
    """The same bytes without the setting, and other ones with it."""
    answered = load_pairs([dataset])
    # Of noise nobody is sure.
    sure = replace(CFG, semi_supervised=replace(SEMI, confidence=0.51))
    weights = []
    for cfg, given in ((FitCfg(), None), (FitCfg(), others), (sure, others)):
        model, _ = fit_reward(answered, cfg, seed=0, unanswered=given, measured=False)
        weights.append(model.scorer.state_dict())
    for name, plain in weights[0].items():
        assert plain.equal(weights[1][name])
        assert not plain.equal(weights[2][name])


def test_the_command(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The reward says how it was fitted, and reads as any other."""
    out = tmp_path / "reward"
    command = ["fit", "--dataset", str(dataset.root), "--out", str(out)]
    assert main([*command, "--semi-supervised", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["answers"] == 40
    assert load_reward(out).provenance.cfg.semi_supervised == SemiSupervisedCfg()


def test_a_data_set_with_nothing_to_compare_gives_none(
    dataset: Dataset, tmp_path: Path
) -> None:
    """One episode has no other beside it; the pairs are those of the other data set."""
    single = Dataset.create(tmp_path / "single")
    single.add_from(dataset, [dataset.entries()[0].sha256])
    answers = load_pairs([dataset])
    found = unanswered_pairs(
        [single, dataset], answers, SemiSupervisedCfg(), rng=np.random.default_rng(0)
    )
    assert found is not None
    names = {entry.sha256 for entry in dataset.entries()}
    assert {sha256 for pair in found.episodes for sha256 in pair} <= names
