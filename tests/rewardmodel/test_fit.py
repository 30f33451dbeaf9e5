"""Fitting, holding out, saving and loading, on synthetic clips with a planted taste."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from data.features import FEATURE_DIM, FEATURES, column
from data.files.files import sha256_bytes
from data.files.plain import to_plain
from rewardmodel import (
    AnsweredPairs,
    FitCfg,
    RewardError,
    RewardModel,
    fit_reward,
    fold_of,
    load_reward,
    save_reward,
)
from rewardmodel.answers.clip_batch import ClipBatch, mean_over, pad_clips
from rewardmodel.cfg import LinearCfg, ReliabilityCfg
from rewardmodel.descriptors.habits import FEET, TOLD, UNSTEADY
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES, describe
from rewardmodel.explain.attribution import explain
from rewardmodel.extensions.answers.model_choice import choose_kind
from rewardmodel.extensions_cfg import GpCfg, HistoryCfg, LabelFilterCfg, MlpCfg
from rewardmodel.fitting.fit_reward import models_fitted
from rewardmodel.linear.linear import (
    LinearScorer,
    expected_weights,
    fit_linear,
    members_for,
)
from rewardmodel.models.fit_report import wilson_interval
from rewardmodel.models.kinds import KINDS, prepare
from rewardmodel.prepared.prepared import MIN_SPREAD, Prepared
from rewardmodel.trust.alarms import judged_spread

EPISODES = [hashlib.sha256(bytes([index])).hexdigest() for index in range(60)]
HABITS = (
    ("base_lin_vel_b", "base_ang_vel_b"),
    ("gravity_b",),
    ("joint_pos_offset", "action"),
    ("joint_vel", "joint_torque", "action_rate"),
    ("foot_height", "foot_speed", "foot_air_time"),
)
"""Features that are strong or weak together in a clip."""

QUICK = FitCfg(folds=2)


def fitted(pairs: AnsweredPairs, cfg: FitCfg = QUICK) -> RewardModel:
    """A reward that nobody asks how well it foresees answers."""
    return fit_reward(pairs, cfg, seed=0, measured=False)[0]


DISLIKED = {"torque_sq": 12.0, "tilt_sq": 2.0, "slip": 2.0}
"""Descriptors the planted taste adds up, in units of the number given."""


def gait(rng: np.random.Generator, steps: int) -> np.ndarray:
    """Rows of noise with habits of their own: how strong each group of features is."""
    rows = rng.normal(size=(steps, FEATURE_DIM))
    for habit in HABITS:
        strength = rng.uniform(0.5, 1.5)
        for name in habit:
            rows[:, column(name)] *= strength
    for name in ("foot_height", "foot_speed", "foot_air_time"):
        rows[:, column(name)] = np.abs(rows[:, column(name)])
    rows[:, column("foot_contact")] = rng.random((steps, 4)) < rng.random()
    # Nobody walks on its back.
    down = column("gravity_b").stop - 1
    rows[:, down] = -np.abs(rows[:, down])
    rows[:, column("command")] = (0.5, 0.0, 0.0)
    rows[:, column("fallen")] = 0.0
    return rows.astype(np.float32)


def starts_of(clips: ClipBatch) -> Tensor:
    """[T, B] bool: the first step of each clip."""
    starts = torch.zeros_like(clips.valid.T)
    starts[0] = True
    return starts


def taste(clips: ClipBatch) -> Tensor:
    """The planted criterion [B]: three habits are disliked."""
    means = mean_over(describe(clips.features).mT, clips.scored[:, None])
    return -sum(
        (
            means[:, DESCRIPTOR_NAMES.index(name)] / unit
            for name, unit in DISLIKED.items()
        ),
        start=torch.zeros(len(clips)),
    )


def answered(
    count: int, *, seed: int, flipped: float = 0.0, steps: int = 20
) -> AnsweredPairs:
    """Pairs within a fold, answered by `taste`; a share of the answers is wrong."""
    rng = np.random.default_rng(seed)
    left = pad_clips([gait(rng, steps) for _ in range(count)])
    right = pad_clips([gait(rng, steps) for _ in range(count)])
    better = (taste(left) > taste(right)).numpy()
    wrong = rng.random(count) < flipped
    folds = [[e for e in EPISODES if fold_of(e) == fold] for fold in range(5)]
    drawn = [rng.choice(folds[fold], 2, False) for fold in rng.integers(5, size=count)]
    return AnsweredPairs(
        left=left,
        right=right,
        target=torch.from_numpy(better != wrong).float(),
        episodes=tuple((str(pair[0]), str(pair[1])) for pair in drawn),
        raters=("planted",) * count,
        commands=torch.tensor([[0.5, 0.0, 0.0]]).expand(count, 3),
        rounds=(0,) * count,
        strategies=("uniform",) * count,
        num_without_target=0,
        answers_sha256="0" * 64,
    )


def accuracy(model: RewardModel, pairs: AnsweredPairs) -> float:
    lead = model.leads(pairs.left, pairs.right).mean(dim=0)
    return ((lead > 0) == (pairs.target > 0.5)).float().mean().item()


@pytest.mark.parametrize(("flipped", "least"), [(0.0, 0.9), (0.2, 0.8)])
def test_the_linear_model_recovers_a_planted_taste(
    flipped: float, least: float
) -> None:
    """From a hundred answers, also when a fifth is wrong; judged on fresh pairs."""
    fresh = answered(400, seed=99)
    found = []
    for seed in range(4):
        pairs = answered(100, seed=seed, flipped=flipped)
        model, report = fit_reward(pairs, FitCfg(), seed=0)
        found.append(accuracy(model, fresh))
        assert (report.answers, report.held_out_pairs) == (100, 100)
    assert np.mean(found) > least


def test_a_fit_that_is_not_measured_is_the_same_reward() -> None:
    """For choosing questions: equal weights, no fold fitted, and `auto` stays stiff."""
    pairs = answered(60, seed=1)
    told: list[None] = []
    model, _ = fit_reward(pairs, FitCfg(), seed=3, advance=lambda: told.append(None))
    assert len(told) == models_fitted(FitCfg()) > 1
    quick, report = fit_reward(pairs, FitCfg(), seed=3, measured=False)
    assert report.held_out_pairs == 0
    assert report.held_out_accuracy is None
    assert report.temperature == 1.0
    for name, values in model.state_dict().items():
        assert torch.equal(values, quick.state_dict()[name]), name
    auto, _ = fit_reward(pairs, FitCfg(kind="auto"), seed=3, measured=False)
    assert auto.provenance.cfg.kind == "linear"


def graded(pairs: AnsweredPairs) -> AnsweredPairs:
    """The same answers, "much better" (1, 0) or "better" (0.75, 0.25), by the lead."""
    lead = (taste(pairs.left) - taste(pairs.right)).abs()
    halved = 0.5 + (pairs.target - 0.5) / 2
    return replace(
        pairs, target=torch.where(lead > lead.median(), pairs.target, halved)
    )


def test_how_much_better_a_clip_is_teaches_more() -> None:
    """Few answers with a strength give a better reward than the same without."""
    fresh = answered(400, seed=99)
    plain, strong = [], []
    for seed in range(8):
        pairs = answered(40, seed=seed)
        plain.append(accuracy(fitted(pairs), fresh))
        strong.append(accuracy(fitted(graded(pairs)), fresh))
    assert np.mean(strong) > np.mean(plain) + 0.01


def spoiled(pairs: AnsweredPairs, how: str, *, seed: int) -> AnsweredPairs:
    """The second half of the answers comes from someone who does not look."""
    rng = np.random.default_rng(seed)
    count = len(pairs) // 2
    careless = {"at random": rng.random(count) < 0.5, "always left": np.ones(count)}
    target = pairs.target.clone()
    target[-count:] = torch.tensor(careless[how]).float()
    raters = ("ada",) * (len(pairs) - count) + ("bob",) * count
    return replace(pairs, target=target, raters=raters)


@pytest.mark.parametrize("how", ["at random", "always left"])
def test_a_rater_who_does_not_look_is_found_out(how: str) -> None:
    """The reward is nearly as good as from the careful half; it says whom it trusts."""
    fresh = answered(400, seed=99)
    blind = replace(QUICK, reliability=ReliabilityCfg(enabled=False))
    robust, fooled, careful = [], [], []
    for seed in range(4):
        pairs = spoiled(answered(160, seed=seed), how, seed=seed)
        model, report = fit_reward(pairs, QUICK, seed=0)
        shares = dict(report.raters)
        assert shares["ada"] < 0.2
        assert shares["bob"] > 0.8
        robust.append(accuracy(model, fresh))
        fooled.append(accuracy(fitted(pairs, blind), fresh))
        careful.append(accuracy(fitted(answered(80, seed=seed)), fresh))
    assert np.mean(robust) > np.mean(fooled) + 0.02
    assert np.mean(robust) > np.mean(careful) - 0.04


def test_one_rater_alone_is_not_judged() -> None:
    """There is nobody to compare with: the fit is what it was, bit for bit."""
    pairs = answered(30, seed=1)
    model, report = fit_reward(pairs, QUICK, seed=0)
    blind = replace(QUICK, reliability=ReliabilityCfg(enabled=False))
    other, _ = fit_reward(pairs, blind, seed=0)
    assert report.raters == ()
    assert torch.equal(
        model.state_dict()["scorer.weights"], other.state_dict()["scorer.weights"]
    )


def likes_the_middle(pairs: AnsweredPairs) -> AnsweredPairs:
    """Answered by who likes a middling effort best: no weighted sum says so."""

    def score(clips: ClipBatch) -> Tensor:
        means = mean_over(describe(clips.features).mT, clips.scored[:, None])
        return -(means[:, DESCRIPTOR_NAMES.index("torque_sq")] / 12 - 1).abs()

    return replace(pairs, target=(score(pairs.left) > score(pairs.right)).float())


def test_a_gaussian_process_learns_what_no_weighted_sum_says() -> None:
    """And what one says, it learns as well as the linear model does."""
    gp = replace(QUICK, kind="gp")
    fresh = answered(400, seed=99)
    middle = likes_the_middle(fresh)
    pairs = answered(150, seed=1)
    bent = {
        cfg.kind: accuracy(fitted(likes_the_middle(pairs), cfg), middle)
        for cfg in (QUICK, gp)
    }
    straight = {cfg.kind: accuracy(fitted(pairs, cfg), fresh) for cfg in (QUICK, gp)}
    assert bent["linear"] < 0.65
    assert bent["gp"] > 0.7
    assert straight["gp"] > straight["linear"] - 0.03


def test_the_model_is_chosen_by_held_out_answers(tmp_path: Path) -> None:
    """No network for a weighted sum of three habits, curves for what bends; both say
    why."""
    auto = replace(
        QUICK,
        kind="auto",
        models=(MlpCfg(num_updates=5), HistoryCfg(num_updates=5)),
    )
    pairs = answered(150, seed=1)
    stiff, report = fit_reward(pairs, auto, seed=0)
    # Lines of few habits are what the planted taste is; fresh pairs say so too.
    assert stiff.provenance.cfg.kind in ("linear", "posterior")
    fresh, linear = answered(400, seed=99), fitted(pairs)
    assert accuracy(stiff, fresh) >= accuracy(linear, fresh)
    assert accuracy(stiff, fresh) > 0.9
    # A transformer is tried only where looking back was worth it.
    tried = [kind for kind, _ in report.considered]
    assert tried == ["linear", "posterior", "gp", "mlp", "history"]
    bending, report = fit_reward(likes_the_middle(pairs), auto, seed=0)
    assert bending.provenance.cfg.kind == "posterior"
    found = dict(report.considered)
    assert found["posterior"] > found["linear"]
    save_reward(bending, tmp_path / "reward")
    assert load_reward(tmp_path / "reward").provenance == bending.provenance


def test_rewards_of_earlier_versions_are_read(tmp_path: Path) -> None:
    """Which wrote settings of every model, whether it was used or not."""
    pairs = answered(40, seed=1)
    small = MlpCfg(num_updates=5, hidden_size=8)
    cfg = replace(QUICK, kind="mlp", models=(small,))
    model, _ = fit_reward(pairs, cfg, seed=0, measured=False)
    save_reward(model, tmp_path)
    facts = json.loads((tmp_path / "reward.json").read_text())
    (own,) = facts["cfg"].pop("models")
    facts["cfg"] |= {"gp": to_plain(GpCfg()), "mlp": own, "doubted_below": 0.1}
    facts["cfg"]["sparse"] = {"shared": True}
    (tmp_path / "reward.json").write_text(json.dumps(facts))
    loaded = load_reward(tmp_path)
    found = loaded.provenance.cfg
    assert (found.models, found.label_filter) == ((small,), LabelFilterCfg(below=0.1))
    assert loaded.lead(pairs.left, pairs.right).equal(
        model.lead(pairs.left, pairs.right)
    )


def test_a_kind_that_is_gone_is_named(tmp_path: Path) -> None:
    """Earlier versions picked curves one by one."""
    model, _ = fit_reward(answered(12, seed=1), QUICK, seed=0, measured=False)
    save_reward(model, tmp_path / "reward")
    facts = tmp_path / "reward" / "reward.json"
    facts.write_text(facts.read_text().replace('"kind": "linear"', '"kind": "sparse"'))
    told = "reward of kind 'sparse', this version reads linear, posterior.*fit .* again"
    with pytest.raises(RewardError, match=told):
        load_reward(tmp_path / "reward")


def test_a_model_has_settings_once() -> None:
    with pytest.raises(ValueError, match="settings of MlpCfg are given twice"):
        FitCfg(models=(MlpCfg(), MlpCfg(num_updates=3)))


def test_few_answers_leave_no_choice() -> None:
    model, report = fit_reward(answered(20, seed=1), FitCfg(kind="auto"), seed=0)
    assert model.provenance.cfg.kind == "linear"
    assert report.considered == ()


def test_a_draw_goes_to_the_stiffer_model() -> None:
    """Better by less than the standard error is no reason; by more it is."""
    base = torch.randn(100, generator=torch.Generator().manual_seed(0))
    noise = torch.randn(100, generator=torch.Generator().manual_seed(1))
    noise -= noise.mean()
    for gain, chosen in ((0.05, "linear"), (0.2, "gp")):
        assert choose_kind({"linear": base, "gp": base + noise + gain}) == chosen


def test_the_network_recovers_a_planted_taste_less_well() -> None:
    pairs = answered(100, seed=0)
    model, report = fit_reward(pairs, FitCfg(kind="mlp", folds=2), seed=0)
    assert accuracy(model, answered(400, seed=99)) > 0.8
    assert report.seconds > 0


def test_the_reward_has_mean_zero_and_deviation_one_on_the_fitted_clips() -> None:
    pairs = answered(40, seed=3)
    model, _ = fit_reward(pairs, FitCfg(), seed=0)
    rewards = torch.cat(
        [
            model(clips.features.transpose(0, 1), starts_of(clips)).flatten()
            for clips in (pairs.left, pairs.right)
        ]
    )
    assert rewards.mean().item() == pytest.approx(0.0, abs=1e-4)
    assert rewards.std().item() == pytest.approx(1.0, abs=1e-3)


def test_members_mean_and_spread_belong_together() -> None:
    """The reward is the members' mean and the spread their deviation, rescaled."""
    pairs = answered(40, seed=3)
    model = fitted(pairs)
    rows, starts = pairs.left.features.transpose(0, 1), starts_of(pairs.left)
    members = model.members(rows, starts)
    assert members.shape == (50, 20, 40)
    mean = (members.mean(dim=0) - model.reward_mean) / model.reward_std
    assert torch.allclose(model(rows, starts), mean)
    spread = members.std(dim=0) / model.reward_std
    assert torch.allclose(model.spread(rows, starts), spread)


