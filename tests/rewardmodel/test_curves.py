"""Curves of few descriptors: wishes about one foot, one rhythm, one best amount."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import Tensor

from data.episodes.clips import Clip
from data.features import FEATURE_DIM, LEGS, column
from rewardmodel import AnsweredPairs, FitCfg, RewardModel, fit_reward
from rewardmodel.answers.clip_batch import pad_clips, read_clips
from rewardmodel.cfg import PosteriorCfg, ReliabilityCfg
from rewardmodel.descriptors.habits import TOLD
from rewardmodel.descriptors.stride_rate import stride_rate
from rewardmodel.descriptors.table import describe, names_seen
from rewardmodel.explain.attribution import explain
from rewardmodel.explain.learned_curves import learned_curves
from rewardmodel.measures.rater_reliability import HARDLY_LOOKS, judge
from rewardmodel.models.kinds import prepare
from rewardmodel.opinions.ranges import HABITS, Ranges
from rewardmodel.trust.held_out_report import foresee
from tests.rewardmodel.test_fit import accuracy, answered, gait

STEPS = 60
SEEN = names_seen("legs")
POSTERIOR = FitCfg(kind="posterior", tie_threshold=0.3)

Taste = Callable[[Tensor], Tensor]
"""Worth [B] of clips whose rows are [B, T, F]."""


def stepping(rng: np.random.Generator) -> np.ndarray:
    """Rows of a robot whose feet step at a rhythm of the clip, some more in phase."""
    rows = gait(rng, STEPS)
    phase = rng.uniform(1.5, 4.0) * 0.02 * np.arange(STEPS)[:, None] + rng.random(4)
    rows[:, column("foot_contact")] = np.sin(2 * math.pi * phase) > 0
    lifted = rows[:, column("foot_contact")] == 0
    rows[:, column("foot_height")] = lifted * rng.uniform(0.02, 0.12, 4)
    rows[:, column("base_height")] = rng.uniform(0.2, 0.4)
    return rows


def asked(
    taste: Taste, count: int, *, seed: int, flipped: float = 0.0
) -> AnsweredPairs:
    """Pairs of stepping robots, answered by `taste`, a share of them wrongly."""
    rng = np.random.default_rng(seed)
    left, right = (
        pad_clips([stepping(rng) for _ in range(count)]) for _ in ("left", "right")
    )
    better = taste(left.features) > taste(right.features)
    wrong = torch.from_numpy(rng.random(count) < flipped)
    pairs = answered(count, seed=seed)
    return replace(pairs, left=left, right=right, target=(better != wrong).float())


def mean_of(name: str, rows: Tensor) -> Tensor:
    """Mean [B] of a descriptor over clips' rows [B, T, F]."""
    return describe(rows, "legs")[..., SEEN.index(name)].mean(dim=1)


def one_foot(rows: Tensor) -> Tensor:
    return mean_of("foot_height_RL", rows)


def best_height(rows: Tensor) -> Tensor:
    return -(mean_of("height", rows) - 0.3).abs()


def apart(rows: Tensor) -> Tensor:
    return mean_of("side_support", rows)


def front_feet(rows: Tensor) -> Tensor:
    return mean_of("foot_height_front", rows) - mean_of("foot_height_rear", rows)


def effort(rows: Tensor) -> Tensor:
    return -mean_of("torque_sq", rows)


def best_rate(rows: Tensor) -> Tensor:
    lifted = (rows[:, :-1] - rows[:, 1:])[..., column("foot_contact")] > 0
    return -(lifted.float().sum(dim=(1, 2)) / 4 / (STEPS * 0.02) - 2.75).abs()


def fitted(taste: Taste, count: int) -> RewardModel:
    """To so many answers by `taste`."""
    pairs = asked(taste, count, seed=0)
    return fit_reward(pairs, POSTERIOR, seed=0, measured=False)[0]


def curves_kept(model: RewardModel) -> set[str]:
    """Names of the habits whose curves make at least a tenth of what the highest
    makes."""
    payer = model.payer
    heights, names = payer.heights, HABITS
    assert heights is not None
    least = 0.1 * heights.max()
    return {n for n, h in zip(names, heights, strict=True) if h > least}


