"""Something to judge for who has nothing yet: clips of the walk that ships."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.answers.address import Address
from data.datasets.dataset import Dataset
from gaitpref.cli.shared.by_hand import METHODS
from gaitpref.console.progress import console, counting_bar
from gaitpref.training.by_method import recorded_by
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from rewardmodel.asking.clip_questions import ClipCfg, ask
from rewardmodel.asking.visible import Visible

FIRST = Path("runs/first")
"""Where they are, of this directory."""
_EPISODES, _PAIRS = 32, 40


def first_clips(answers: Address | None, root: Path = FIRST) -> Dataset:
    """The data set at `root` of the walk that ships, in many postures, with questions.

    What is there already is used again.

    Args:
        answers: Where questions and answers are, if not in a file of the directory.
        root: The directory.

    Raises:
        GaitprefError: the directory holds something else, or cannot be written.
    """
    dataset = Dataset.create(root, answers=answers)
    if not dataset.entries():
        cfg = recorded_by(METHODS["style"].clips, RecordCfg(episodes=_EPISODES))
        with counting_bar("recording", _EPISODES) as bar:

            def counted():
                for episode in record(WALK, cfg, seed=0):
                    bar.advance(bar.task_ids[0])
                    yield episode

            dataset.add_episodes(counted())
    with dataset.answers() as store:
        if not store.pairs():
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
                told_apart=Visible(dataset),
                rng=np.random.default_rng(0),
            )
            store.add_pairs(chosen)
    console.print(f"{root} holds clips of the walk that ships, and questions")
    return dataset
