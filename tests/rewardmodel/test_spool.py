"""Very many clips lie in a file, and nothing else is different for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.walks import walking_clips, walking_dataset
from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from rewardmodel import load_pairs
from rewardmodel.answers import clip_batch, spool
from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.cfg import FitCfg
from rewardmodel.fitting.fit_reward import fit_reward
from rewardmodel.prepared import described


def answered(root: Path) -> Dataset:
    """Sixty answers of two raters, who like what lifts its feet."""
    dataset = walking_dataset(root, pairs=0)
    clips = walking_clips(dataset.entries(), 60)
    lift = {entry.sha256: entry.meta.seed for entry in dataset.entries()}
    rng = np.random.default_rng(0)
    with dataset.answers() as store:
        for name in ("ada", "bob"):
            store.add_rater(name, "human")
        for index in range(60):
            a, b = (clips[at] for at in rng.choice(len(clips), size=2, replace=False))
            pair = Pair.make(a, b, strategy="uniform", round=0)
            store.add_pairs([pair])
            store.add_answer(
                Answer(
                    answer_id=f"{index}",
                    pair_id=pair.pair_id,
                    rater_id=("ada", "bob")[index % 2],
                    choice="a" if lift[a.rollout] >= lift[b.rollout] else "b",
                    shown_left="a",
                    created_utc="2030-01-31T12:00:00Z",
                )
            )
    return dataset


def weights(pairs: AnsweredPairs) -> dict[str, torch.Tensor]:
    model, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
    return model.state_dict()


def test_clips_in_a_file_give_the_same_reward(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit, with several raters, whose reliability is found from a part of
    the clips."""
    dataset = answered(tmp_path / "set")
    expected = load_pairs([dataset])
    assert expected.left.spool is None
    monkeypatch.setattr(spool, "LARGE_BYTES", 1000)
    monkeypatch.setattr(spool, "_RELEASED_BYTES", 50_000)
    found = load_pairs([dataset])
    assert found.left.spool is not None
    for side in ("left", "right"):
        ours, theirs = getattr(found, side), getattr(expected, side)
        assert ours.features.equal(theirs.features)
        assert ours.part([3, 1]).features.equal(theirs.part([3, 1]).features)
    again = weights(found)
    for name, value in weights(expected).items():
        assert value.equal(again[name]), name


def test_some_pairs_at_a_time_give_the_same_reward(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for the last bits of its scale: sums are taken in another order."""
    pairs = load_pairs([answered(tmp_path / "set")])
    expected = weights(pairs)
    for module in (clip_batch, described):
        monkeypatch.setattr(module, "PART", 7)
    found = weights(pairs)
    for name, value in found.items():
        assert value.isclose(expected[name], rtol=1e-4, atol=1e-5).all(), name


def test_without_room_on_the_disk_memory_does() -> None:
    """As where files may not grow that large: told by the system, not by a crash."""
    program = """
import resource
from rewardmodel.answers import spool
spool.LARGE_BYTES = 1000
assert spool.zeros((10, 60, 90))[1] is not None
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
array, file = spool.zeros((10, 60, 90))
array[:] = 1
assert file is None and array.sum() == 54_000
"""
    subprocess.run([sys.executable, "-c", program], check=True)
