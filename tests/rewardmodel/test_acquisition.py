"""Which pairs are asked: rules, preferences and determinism."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import torch

from data.answers.answer_records import Pair
from data.answers.strategy_names import NEEDS_MODEL, StrategyName
from data.datasets.dataset import EpisodeEntry
from data.episodes.clips import Clip
from data.episodes.episode import EpisodeMeta
from data.episodes.episode_records import COMMAND_CHANGE
from data.features import FEATURE_DIM, column
from rewardmodel import (
    Disagreement,
    FitCfg,
    FitReport,
    RewardError,
    RewardModel,
    Uniform,
    choose_pairs,
    fold_of,
)
from rewardmodel.acquisition import Strategy
from rewardmodel.answers.clip_batch import ClipRows
from rewardmodel.asking.strategies import STRATEGIES, make_strategy
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES
from rewardmodel.extensions.questions.batches import Dpp, KCenter, Medoids
from rewardmodel.extensions.questions.informative import Bald, Entropy, Improvement
from rewardmodel.linear.linear import LinearScorer
from rewardmodel.models.model import Provenance


def entry(
    index: int, *, speed: float = 0.5, policy: str = "p", fell: bool = False
) -> EpisodeEntry:
    meta = EpisodeMeta(
        task="flat",
        seed=index,
        env_index=0,
        command=(speed, 0.0, 0.0),
        policy_sha256=policy,
        policy_step=0,
        stochastic=True,
        control_dt_s=0.02,
        physics_dt_s=0.005,
        robot="primitive",
        model_sha256="m",
    )
    sha256 = hashlib.sha256(bytes([index])).hexdigest()
    end = "terminated" if fell else "truncated"
    return EpisodeEntry(sha256, f"rollouts/{sha256}.mcap", 1, 40, end, meta)


def clips_of(entries: Sequence[EpisodeEntry], each: int = 3) -> list[Clip]:
    return [Clip(e.sha256, 10 * k, 10) for e in entries for k in range(each)]


def choose(
    entries: Sequence[EpisodeEntry],
    count: int,
    *,
    clips: Sequence[Clip] | None = None,
    strategy: Strategy | None = None,
    known: Sequence[Pair] = (),
    seed: int = 0,
) -> list[Pair]:
    return choose_pairs(
        entries,
        clips_of(entries) if clips is None else clips,
        count,
        strategy=strategy or Uniform(),
        round=2,
        known_pairs=known,
        rng=np.random.default_rng(seed),
    )


MANY = [entry(k, speed=0.3 + 0.4 * (k % 2), policy=f"p{k % 3}") for k in range(60)]


def test_pairs_obey_one_command_within_one_fold() -> None:
    speeds = {e.sha256: e.meta.command for e in MANY}
    pairs = choose(MANY, 20)
    assert len(pairs) == 20
    for pair in pairs:
        a, b = pair.a.rollout, pair.b.rollout
        assert a != b
        assert speeds[a] == speeds[b]
        assert fold_of(a) == fold_of(b)
        assert (pair.strategy, pair.round) == ("uniform", 2)


def test_a_batch_holds_no_look_alikes() -> None:
    """No two episodes meet twice, and no clip comes twice while others are left."""
    pairs = choose(MANY, 40)
    meetings = Counter(frozenset((p.a.rollout, p.b.rollout)) for p in pairs)
    clips = Counter(clip for pair in pairs for clip in (pair.a, pair.b))
    assert max(meetings.values()) == 1
    assert max(clips.values()) == 1


def test_no_episode_comes_twice_while_others_are_left() -> None:
    """Clips of one episode are near-duplicates: a gait repeats itself."""
    pairs = choose(MANY, 12)
    episodes = Counter(clip.rollout for p in pairs for clip in (p.a, p.b))
    assert max(episodes.values()) == 1


class PrefersFalls:
    """Asks for pairs in which one robot falls, or avoids them."""

    def __init__(self, fallen: set[str], sign: float) -> None:
        self.fallen, self.sign = fallen, sign
        self.name = "falls"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        fell = np.array([c.rollout in self.fallen and c.stop == 40 for c in clips])
        return self.sign * (fell[candidates].sum(axis=1) == 1)


@pytest.mark.parametrize(("sign", "share"), [(1.0, 0.25), (-1.0, 0.05)])
def test_falls_neither_flood_a_batch_nor_are_they_avoided(
    sign: float, share: float
) -> None:
    """Whatever a strategy wants: at most a quarter, and at least a twentieth."""
    entries = [entry(k, fell=k % 2 == 0) for k in range(120)]
    clips = [Clip(e.sha256, start, 10) for e in entries for start in (0, 30)]
    fallen = {e.sha256 for e in entries[::2]}
    strategy = PrefersFalls(fallen, sign)
    pairs = choose(entries, 40, clips=clips, strategy=strategy)
    decided = sum(
        (p.a.rollout in fallen and p.a.stop == 40)
        != (p.b.rollout in fallen and p.b.stop == 40)
        for p in pairs
    )
    assert len(pairs) == 40
    assert decided == share * 40


def test_a_batch_is_filled_with_falls_where_nothing_else_is_left() -> None:
    """Four robots, of which one stands: three pairs decided by a fall."""
    four = [entry(k, fell=k > 0) for k in range(4)]
    clips = [Clip(e.sha256, 30, 10) for e in four]
    known = [
        Pair.make(clips[i], clips[j], strategy="s", round=0)
        for i, j in ((1, 2), (1, 3), (2, 3))
    ]
    assert len(choose(four, 3, clips=clips, known=known)) == 3


def test_clips_come_again_when_no_others_are_left() -> None:
    """Three episodes of one clip each can meet in three ways, and no more."""
    three = [entry(k) for k in range(3)]
    pairs = choose(three, 10, clips=clips_of(three, each=1))
    assert len({frozenset((p.a, p.b)) for p in pairs}) == len(pairs) == 3


def test_known_pairs_never_come_back_in_either_order() -> None:
    few = [entry(k) for k in range(6)]
    clips = clips_of(few, each=1)
    known: list[Pair] = []
    while batch := choose(few, 4, clips=clips, known=known, seed=len(known)):
        known += [
            Pair.make(p.b, p.a, strategy=p.strategy, round=p.round) for p in batch
        ]
    assert len({frozenset((p.a, p.b)) for p in known}) == len(known) == 15


def test_two_checkpoints_are_preferred_but_not_forced() -> None:
    """Of two checkpoints, half the pairs would mix them by chance."""
    policy = {e.sha256: e.meta.policy_sha256 for e in MANY}
    pairs = [pair for seed in range(5) for pair in choose(MANY, 20, seed=seed)]
    mixed = sum(policy[p.a.rollout] != policy[p.b.rollout] for p in pairs)
    assert 0.75 * len(pairs) < mixed < len(pairs)
    alone = [entry(k) for k in range(20)]
    assert len(choose(alone, 5)) == 5


def test_folds_are_crossed_only_to_fill_up() -> None:
    """Two episodes of one fold and one of another: the pair within the fold leads."""
    by_fold: dict[int, list[EpisodeEntry]] = {}
    for index in range(60):
        by_fold.setdefault(fold_of(entry(index).sha256), []).append(entry(index))
    three = [*by_fold[0][:2], by_fold[1][0]]
    (first, *others) = choose(three, 3)
    assert {first.a.rollout, first.b.rollout} == {e.sha256 for e in three[:2]}
    assert len(others) == 2


def test_left_and_right_are_a_coin_toss() -> None:
    pairs = [pair for seed in range(10) for pair in choose(MANY, 20, seed=seed)]
    left = sum(pair.a < pair.b for pair in pairs)
    assert 0.4 * len(pairs) < left < 0.6 * len(pairs)


def test_one_generator_state_gives_one_batch() -> None:
    assert choose(MANY, 20, seed=5) == choose(MANY, 20, seed=5)
    assert choose(MANY, 20, seed=5) != choose(MANY, 20, seed=6)


def test_nothing_to_compare_is_refused() -> None:
    lonely = [entry(k, speed=0.1 * k) for k in range(4)]
    with pytest.raises(
        RewardError,
        match=r"no two of 12 clips .* \(4 episodes, 4 commands\); record more",
    ):
        choose(lonely, 1)


def test_nothing_at_all_is_refused() -> None:
    with pytest.raises(RewardError, match=r"no two of 0 clips .* \(0 episodes, 0"):
        choose([], 1)


def quarrelling_model() -> RewardModel:
    """Two members who agree on everything but the best height of the base."""
    scorer = LinearScorer(2, len(DESCRIPTOR_NAMES))
    scorer.weights[:, DESCRIPTOR_NAMES.index("height")] = torch.tensor([1.0, -1.0])
    report = FitReport(
        answers=0,
        answers_without_target=0,
        ties=0,
        train_accuracy=None,
        train_log_likelihood=0.0,
        held_out_pairs=0,
        held_out_accuracy=None,
        held_out_interval=None,
        at_random_pairs=0,
        at_random_accuracy=None,
        held_out_log_likelihood=None,
        temperature=1.0,
        held_out_ece=None,
        held_out_brier=None,
        seconds=0.0,
    )
    provenance = Provenance(FitCfg(), report, "", frozenset())
    return RewardModel(Normaliser(len(DESCRIPTOR_NAMES)), scorer, provenance)


def test_disagreement_asks_where_the_members_differ() -> None:
    """Clips at heights 0, 1, 2, ...: the farthest apart are asked about first.

    A lead of 2 gives probabilities 0.8808 and 0.1192, whose deviation is 0.5386.
    """
    few = [e for e in (entry(k) for k in range(40)) if fold_of(e.sha256) == 0][:4]
    height = {e.sha256: float(k) for k, e in enumerate(few)}

    def clip_rows(clip: Clip) -> np.ndarray:
        rows = np.zeros((clip.steps, FEATURE_DIM), np.float32)
        rows[:, column("base_height")] = height[clip.rollout]
        return rows

    strategy = Disagreement(quarrelling_model(), clip_rows)
    pairs = choose(few, 2, clips=clips_of(few, each=1), strategy=strategy)
    leads = [abs(height[p.a.rollout] - height[p.b.rollout]) for p in pairs]
    assert leads == [3.0, 1.0]
    assert {p.strategy for p in pairs} == {"disagreement"}

    ends = [Clip(few[0].sha256, 0, 10), Clip(few[2].sha256, 0, 10)]
    worth = strategy(ends, np.array([[1, 0]]), np.random.default_rng(0))
    assert worth == pytest.approx([0.5386], abs=1e-4)


def model_of(*weights: dict[str, float]) -> RewardModel:
    """An ensemble of linear members with the weights given."""
    model = quarrelling_model()
    scorer = LinearScorer(len(weights), len(DESCRIPTOR_NAMES))
    for member, named in enumerate(weights):
        for name, weight in named.items():
            scorer.weights[member, DESCRIPTOR_NAMES.index(name)] = weight
    return RewardModel(model.normaliser, scorer, model.provenance)


def placed(*rows: Mapping[str, float | list[float]]) -> tuple[list[Clip], ClipRows]:
    """Clips with constant features, the others zero."""
    clips = [Clip(f"{index}", 0, 10) for index in range(len(rows))]

    def clip_rows(clip: Clip) -> np.ndarray:
        values = np.zeros((clip.steps, FEATURE_DIM), np.float32)
        for name, value in rows[int(clip.rollout)].items():
            values[:, column(name)] = value
        return values

    return clips, clip_rows


RNG = np.random.default_rng(0)
AGAINST_FIRST = np.array([[0, 1], [0, 2], [0, 3]])


def test_entropy_asks_about_the_most_open_answer() -> None:
    """Leads of 0, 1 and 4 on which all agree: the answer to the first is most open.

    Without errors and ties, a lead of 0 has an entropy of log 2.
    """
    clips, clip_rows = placed(*({"base_height": h} for h in (1.0, 1.0, 0.0, -3.0)))
    model = model_of({"height": 1.0}, {"height": 1.0})
    worth = Entropy(model, clip_rows)(clips, AGAINST_FIRST, RNG)
    assert worth[0] > worth[1] > worth[2] > 0
    plain = replace(model.provenance, cfg=FitCfg(error_share=0.0, tie_threshold=0.0))
    model = RewardModel(model.normaliser, model.scorer, plain)
    worth = Entropy(model, clip_rows)(clips, AGAINST_FIRST, RNG)
    assert worth[0] == pytest.approx(np.log(2), abs=1e-6)


def test_bald_asks_where_an_answer_tells_the_members_apart() -> None:
    """Equal clips are open and teach nothing; an agreed lead neither; a quarrel does.

    With members sure of opposite answers, the answer tells all there is: log 2.
    """
    clips, clip_rows = placed(
        {},
        {},
        {"base_lin_vel_b": [-1.0, 0.0, 0.0]},
        {"base_height": -9.0},
    )
    quarrel = {"height": 1.0, "forward_speed": 2.0}
    model = model_of(quarrel, quarrel | {"height": -1.0})
    worth = Bald(model, clip_rows)(clips, AGAINST_FIRST, RNG)
    assert worth[2] > 0.1
    assert worth[:2] == pytest.approx([0.0, 0.0], abs=1e-6)
    plain = replace(model.provenance, cfg=FitCfg(error_share=0.0, tie_threshold=0.0))
    model = RewardModel(model.normaliser, model.scorer, plain)
    worth = Bald(model, clip_rows)(clips, AGAINST_FIRST, RNG)
    assert worth[2] == pytest.approx(np.log(2), abs=0.05)


def test_improvement_asks_about_what_may_be_best() -> None:
    """Of two doubts, the one between good clips, though the other is greater.

    The members quarrel about height and agree that slow is bad. To one of them the
    higher of the fast clips is better by half, to the other the lower one is: on
    average the better is worth a quarter more than either.
    """
    fast, slow = [2.0, 0.0, 0.0], [-20.0, 0.0, 0.0]
    clips, clip_rows = placed(
        {"base_lin_vel_b": fast},
        {"base_lin_vel_b": fast, "base_height": 0.5},
        {"base_lin_vel_b": slow},
        {"base_lin_vel_b": slow, "base_height": 3.0},
    )
    agreed = {"forward_speed": 1.0}
    model = model_of(agreed | {"height": 1.0}, agreed | {"height": -1.0})
    pairs = np.array([[0, 1], [3, 2]])
    worth = Improvement(model, clip_rows)(clips, pairs, RNG)
    assert worth[0] == pytest.approx(0.25, abs=0.02)
    assert worth[1] < -2.0
    doubt = Disagreement(model, clip_rows)(clips, pairs, RNG)
    assert doubt[1] > doubt[0]


def test_improvement_looks_at_each_command_alone() -> None:
    """What a command allows says nothing about another: both doubts are worth as much,
    though one of the commands is hopeless."""
    clips, clip_rows = placed(
        {"command": [0.5, 0.0, 0.0], "base_lin_vel_b": [2.0, 0.0, 0.0]},
        {
            "command": [0.5, 0.0, 0.0],
            "base_lin_vel_b": [2.0, 0.0, 0.0],
            "base_height": 0.5,
        },
        {"command": [1.0, 0.0, 0.0], "base_lin_vel_b": [-20.0, 0.0, 0.0]},
        {
            "command": [1.0, 0.0, 0.0],
            "base_lin_vel_b": [-20.0, 0.0, 0.0],
            "base_height": 0.5,
        },
    )
    agreed = {"forward_speed": 1.0}
    model = model_of(agreed | {"height": 1.0}, agreed | {"height": -1.0})
    worth = Improvement(model, clip_rows)(clips, np.array([[0, 1], [3, 2]]), RNG)
    assert worth[0] == pytest.approx(worth[1], abs=1e-4)


SPEEDS = (0.0, 1.0, 1.02, 0.98, 0.0)
HEIGHTS = (0.0, 0.0, 0.0, 0.0, 0.5)
"""Three clips that differ from the first in the same way, and one that does in
another."""
ALIKE = np.array([[0, 1], [2, 0], [0, 3], [0, 4]])


def _various() -> tuple[list[Clip], ClipRows]:
    return placed(
        *(
            {"base_lin_vel_b": [speed, 0.0, 0.0], "base_height": height}
            for speed, height in zip(SPEEDS, HEIGHTS, strict=True)
        )
    )


@pytest.mark.parametrize("family", [KCenter, Dpp])
def test_a_various_batch_asks_each_doubt_once(
    family: Callable[[ClipRows], Strategy],
) -> None:
    """The second pair is the different one, though the look-alikes differ as much.

    Of the look-alikes one is turned round: sides do not make pairs different.
    """
    clips, clip_rows = _various()
    worth = family(clip_rows)(clips, ALIKE, RNG)
    first, second, *others = np.sort(worth)[::-1]
    assert worth[3] in (first, second)
    assert max(others) < 0.1 * second


def test_medoids_ask_first_what_stands_for_most() -> None:
    """The middle one of the three look-alikes, not the outlier."""
    clips, clip_rows = _various()
    assert Medoids(clip_rows)(clips, ALIKE, RNG).argmax() in (0, 1, 2)
    many = np.concatenate([ALIKE[:3], ALIKE[:3], ALIKE[3:]])
    worth = Medoids(clip_rows)(clips, many, RNG)
    order = np.argsort(-worth)
    assert order[0] != 6
    assert order[1] == 6


def test_a_various_batch_leaves_out_what_is_known() -> None:
    """An ensemble that knows what speed is worth wants to hear of heights."""
    clips, clip_rows = _various()
    model = model_of(
        {"height": 5.0, "forward_speed": 2.0}, {"height": -5.0, "forward_speed": 2.0}
    )
    names: tuple[StrategyName, ...] = ("kcenter", "dpp")
    for name in names:
        strategy = make_strategy(name, model, clip_rows)
        worth = strategy(clips, np.array([[0, 1], [2, 0], [0, 4], [4, 3]]), RNG)
        assert worth.argmax() in (2, 3)


def test_names_and_strategies_agree() -> None:
    """Names are where nothing heavy is imported, strategies where they are made."""
    assert tuple(STRATEGIES) == get_args(StrategyName)
    needing = [name for name, making in STRATEGIES.items() if making.blind is None]
    assert sorted(NEEDS_MODEL) == sorted(needing)


@pytest.mark.parametrize("name", NEEDS_MODEL)
def test_a_strategy_without_its_ensemble_is_refused(name: StrategyName) -> None:
    with pytest.raises(RewardError, match=f"--strategy {name} needs an ensemble"):
        make_strategy(name, None, lambda clip: np.zeros((1, FEATURE_DIM)))


@pytest.mark.parametrize("name", get_args(StrategyName))
def test_every_strategy_gives_a_number_for_every_candidate(name: StrategyName) -> None:
    """Also where all clips are the same, and there is nothing to tell apart."""
    clips, clip_rows = placed({}, {}, {}, {})
    strategy = make_strategy(name, quarrelling_model(), clip_rows)
    worth = strategy(clips, AGAINST_FIRST, np.random.default_rng(0))
    assert worth.shape == (3,)
    assert np.isfinite(worth).all()
    assert strategy.name == name


def test_clips_of_a_manoeuvre_meet_where_they_were_told_the_same() -> None:
    """Commands change every 10 steps, so only clips of equal start compare."""
    entries = [
        replace(e, meta=replace(e.meta, extra={COMMAND_CHANGE: "10"}))
        for e in (entry(index) for index in range(6))
    ]
    pairs = choose_pairs(
        entries,
        clips_of(entries),
        12,
        strategy=Uniform(),
        round=0,
        rng=np.random.default_rng(0),
    )
    assert len(pairs) == 12
    assert all(pair.a.start == pair.b.start for pair in pairs)
    assert len({pair.a.start for pair in pairs}) == 3


def test_falls_are_not_avoided_a_few_questions_at_a_time() -> None:
    """As a loop asks: two and eight, again and again, of which the strategy wants no
    fall. Every twentieth question of the round is about one all the same."""
    entries = [entry(k, fell=k % 2 == 0) for k in range(120)]
    clips = [Clip(e.sha256, start, 10) for e in entries for start in (0, 30)]
    fallen = {e.sha256 for e in entries[::2]}
    strategy = PrefersFalls(fallen, -1.0)
    asked: list[Pair] = []
    for count in (2, 8, 2, 8, 2, 8, 2, 8):
        asked += choose(entries, count, clips=clips, strategy=strategy, known=asked)
    falls = [
        (p.a.rollout in fallen and p.a.stop == 40)
        != (p.b.rollout in fallen and p.b.stop == 40)
        for p in asked
    ]
    assert sum(falls[:10]) == 0
    assert sum(falls[:20]) == 1
    assert sum(falls) == 2