def test_a_fall_costs_its_fixed_price() -> None:
    """The same clip with a fallen row appended loses by exactly `fall_logit`."""
    model = fitted(answered(40, seed=3), FitCfg(fall_logit=2.5))
    rows = gait(np.random.default_rng(0), 10)
    fallen = np.concatenate([rows, rows[-1:]])
    fallen[-1, column("fallen")] = 1.0
    lead = model.leads(pad_clips([rows]), pad_clips([fallen]))
    assert lead.flatten().tolist() == pytest.approx([2.5] * 50, abs=1e-5)


def test_swapping_all_sides_changes_nothing() -> None:
    """Left and right are only names: the mirrored answers give the same reward."""
    pairs = answered(40, seed=3)
    mirrored = replace(
        pairs, left=pairs.right, right=pairs.left, target=1 - pairs.target
    )
    model, twin = fitted(pairs), fitted(mirrored)
    leads = model.leads(pairs.left, pairs.right)
    assert torch.allclose(twin.leads(pairs.left, pairs.right), leads, atol=1e-3)


def test_answers_that_are_all_equal_give_no_reward() -> None:
    pairs = answered(12, seed=3)
    ties = replace(pairs, target=torch.full_like(pairs.target, 0.5))
    model, report = fit_reward(ties, FitCfg(), seed=0)
    rewards = model(pairs.left.features.transpose(0, 1), starts_of(pairs.left))
    assert rewards.abs().max().item() == 0.0
    assert (report.ties, report.train_accuracy) == (12, None)
    assert (report.held_out_pairs, report.held_out_accuracy) == (0, None)


