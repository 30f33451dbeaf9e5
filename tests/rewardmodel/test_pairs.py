"""Answered pairs out of real data sets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data.answers.answer_records import Answer, Choice, Pair
from data.datasets.dataset import Dataset, EpisodeEntry
from data.episodes.clips import Clip
from data.episodes.episode import Episode, EpisodeMeta
from data.features import FEATURE_DIM, column
from rewardmodel import RewardError, load_pairs
from rewardmodel.answers.clip_batch import PAST_STEPS


def episode(seed: int, steps: int, *, falls: bool = False) -> Episode:
    rows = np.full((steps, FEATURE_DIM), seed, dtype=np.float32)
    rows[:, column("base_height")] = np.arange(steps)[:, None]
    rows[:, column("fallen")] = 0.0
    rows[-1, column("fallen")] = falls
    meta = EpisodeMeta(
        task="flat",
        seed=seed,
        env_index=0,
        command=(0.5, 0.0, 0.25),
        policy_sha256="p",
        policy_step=0,
        stochastic=False,
        control_dt_s=0.02,
        physics_dt_s=0.005,
        robot="primitive",
        model_sha256="m",
    )
    return Episode(
        qpos=np.zeros((steps + 1, 19)),
        qvel=np.zeros((steps + 1, 18)),
        obs=np.zeros((steps + 1, 48), np.float32),
        action=np.zeros((steps, 12), np.float32),
        ctrl=np.zeros((steps, 12), np.float32),
        features=rows,
        reward=np.zeros(steps, np.float32),
        end_reason="terminated" if falls else "truncated",
        meta=meta,
        mjcf="<mujoco/>",
    )


def dataset(root: Path, *episodes: Episode) -> tuple[Dataset, list[EpisodeEntry]]:
    opened = Dataset.create(root)
    return opened, opened.add_episodes(episodes)


def answer(dataset: Dataset, pair: Pair, choice: Choice, **also: float) -> Answer:
    said = Answer(
        answer_id=f"{dataset.root.name} {pair.pair_id[:8]} {choice}",
        pair_id=pair.pair_id,
        rater_id="ada",
        choice=choice,
        created_utc="2030-01-31T12:00:00Z",
        shown_left="a",
        p_a=also.get("p_a"),
    )
    with dataset.answers() as store:
        store.add_rater("ada", "scripted")
        store.add_pairs([pair])
        store.add_answer(said)
    return said


def pair(a: Clip, b: Clip, round: int = 0) -> Pair:
    return Pair.make(a, b, strategy="uniform", round=round)


def test_answers_become_padded_tensors(tmp_path: Path) -> None:
    """Answers without a preference are left out and counted."""
    data, (long, fell) = dataset(tmp_path, episode(1, 8), episode(2, 3, falls=True))
    whole, end = Clip(long.sha256, 2, 5), Clip(fell.sha256, 0, 3)
    answer(data, pair(whole, end, round=3), "a", p_a=0.75)
    answer(data, pair(end, whole), "equal")
    answer(data, pair(Clip(long.sha256, 0, 4), end), "skip")
    answer(data, pair(Clip(long.sha256, 1, 4), end), "bad")

    pairs = load_pairs([data], at_least=1)
    order = [0, 1] if pairs.rounds[0] == 3 else [1, 0]
    assert pairs.target[order].tolist() == [0.75, 0.5]
    assert pairs.fell[order].tolist() == [[False, True], [True, False]]
    assert pairs.left.valid[order].sum(dim=1).tolist() == [5, 3]
    assert pairs.right.valid[order].sum(dim=1).tolist() == [3, 5]
    heights = pairs.left.features[order[0], :, column("base_height")]
    assert heights.flatten().tolist() == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert pairs.episodes[order[0]] == (long.sha256, fell.sha256)
    assert pairs.commands.tolist() == [[0.5, 0.0, 0.25]] * 2
    assert pairs.raters == ("ada", "ada")
    assert pairs.num_without_target == 2


def test_what_came_before_a_clip_goes_with_it(tmp_path: Path) -> None:
    """A foot that lifts off at step 3, and one at step 60."""
    rows = episode(1, 80).features.copy()
    rows[:, column("foot_contact")] = 1.0
    rows[3:, column("foot_contact").start] = 0.0
    rows[60:, column("foot_contact").start + 1] = 0.0
    walk = replace(episode(1, 80), features=rows)
    data, (one, two) = dataset(tmp_path, walk, episode(2, 80))
    answer(data, pair(Clip(one.sha256, 5, 10), Clip(two.sha256, 0, 8)), "a")
    answer(data, pair(Clip(one.sha256, 60, 10), Clip(two.sha256, 5, 10)), "a")
    pairs = load_pairs([data], at_least=2)
    order = pairs.right.valid.sum(dim=1).argsort()  # the clip of 8 steps first
    assert pairs.left.lift_offs_before is not None
    early, late = pairs.left.lift_offs_before[order]
    # The first step of the episode is the sixth from the end: before it nobody knows.
    assert early[:-6].isnan().all()
    assert early[-6:].tolist() == [0, 0, 0, 1, 0, 0]
    assert late.tolist() == [0.0] * (PAST_STEPS - 1) + [1.0]


def test_a_pair_asked_again_counts_once_and_a_known_answer_never(
    tmp_path: Path,
) -> None:
    """One row with the mean of both answers; the known one only measures the rater."""
    data, (one, two) = dataset(tmp_path, episode(1, 4), episode(2, 4))
    a, b = Clip(one.sha256, 0, 4), Clip(two.sha256, 0, 4)
    first = answer(data, pair(a, b), "a", p_a=0.75)
    again = replace(first, answer_id="again", choice="b", p_a=0.0, role="repeat")
    with data.answers() as store:
        store.add_answer(again)
    gold = Pair.make(b, a, strategy="gold", round=0, info={"gold": "a"})
    answer(data, gold, "a")
    pairs = load_pairs([data], at_least=1)
    assert pairs.target.tolist() == [0.375]
    assert pairs.num_without_target == 0


def test_several_data_sets_are_one_whatever_their_order(tmp_path: Path) -> None:
    """A clip may lie in another data set than its answer."""
    first, (one,) = dataset(tmp_path / "first", episode(1, 4))
    second, (two,) = dataset(tmp_path / "second", episode(2, 4))
    a, b = Clip(one.sha256, 0, 4), Clip(two.sha256, 0, 4)
    answer(first, pair(a, b), "a")
    answer(second, pair(b, a), "a")
    pairs = load_pairs([first, second], at_least=0)
    swapped = load_pairs([second, first], at_least=0)
    assert pairs.episodes == swapped.episodes
    assert pairs.answers_sha256 == swapped.answers_sha256
    twice = load_pairs([first, second, first], at_least=0)
    assert twice.answers_sha256 == pairs.answers_sha256
    answer(first, pair(a, Clip(two.sha256, 0, 3)), "b")
    more = load_pairs([first, second], at_least=0)
    assert (len(more), more.answers_sha256 == pairs.answers_sha256) == (3, False)


def test_too_few_answers_are_refused(tmp_path: Path) -> None:
    data, (one, two) = dataset(tmp_path, episode(1, 4), episode(2, 4))
    answer(data, pair(Clip(one.sha256, 0, 4), Clip(two.sha256, 0, 4)), "b")
    answer(data, pair(Clip(one.sha256, 0, 3), Clip(two.sha256, 0, 4)), "skip")
    with pytest.raises(
        RewardError,
        match=r"1 of 2 answers .* a fit needs at least 8; collect 7 more .*"
        r"`gaitpref answer --dataset .* --criterion C`",
    ):
        load_pairs([data])
