"""Something to judge for who has nothing yet: clips of the walk that ships."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.answers.address import Address
from data.datasets.dataset import Dataset
from gaitpref.cli.shared.by_hand import METHODS
from gaitpref.console.progress import console, counted, each_counted
from gaitpref.training.by_method import recorded_by
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from rewardmodel.asking.clip_questions import ClipCfg, ask
from rewardmodel.asking.visible import Visible

FIRST = Path("runs/first")
"""Where they are, of this directory."""
_EPISODES, _PAIRS = 32, 40


def first_clips(answers: Address | None) -> Dataset:
    """The data set at `FIRST` of the walk that ships, in many postures, with questions.

    What is there already is used again.

    Args:
        answers: Where questions and answers are, if not in a file of the directory.

    Raises:
        GaitprefError: the directory holds something else, or cannot be written.
    """
    dataset = Dataset.create(FIRST, answers=answers)
    if not dataset.entries():
        cfg = recorded_by(METHODS["style"].clips, RecordCfg(episodes=_EPISODES))
        recorded = record(WALK, cfg, seed=0)
        with each_counted("recording", recorded, _EPISODES) as episodes:
            dataset.add_episodes(episodes)
    with dataset.answers() as store:
        if not store.pairs():
            with counted("choosing what to ask, clips") as tell:
                chosen = ask(
                    dataset,
                    dataset.entries(),
                    ClipCfg(),
                    _PAIRS,
                    known=(),
                    model=None,
                    round_number=0,
                    uniform_share=0.0,
                    strategy="uniform",
                    told_apart=Visible(dataset, tell=tell),
                    rng=np.random.default_rng(0),
                )
            store.add_pairs(chosen)
    console.print(f"{FIRST} holds clips of the walk that ships, and questions")
    return dataset