def test_no_test_episode_is_in_the_training_pairs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A fold's model is fitted to the pairs with no clip in it, the last to all."""
    pairs = answered(60, seed=4)
    crossing = (EPISODES[0], EPISODES[1])
    pairs = replace(pairs, episodes=(crossing, *pairs.episodes[1:]))
    fitted: list[int] = []

    def counting(
        training: Prepared, cfg: FitCfg, generator: torch.Generator
    ) -> LinearScorer:
        fitted.append(len(training))
        return fit_linear(training, cfg, generator)

    linear = replace(KINDS["linear"], fit=counting)
    monkeypatch.setitem(KINDS, "linear", linear)
    _, report = fit_reward(pairs, FitCfg(), seed=0)
    folds = [{fold_of(sha256) for sha256 in pair} for pair in pairs.episodes]
    without = [sum(fold not in pair for pair in folds) for fold in range(5)]
    assert fold_of(crossing[0]) != fold_of(crossing[1])
    assert fitted == [60, *without]
    assert report.held_out_pairs == 59


def test_folds_depend_on_the_episode_alone() -> None:
    """Pinned, because old and new data sets must agree; all folds occur."""
    assert [fold_of(sha256) for sha256 in EPISODES[:6]] == [1, 0, 0, 1, 2, 1]
    assert {fold_of(sha256) for sha256 in EPISODES} == {0, 1, 2, 3, 4}


