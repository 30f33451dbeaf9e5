"""Answers that look wrong to a reward fitted to the others, on a planted taste."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rewardmodel import AnsweredPairs, FitCfg, fit_reward
from rewardmodel.extensions.answers.label_filter import likelihoods
from rewardmodel.extensions_cfg import LabelFilterCfg
from rewardmodel.models.kinds import prepare
from tests.rewardmodel.test_fit import accuracy, answered

CFG = FitCfg(adapt=False, error_share=0.1)


def some_turned_round(seed: int) -> tuple[AnsweredPairs, Tensor]:
    """120 answers of which 20 are turned round, and which [B] these are."""
    pairs = answered(120, seed=seed)
    wrong = torch.zeros(len(pairs), dtype=torch.bool)
    wrong[torch.randperm(120, generator=torch.Generator().manual_seed(seed))[:20]] = (
        True
    )
    return replace(pairs, target=(pairs.target - wrong.float()).abs()), wrong


def likely(pairs: AnsweredPairs) -> Tensor:
    return likelihoods(prepare(pairs, CFG), CFG, seed=0)


def test_the_answers_that_look_most_wrong_are_wrong() -> None:
    """Of the twenty least likely ones, where one in six is by chance."""
    found = []
    for seed in range(3):
        pairs, wrong = some_turned_round(seed)
        least = likely(pairs).argsort()[:20]
        found.append(float(wrong[least].float().mean()))
    assert sum(found) / len(found) > 0.5


def test_what_an_answer_says_has_no_part_in_how_likely_it_is() -> None:
    """Turned round, it is as unlikely as it was likely: nobody saw it."""
    pairs = answered(60, seed=5)
    before = likely(pairs)
    other = pairs.target.clone()
    other[7] = 1 - other[7]
    after = likely(replace(pairs, target=other))
    assert after[7] == pytest.approx(1 - float(before[7]), abs=1e-6)


def test_a_tie_is_never_doubted() -> None:
    pairs = answered(60, seed=5)
    ties = torch.full_like(pairs.target, 0.5).where(torch.arange(60) < 9, pairs.target)
    assert likely(replace(pairs, target=ties))[:9].tolist() == [0.5] * 9


def test_doubted_answers_teach_nothing_and_are_measured_by() -> None:
    """The reward is that of answers that are plainly random, and none is left out."""
    pairs, _ = some_turned_round(1)
    cfg = replace(CFG, label_filter=LabelFilterCfg(below=0.2))
    model, report = fit_reward(pairs, cfg, seed=0)
    plain, kept = fit_reward(pairs, CFG, seed=0)
    assert 5 < report.doubted < 40
    assert kept.doubted == 0
    assert (report.answers, report.held_out_pairs) == (kept.answers, 120)
    fresh = answered(400, seed=99)
    assert accuracy(model, fresh) != accuracy(plain, fresh)
    doubted = (likely(pairs) < 0.2).nonzero()[:, 0]
    turned = pairs.target.clone()
    turned[doubted[0]] = 1 - turned[doubted[0]]
    # Seen the other way round the answer is one of the likeliest, and counts.
    again, _ = fit_reward(replace(pairs, target=turned), cfg, seed=0, measured=False)
    assert not torch.equal(
        again.leads(fresh.left, fresh.right), model.leads(fresh.left, fresh.right)
    )


def test_a_limit_at_which_all_answers_look_wrong_is_refused() -> None:
    with pytest.raises(ValueError, match=r"below must lie in \(0, 0.5\), got 0.5"):
        LabelFilterCfg(below=0.5)