def test_what_is_paid_is_what_is_measured() -> None:
    """Of steps, clips and pairs: what the members agree on, doubted as they differ."""
    pairs = asked(best_rate, 60, seed=0)
    model, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
    alone = RewardModel(model.normaliser, model.payer, model.provenance)
    alone.reward_mean, alone.reward_std = model.reward_mean, model.reward_std
    lead = model.lead(pairs.left, pairs.right)
    assert lead.allclose(alone.leads(pairs.left, pairs.right)[0], atol=1e-4)
    assert not lead.allclose(model.leads(pairs.left, pairs.right).mean(dim=0), atol=0.1)
    steps, starts = pairs.left.features.transpose(0, 1), torch.zeros(STEPS, 60)
    paid = model.centred(alone.members(steps, starts)[0])
    assert model(steps, starts).allclose(paid, atol=1e-4)
    reward, spread = model.clip_rewards(pairs.left)
    worth = reward.mean(dim=1) - model.clip_rewards(pairs.right)[0].mean(dim=1)
    assert (worth * model.reward_std).allclose(lead, atol=1e-3)
    assert float(spread.mean()) > 0.01
    both = torch.cat([reward, model.clip_rewards(pairs.right)[0]])
    # In deviations of a member: what members disagree about is not scaled up again.
    sides = (pairs.left, pairs.right)
    rows = torch.cat([side.features for side in sides]).transpose(0, 1)
    of_members = model.members(rows, torch.zeros(rows.shape[:2])).flatten(1)
    agreed = of_members.mean(dim=0).std() / of_members.std(dim=1).mean()
    assert float(both.std()) == pytest.approx(float(agreed), abs=0.02)
    assert agreed < 0.97


def test_random_answers_are_not_foreseen() -> None:
    """Among so many descriptors some fit them by chance; held-out answers say so."""
    _, report = fit_reward(asked(one_foot, 60, seed=0, flipped=0.5), POSTERIOR, seed=0)
    assert report.held_out_accuracy is not None
    assert report.held_out_accuracy < 0.6


def test_raters_are_judged_by_a_reward_that_can_say_what_they_want() -> None:
    """Two who want the same height of the middle: to weights they would seem to answer
    at random."""
    pairs, fresh = asked(best_height, 80, seed=1), asked(best_height, 300, seed=99)
    raters = ("ada", "bob") * 40
    model, report = fit_reward(
        replace(pairs, raters=raters), POSTERIOR, seed=0, measured=False
    )
    assert max(share for _, share in report.raters) < 0.2
    assert accuracy(model, fresh) > 0.85


@pytest.mark.parametrize(
    ("taste", "least"),
    [(effort, 0.9), (best_height, 0.85), (one_foot, 0.9)],
)
@pytest.mark.parametrize("how", ["at random", "always left"])
def test_who_does_not_look_is_found_out_whatever_is_wanted(
    taste: Taste, least: float, how: str
) -> None:
    """Half of the answers say nothing."""
    pairs, fresh = asked(taste, 80, seed=1), asked(taste, 300, seed=99)
    chance = torch.rand(80, generator=torch.Generator().manual_seed(0)) < 0.5
    said = chance.float() if how == "at random" else torch.ones(80)
    careless = torch.where(torch.arange(80) % 2 == 0, pairs.target, said)
    spoiled = replace(pairs, raters=("ada", "bob") * 40, target=careless)
    model, report = fit_reward(spoiled, POSTERIOR, seed=0, measured=False)
    shares = dict(report.raters)
    assert shares["ada"] < 0.3
    assert shares["bob"] > 0.6
    assert accuracy(model, fresh) > least
    blind = replace(POSTERIOR, reliability=ReliabilityCfg(enabled=False))
    alike, _ = fit_reward(spoiled, blind, seed=0, measured=False)
    assert accuracy(alike, fresh) <= accuracy(model, fresh) + 0.01


def test_who_does_not_look_is_found_out_in_a_crowd() -> None:
    """Nine raters with a dozen answers each, one of them by chance."""
    pairs = asked(effort, 108, seed=1)
    names = tuple("abcdefghi") * 12
    chance = torch.rand(108, generator=torch.Generator().manual_seed(0)) < 0.5
    careless = torch.tensor([name == "c" for name in names])
    target = torch.where(careless, chance.float(), pairs.target)
    spoiled = replace(pairs, target=target, raters=names)
    judged = judge(prepare(spoiled, POSTERIOR), spoiled, POSTERIOR)
    shares = dict(judged.raters)
    assert shares.pop("c") >= HARDLY_LOOKS
    assert max(shares.values()) < 0.3
    assert torch.equal(judged.measuring, ~careless)