def test_wilson_interval_by_hand() -> None:
    """8 of 10: (0.8 + 0.192) / 1.384 +- 0.227; none of 4 starts at 0."""
    assert wilson_interval(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert wilson_interval(0, 4)[0] == 0.0


@pytest.mark.parametrize("kind", ["linear", "gp", "mlp", "raw"])
def test_save_and_load_bit_for_bit(
    kind: Literal["linear", "gp", "mlp", "raw"], tmp_path: Path
) -> None:
    """Two fits with one seed write the same bytes; loading gives the same reward."""
    pairs = answered(20, seed=5)
    cfg = FitCfg(kind=kind, models=(MlpCfg(num_updates=5),))
    for name in ("one", "two"):
        model, _ = fit_reward(pairs, cfg, seed=7)
        save_reward(model, tmp_path / name)
    for name in ("reward.safetensors", "reward.json"):
        first = (tmp_path / "one" / name).read_bytes()
        assert first == (tmp_path / "two" / name).read_bytes()
    rows, starts = pairs.left.features.transpose(0, 1), starts_of(pairs.left)
    loaded = load_reward(tmp_path / "one")
    assert torch.equal(loaded.members(rows, starts), model.members(rows, starts))
    assert torch.equal(loaded(rows, starts), model(rows, starts))
    assert loaded.provenance == model.provenance
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one", "two"]


def test_another_seed_gives_another_ensemble() -> None:
    pairs = answered(20, seed=5)
    weights = [
        fit_reward(pairs, FitCfg(), seed=seed)[0].state_dict()["scorer.weights"]
        for seed in (0, 1)
    ]
    assert not torch.equal(*weights)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("saved") / "reward"
    save_reward(fit_reward(answered(12, seed=5), FitCfg(), seed=0)[0], directory)
    return directory


def rewrite(saved: Path, directory: Path, **facts: object) -> Path:
    """A copy of the saved reward with other facts."""
    directory.mkdir()
    tensors = (saved / "reward.safetensors").read_bytes()
    (directory / "reward.safetensors").write_bytes(tensors)
    found = json.loads((saved / "reward.json").read_text())
    (directory / "reward.json").write_text(json.dumps(found | facts))
    return directory


def test_a_missing_file_is_refused(saved: Path, tmp_path: Path) -> None:
    with pytest.raises(RewardError, match=r"reward.json is missing, so .* no reward"):
        load_reward(tmp_path)
    directory = rewrite(saved, tmp_path / "copy")
    (directory / "reward.safetensors").unlink()
    with pytest.raises(RewardError, match=r"reward.safetensors is missing"):
        load_reward(directory)


def test_other_descriptors_are_refused_by_name(saved: Path, tmp_path: Path) -> None:
    names = [*DESCRIPTOR_NAMES[:-1], "wagging"]
    directory = rewrite(saved, tmp_path / "copy", descriptors=names)
    with pytest.raises(RewardError, match=r"lacks: lift_offs; it has besides: wagging"):
        load_reward(directory)


def test_other_features_are_refused_by_name(saved: Path, tmp_path: Path) -> None:
    names = [feature.name for feature in FEATURES] + ["tail"]
    directory = rewrite(saved, tmp_path / "copy", features=names)
    with pytest.raises(RewardError, match=r"lacks: none; it has besides: tail"):
        load_reward(directory)


def test_features_of_other_units_are_refused(saved: Path, tmp_path: Path) -> None:
    directory = rewrite(saved, tmp_path / "copy", features_sha256="0" * 64)
    with pytest.raises(RewardError, match="same names but other widths or units"):
        load_reward(directory)


@pytest.mark.parametrize("name", ["reward.json", "reward.safetensors"])
def test_a_damaged_file_is_refused(saved: Path, tmp_path: Path, name: str) -> None:
    directory = rewrite(saved, tmp_path / "copy")
    content = bytearray((directory / name).read_bytes())
    content[-40] ^= 1
    (directory / name).write_bytes(content[: -20 if name == "reward.json" else None])
    with pytest.raises(RewardError, match=r"holds a damaged reward model .*fit it"):
        load_reward(directory)


def reweighted(saved: Path, directory: Path, change: Callable[[Tensor], Tensor]) -> str:
    """A copy whose files agree, its largest tensor changed; the tensor's name."""
    tensors = load_tensors((saved / "reward.safetensors").read_bytes())
    name = max(tensors, key=lambda name: tensors[name].numel())
    tensors[name] = change(tensors[name].clone()).contiguous()
    content = save_tensors(tensors)
    rewrite(saved, directory, tensors_sha256=sha256_bytes(content))
    (directory / "reward.safetensors").write_bytes(content)
    return name


@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_a_weight_that_is_no_number_is_refused_by_name(
    saved: Path, tmp_path: Path, value: float
) -> None:
    """Such a reward would be paid to a policy for every step."""

    def spoil(weights: Tensor) -> Tensor:
        weights.flatten()[:2] = value
        return weights

    name = reweighted(saved, tmp_path / "copy", spoil)
    with pytest.raises(RewardError, match=rf"no finite numbers: {name} \(2 of "):
        load_reward(tmp_path / "copy")


def test_weights_of_another_shape_are_told_whole(saved: Path, tmp_path: Path) -> None:
    name = reweighted(saved, tmp_path / "copy", lambda weights: weights[..., :-1])
    with pytest.raises(RewardError, match=rf"{name} is .* in the file and .* network"):
        load_reward(tmp_path / "copy")


def chance_in_the_fit(pairs: AnsweredPairs, cfg: FitCfg) -> float:
    """1 less the correlation of what two fits pay that differ in their seed alone."""
    fits = [fit_reward(pairs, cfg, seed=seed, measured=False)[0] for seed in (0, 1)]
    paid = [model.leads(pairs.left, pairs.right).mean(dim=0) for model in fits]
    return 1.0 - torch.corrcoef(torch.stack(paid))[0, 1].item()


def test_what_is_paid_hardly_depends_on_the_resampling() -> None:
    pairs = answered(100, seed=3, flipped=0.2)
    few = replace(QUICK, linear=LinearCfg(num_members=5))
    assert chance_in_the_fit(pairs, QUICK) < 0.02
    assert chance_in_the_fit(pairs, few) > 2 * chance_in_the_fit(pairs, QUICK)


def test_many_answers_need_fewer_members(tmp_path: Path) -> None:
    assert members_for(LinearCfg(), 100).num_members == 50
    assert members_for(LinearCfg(), 100_000).num_members == 5
    assert members_for(LinearCfg(num_members=3), 100_000).num_members == 3
    pairs = answered(1000, seed=3)
    model, _ = fit_reward(pairs, QUICK, seed=0, measured=False)
    save_reward(model, tmp_path / "reward")
    loaded = load_reward(tmp_path / "reward")
    assert loaded.leads(pairs.left, pairs.right).shape == (20, 1000)


ROCKING = ("vertical_speed_sq", "roll_rate_sq", "pitch_rate_sq")


def by_one_who_likes(
    names: tuple[str, ...], pairs: AnsweredPairs, flipped: float
) -> AnsweredPairs:
    """The answers of somebody who wants as much of it as can be; a share is wrong."""
    columns = [DESCRIPTOR_NAMES.index(name) for name in names]
    left, right = (
        mean_over(describe(clips.features).mT, clips.scored[:, None])
        for clips in (pairs.left, pairs.right)
    )
    better = (left - right)[:, columns].sum(dim=1) > 0
    wrong = torch.from_numpy(np.random.default_rng(5).random(len(pairs)) < flipped)
    return replace(pairs, target=(better != wrong).float())


@pytest.mark.parametrize(
    ("habits", "linear"),
    [
        (ROCKING, LinearCfg()),
        (ROCKING, LinearCfg(told_most=True)),
        (TOLD, LinearCfg(told_most=True)),
        (FEET, LinearCfg(told_most=True)),
    ],
)
@pytest.mark.parametrize(("flipped", "least"), [(0.0, 0.9), (0.2, 0.75)])
def test_who_likes_what_nobody_does_is_believed(
    habits: tuple[str, ...], linear: LinearCfg, flipped: float, least: float
) -> None:
    """What is expected before any answer gives way to answers."""
    pairs = by_one_who_likes(habits, answered(100, seed=1), flipped)
    model, _ = fit_reward(pairs, replace(QUICK, linear=linear), seed=0)
    assert accuracy(model, by_one_who_likes(habits, answered(200, seed=2), 0)) > least


@pytest.mark.parametrize("told_most", [False, True])
def test_without_evidence_unsteadiness_is_disliked_and_nothing_else(
    told_most: bool,
) -> None:
    """Answers at random leave what was expected: the sign of a few weights, of habits
    that standing has none of. None of them says what to do."""
    pairs = answered(8, seed=4, flipped=0.5)
    stiff = LinearCfg(prior_precision=1e4, told_most=told_most)
    model, _ = fit_reward(
        pairs, replace(QUICK, adapt=False, linear=stiff), seed=0, measured=False
    )
    assert isinstance(model.scorer, LinearScorer)
    weights = model.scorer.weights.mean(dim=0)
    named = zip(DESCRIPTOR_NAMES, weights.tolist(), strict=True)
    assert {name for name, weight in named if weight < -0.1} == set(UNSTEADY)
    assert (weights < 0.1).all()


def test_what_was_never_seen_to_differ_is_not_judged() -> None:
    """A habit all clips share gets no weight from what is expected of it."""
    pairs = prepare(answered(8, seed=1), QUICK).described
    spread = torch.tensor(
        [1.0 if n == "slip" else MIN_SPREAD for n in DESCRIPTOR_NAMES]
    )
    expected = expected_weights(pairs, spread, LinearCfg())
    assert expected[DESCRIPTOR_NAMES.index("slip")] == -LinearCfg().unsteady_logit
    assert (expected != 0).sum() == 1


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match=r"error_share must lie in \[0, 1\), got 1"):
        FitCfg(error_share=1.0)
    with pytest.raises(
        ValueError, match="spread of an ensemble needs 2 members, got 1"
    ):
        LinearCfg(num_members=1)
    with pytest.raises(ValueError, match="prior_precision must be positive, got 0"):
        LinearCfg(prior_precision=0)
    with pytest.raises(ValueError, match="folds must be at least 2, got 1"):
        FitCfg(folds=1)


