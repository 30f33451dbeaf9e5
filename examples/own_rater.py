"""The steps of the loop one by one, with answers of a program of your own.

    python examples/own_rater.py --policy POLICY --out runs/own-rater

Records a policy, asks about pairs of clips, has a function answer them, fits a reward
and trains the policy on it. This is one round: `gaitpref loop` does several, keeps
answers to say whether it worked, limits what following commands may lose, and writes a
report. A rater that can be written as a score of single steps gets all that as
`--criterion module:function` (`examples/own_criterion.py`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tyro

from data import Choice, column
from gaitpref import answer, ask, fit, open_dataset, record, train_on
from rewardmodel import save_reward


def prefers_low(a: np.ndarray, b: np.ndarray) -> Choice:
    """Likes the clip with the lower trunk; 2 mm are no difference."""
    height_m = [clip[:, column("base_height")].mean() for clip in (a, b)]
    if abs(height_m[0] - height_m[1]) < 0.002:
        return "equal"
    return "a" if height_m[0] < height_m[1] else "b"


def main(
    policy: Path,
    out: Path,
    episodes: int = 96,
    questions: int = 40,
    steps: int = 600_000,
) -> None:
    """Record, ask, answer, fit, train.

    Args:
        policy: A walking policy, as `gaitpref train` makes one.
        out: Directory for all that is made.
        episodes: Recorded of the policy.
        questions: Pairs that are asked about.
        steps: Environment steps of the training.
    """
    dataset = open_dataset(out / "dataset", create=True)
    record(policy, dataset, episodes=episodes)
    ask(dataset, questions)
    print(f"{answer(dataset, prefers_low, rater_id='low')} pairs were answered")
    reward, report = fit([dataset])
    print(f"foreseen of {report.held_out_pairs}: {report.held_out_accuracy}")
    save_reward(reward, out / "reward")
    trained = train_on(
        reward, out / "policy", steps=steps, base=policy, keep_task=True, weight=3.0
    )
    print(f"the policy is {trained.policy}")


if __name__ == "__main__":
    tyro.cli(main)