def test_who_does_not_look_does_not_measure() -> None:
    """Held-out answers are those of the other, in the fit and when it is asked again;
    neither a fold nor the newest round is judged by chance."""
    pairs = asked(apart, 120, seed=1)
    chance = torch.rand(120, generator=torch.Generator().manual_seed(0)) < 0.5
    bobs = torch.arange(120) % 2 == 1
    spoiled = replace(
        pairs,
        raters=("ada", "bob") * 60,
        target=torch.where(bobs, chance.float(), pairs.target),
        rounds=(0,) * 80 + (1,) * 40,
    )
    model, report = fit_reward(spoiled, POSTERIOR, seed=0)
    assert dict(report.raters)["bob"] >= HARDLY_LOOKS
    assert report.held_out_pairs <= 60
    assert report.held_out_accuracy is not None
    assert report.held_out_accuracy > 0.8
    found = foresee(model, spoiled, seed=0)
    assert found.accuracy is not None
    assert found.newest is not None
    assert found.accuracy.answers == report.held_out_pairs
    assert found.answers + found.left_out > 60
    assert found.newest.answers == 20
    assert found.newest.share > 0.8
    alone = spoiled.subset(bobs)
    assert foresee(model, alone, seed=0).left_out == 0


def test_nobody_is_preferred_where_nobody_looks() -> None:
    """Forty answers of either rater, by chance: neither is taken for one who looks."""
    pairs = asked(effort, 80, seed=4)
    chance = torch.rand(80, generator=torch.Generator().manual_seed(4)) < 0.5
    nobody = replace(pairs, raters=("ada", "bob") * 40, target=chance.float())
    _, report = fit_reward(nobody, POSTERIOR, seed=0, measured=False)
    assert min(share for _, share in report.raters) >= 0.4


@pytest.mark.parametrize("frequency_hz", [1.5, 2.5, 3.5])
def test_the_stride_rate_is_the_one_of_the_feet(frequency_hz: float) -> None:
    """Counted over a second, after which two strides and more have been seen."""
    steps = torch.zeros(1, 150, len(SEEN))
    phase = frequency_hz * 0.02 * torch.arange(150)[:, None] + torch.rand(4)
    down = (phase * 2 * math.pi).sin() > 0
    feet = [SEEN.index(f"contact_{leg}") for leg in LEGS]
    steps[0, :, feet] = down.float() * 2.5 - 1
    rate_hz = stride_rate(steps)[0] / 0.02
    assert (rate_hz[50:] - frequency_hz).abs().max() <= 0.76
    assert abs(float(rate_hz[50:].mean()) - frequency_hz) < 0.1
    starts = torch.zeros(1, 150, dtype=torch.bool)
    starts[0, 100] = True
    assert stride_rate(steps, starts)[0, 100] == 0.0
    alone = stride_rate(steps[:, 100:], starts[:, 100:])
    assert torch.equal(stride_rate(steps, starts)[:, 100:], alone)


def test_squares_are_laid_out_by_their_root() -> None:
    """A quarter of the range of a square is about half of the way, of another a
    quarter; both keep their ends, and a gradient is finite everywhere."""
    ranges = Ranges()
    ranges.ends[1] = 4.0
    steps = torch.tensor([0.0, 1.0, 4.0])[:, None].repeat(1, len(SEEN))
    steps.requires_grad_()
    seen = ranges.places(steps)
    power, height = (seen[:, SEEN.index(name)].tolist() for name in ("power", "height"))
    assert power == pytest.approx([0.0, 0.46, 1.0], abs=0.01)
    assert height == pytest.approx([0.0, 0.25, 1.0])
    seen.sum().backward()
    assert steps.grad is not None
    assert steps.grad.isfinite().all()


def row_with(contact: tuple[int, ...]) -> Tensor:
    row = torch.zeros(FEATURE_DIM)
    row[column("foot_contact")] = torch.tensor(contact, dtype=torch.float32)
    return row


@pytest.mark.parametrize(
    ("contact", "expected"),
    [
        ((1, 0, 0, 1), (1.0, 0.0, 0.0)),
        ((0, 1, 0, 1), (0.0, 1.0, 0.0)),
        ((0, 0, 1, 1), (0.0, 0.0, 1.0)),
        ((1, 1, 1, 1), (0.0, 0.0, 0.0)),
        ((1, 0, 0, 0), (0.5, 0.5, 0.5)),
    ],
)
def test_pairs_of_feet(contact: tuple[int, ...], expected: tuple[float, ...]) -> None:
    """Front right, front left, rear right, rear left: a trot, a pace, a bound, standing
    and one foot alone."""
    found = dict(zip(SEEN, describe(row_with(contact), "legs"), strict=True))
    names = ("diagonal_support", "side_support", "end_support")
    assert tuple(float(found[name]) for name in names) == expected