def without_torque(clips: ClipBatch, chosen: Tensor) -> ClipBatch:
    """The clips marked in `chosen` [B] as hardware logs them: without torque."""
    features = clips.features.clone()
    features[..., column("joint_torque")] = torch.where(
        chosen[:, None, None], torch.nan, features[..., column("joint_torque")]
    )
    return ClipBatch(features, clips.valid)


def test_hardware_clips_are_fitted_beside_simulated_ones() -> None:
    """A third of the left clips lack the torque: the taste is found all the same."""
    pairs = answered(240, seed=1)
    lacking = torch.arange(len(pairs)) % 3 == 0
    mixed = replace(pairs, left=without_torque(pairs.left, lacking))
    model, report = fit_reward(mixed, FitCfg(), seed=0)
    assert all(
        bool(torch.isfinite(value).all()) for value in model.state_dict().values()
    )
    assert report.held_out_accuracy is not None
    assert report.held_out_accuracy > 0.75
    assert isinstance(model.scorer, LinearScorer)
    weights = dict(
        zip(DESCRIPTOR_NAMES, model.scorer.weights.mean(dim=0).tolist(), strict=True)
    )
    assert weights["torque_sq"] < 0
    assert weights["tilt_sq"] < 0
    rewards, spread = model.clip_rewards(mixed.left)
    assert torch.isfinite(rewards).all()
    assert torch.isfinite(spread).all()
    known, _ = model.clip_rewards(pairs.left)
    assert torch.equal(known[~lacking], rewards[~lacking])


