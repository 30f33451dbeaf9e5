"""Shares of a pair's lead: by moment, habit and whatever else, each row the whole."""

from __future__ import annotations

import math

import numpy as np
import pytest

from data.features import column
from rewardmodel import FitCfg, RewardModel, fit_reward
from rewardmodel.answers.clip_batch import ClipBatch, pad_clips
from rewardmodel.explain.credit import FALL, Credit, Side, credit
from tests.rewardmodel.test_fit import answered, gait

STEPS = 20


@pytest.fixture(scope="module", params=["linear", "posterior"])
def model(request: pytest.FixtureRequest) -> RewardModel:
    cfg = FitCfg(kind=request.param)
    return fit_reward(answered(30, seed=3), cfg, seed=0, measured=False)[0]


def one(seed: int, steps: int = STEPS, *, fell: bool = False) -> ClipBatch:
    rows = gait(np.random.default_rng(seed), steps)
    rows[-1, column("fallen")] = fell
    return pad_clips([rows])


def parted(model: RewardModel, left: Side, right: Side) -> Credit:
    price = model.provenance.cfg.fall_logit / float(model.reward_std)
    return credit(left, right, fall_price=price, control_dt_s=0.02)


def test_every_row_is_the_lead_that_is_paid(model: RewardModel) -> None:
    clips = one(1), one(2, steps=14)
    paid = [model.clip_rewards(clip)[0].mean().item() for clip in clips]
    left = Side.of(model, clips[0], runs=[("trot", 0, 5), ("walk", 5, 20)])
    right = Side.of(model, clips[1], runs=[("walk", 0, 14)])
    found = parted(model, left, right)
    assert found.lead == pytest.approx(paid[0] - paid[1], abs=1e-4)
    assert set(found.rows) == {"habit", "choice"}
    for row in found.rows.values():
        assert math.fsum(row.values()) == pytest.approx(found.lead, abs=1e-4)
    assert set(found.rows["choice"]) == {"trot", "walk"}
    assert [len(part) for part in found.moments] == [20, 14]
    # Sides exchanged, all of it speaks for the other.
    assert parted(model, right, left).lead == pytest.approx(-found.lead, abs=1e-4)


def test_a_fall_is_a_share_of_its_own(model: RewardModel) -> None:
    stands, falls = Side.of(model, one(1)), Side.of(model, one(2, fell=True))
    found = parted(model, stands, falls)
    price = model.provenance.cfg.fall_logit / float(model.reward_std)
    assert found.rows["habit"][FALL] == found.falls == pytest.approx(price)
    assert found.moments[1][-1] == 0.0  # The step that falls is paid nothing.
    both = parted(model, Side.of(model, one(1, fell=True)), falls)
    assert FALL not in both.rows["habit"]


def test_shares_that_do_not_add_up_are_refused() -> None:
    moments = (np.full(4, 0.25), np.zeros(4))
    with pytest.raises(ValueError, match=r"by habit add up to 0\.9000, the lead is 1"):
        Credit(lead=1.0, moments=moments, falls=0.0, rows={"habit": {"feet": 0.9}})
    with pytest.raises(ValueError, match="by moment"):
        Credit(lead=2.0, moments=moments, falls=0.0, rows={})
    with pytest.raises(ValueError, match="nan"):
        Credit(lead=math.nan, moments=moments, falls=0.0, rows={})