def test_front_and_rear_feet_are_told_apart() -> None:
    """Whichever foot of the end it is."""
    for leg, end in ((0, "front"), (1, "front"), (2, "rear"), (3, "rear")):
        row = row_with(tuple(int(leg == other) for other in range(4)))
        row[column("foot_height").start + leg] = 0.1
        found = dict(zip(SEEN, describe(row, "legs").tolist(), strict=True))
        other = "rear" if end == "front" else "front"
        for name, expected in (("foot_height", 0.05), ("contacts", 0.5)):
            assert found[f"{name}_{end}"] == pytest.approx(expected)
            assert found[f"{name}_{other}"] == 0.0


def test_one_foot_held_high_does_not_make_up_for_three_low_ones() -> None:
    """Four feet at 0.1 m are clearer of the ground than one at 0.4 m."""
    rows = torch.zeros(3, FEATURE_DIM)
    rows[1, column("foot_height")] = 0.1
    rows[2, column("foot_height").start] = 0.4
    clearance = describe(rows, "legs")[:, SEEN.index("clearance")]
    none, all_four, one = clearance.tolist()
    assert none == 0.0 < one < 0.25 < all_four


def test_who_sees_more_has_the_columns_of_those_who_see_less_in_front() -> None:
    rows = torch.rand(7, FEATURE_DIM)
    seen = [describe(rows, sight) for sight in ("habits", "contacts", "legs")]
    for less, more in pairwise(seen):
        assert torch.equal(more[:, : less.shape[1]], less)
    assert len(set(SEEN)) == len(SEEN)