def test_what_nobody_measured_gets_no_weight() -> None:
    """Hardware alone: the torque is missing everywhere, and judges nobody later."""
    pairs = answered(60, seed=2)
    everywhere = torch.ones(len(pairs), dtype=torch.bool)
    mixed = replace(
        pairs,
        left=without_torque(pairs.left, everywhere),
        right=without_torque(pairs.right, everywhere),
    )
    model, _ = fit_reward(mixed, FitCfg(), seed=0)
    louder = pairs.left.features.clone()
    louder[..., column("joint_torque")] *= 10
    rewards = [
        model.clip_rewards(ClipBatch(features, pairs.left.valid))[0]
        for features in (pairs.left.features, louder)
    ]
    assert torch.equal(*rewards)


def test_a_missing_feature_in_training_is_no_mean_but_a_fault() -> None:
    """PPO must see the NaN: there it is a fault of the simulation."""
    model, _ = fit_reward(answered(40, seed=3), FitCfg(), seed=0)
    rows = torch.zeros(2, 3, FEATURE_DIM)
    rows[0, 1, column("joint_torque")] = torch.nan
    reward = model(rows, torch.zeros(2, 3, dtype=torch.bool))
    assert reward.isnan().nonzero().tolist() == [[0, 1]]


def test_what_nobody_measured_is_explained_as_average() -> None:
    """As a robot's log without torque: every other habit is still told."""
    pairs = answered(60, seed=0)
    for clips in (pairs.left, pairs.right):
        clips.features[::3, :, column("joint_torque")] = torch.nan
    model, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
    found = explain(model, pad_clips([pairs.left.features[0].numpy()]))
    for told in (found.reward, found.spread, found.shares):
        assert np.isfinite(told).all()
    assert np.isfinite(judged_spread(model, pairs))