def test_a_clip_begins_in_the_middle_of_a_walk() -> None:
    """Its first second has the rate of its first whole one; an episode's has not."""
    steps = torch.zeros(1, 80, len(SEEN))
    down = (torch.arange(80) // 10) % 2 == 0  # 2.5 strides a second
    for leg in LEGS:
        steps[0, :, SEEN.index(f"contact_{leg}")] = down * 2.5 - 1
    starts = torch.zeros(1, 80, dtype=torch.bool)
    starts[0, 0] = True
    clip, episode = stride_rate(steps)[0] / 0.02, stride_rate(steps, starts)[0] / 0.02
    assert torch.allclose(clip[:49], clip[49])
    assert float(clip[0]) == pytest.approx(2.5, abs=0.5)
    assert episode[0] == 0.0
    assert torch.equal(clip[49:], episode[49:])
    shortest = stride_rate(steps[:, :50])[0] / 0.02
    assert torch.allclose(shortest, clip[49])


@pytest.fixture(scope="module")
def by_rate() -> RewardModel:
    """Fitted to who likes one rhythm best."""
    pairs = asked(best_rate, 120, seed=0)
    return fit_reward(pairs, POSTERIOR, seed=0, measured=False)[0]


@pytest.mark.parametrize("start", [0, 30, 50, 110])
def test_a_clip_with_its_past_is_paid_as_the_episode_is(
    by_rate: RewardModel, start: int
) -> None:
    """Step by step, also where the episode has not lasted a second yet."""
    rng = np.random.default_rng(5)
    walk = np.concatenate([stepping(rng) for _ in range(4)])
    assert "stride_rate" in curves_kept(by_rate)
    whole, _ = by_rate.episode_rewards(torch.from_numpy(walk))
    clip = Clip("walk", start, 40)
    paid, _ = by_rate.clip_rewards(read_clips([clip], lambda clip: walk[clip.rows]))
    assert torch.allclose(paid[0], whole[clip.rows], atol=1e-4)
    alone, _ = by_rate.clip_rewards(pad_clips([walk[clip.rows]]))
    same = torch.allclose(alone[0], whole[clip.rows], atol=1e-2)
    assert same == (start == 0)


def test_feet_that_chatter_hide_no_walk() -> None:
    """One clip in ten has 12 strides a second, the others 1.5 to 4, of which 2.75 are
    best."""

    def chattering(pairs: AnsweredPairs) -> AnsweredPairs:
        features = pairs.left.features.clone()
        often = torch.arange(STEPS) % 4 < 2
        features[::5, :, column("foot_contact")] = often[:, None].float()
        left = replace(pairs.left, features=features, checked=True)
        better = best_rate(features) > best_rate(pairs.right.features)
        return replace(pairs, left=left, target=better.float())

    pairs = chattering(asked(best_rate, 120, seed=0))
    model, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
    assert accuracy(model, asked(best_rate, 300, seed=99)) > 0.8


def test_what_the_task_pays_for_can_be_left_to_it() -> None:
    """Of following commands nothing is learned; of what else was wanted, as before."""

    def told(rows: Tensor) -> Tensor:
        return -mean_of("yaw_rate_error", rows)

    style = replace(POSTERIOR, posterior=PosteriorCfg(told=False))
    pairs = asked(told, 60, seed=0)
    minded, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
    left, _ = fit_reward(pairs, style, seed=0, measured=False)
    assert curves_kept(minded) & set(TOLD)
    assert not curves_kept(left) & {*TOLD, "forward_speed", "yaw_rate"}
    both = [
        fit_reward(asked(apart, 60, seed=0), cfg, seed=0, measured=False)[0]
        for cfg in (POSTERIOR, style)
    ]
    assert all("side_support" in curves_kept(model) for model in both)


def test_its_curves_say_what_is_best() -> None:
    """In metres, over what was judged; a Gaussian process has none to draw."""
    pairs = asked(best_height, 120, seed=0)
    model, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
    found = {c.habit.name: c for c in learned_curves(model, control_dt_s=0.02)}
    first = next(iter(found.values()))
    assert first.habit.name in ("height", "height_sq")
    best = first.values[first.reward.argmax()]
    best_m = best if first.habit.name == "height" else math.sqrt(best)
    assert best_m == pytest.approx(0.3, abs=0.05)
    gp, _ = fit_reward(pairs, FitCfg(kind="gp"), seed=0, measured=False)
    assert learned_curves(gp, control_dt_s=0.02) == ()


def test_explanations_name_the_habit() -> None:
    model, _ = fit_reward(
        asked(one_foot, 60, seed=0), POSTERIOR, seed=0, measured=False
    )
    found = explain(model, pad_clips([stepping(np.random.default_rng(3))]))
    largest = np.abs(found.shares).mean(axis=0).argmax()
    assert found.groups[largest] == "feet"
    assert np.allclose(
        found.shares.sum(axis=1) + found.average, found.reward, atol=1e-3
    )


def test_a_clip_without_feet_still_has_a_reward() -> None:
    """Hardware that measured no contact: the habits that are there are judged."""
    pairs = asked(best_height, 60, seed=0)
    for clips in (pairs.left, pairs.right):
        clips.features[..., column("foot_contact")] = torch.nan
    model, _ = fit_reward(pairs, POSTERIOR, seed=0, measured=False)
    rewards = model.clip_returns(pairs.left)
    assert rewards.isfinite().all()
    assert accuracy(model, pairs) > 0.8


def test_a_short_clip_is_worth_the_same_beside_any_other(by_rate: RewardModel) -> None:
    """It is padded to the longest of its batch, and padding is no step."""
    assert "stride_rate" in curves_kept(by_rate)
    rng = np.random.default_rng(3)
    short = [stepping(rng)[:25] for _ in range(6)]
    alone = by_rate.clip_returns(pad_clips(short))
    beside = by_rate.clip_returns(pad_clips([*short, stepping(rng)]))[:, :6]
    assert torch.allclose(alone, beside, atol=1e-4)


def test_an_explained_clip_is_worth_what_it_was_to_the_fit(
    by_rate: RewardModel,
) -> None:
    """A clip is not the start of an episode, before which nobody stepped; its shares
    begin at a step that is average in everything, its rate of strides too."""
    rows = stepping(np.random.default_rng(3))
    found = explain(by_rate, pad_clips([rows]))
    rewards, spread = by_rate.clip_rewards(pad_clips([rows]))
    assert np.allclose(found.reward, rewards[0], atol=1e-5)
    assert np.allclose(found.spread, spread[0], atol=1e-5)
    paid = found.shares[:, found.groups.index("stepping")] + found.average
    others = np.abs(found.shares).sum(axis=1) - np.abs(paid - found.average)
    assert np.allclose(paid, found.reward, atol=float(others.max()) + 1e-3)
