"""A reward for a data set that somebody else recorded and answered.

    python examples/fit_on_a_data_set.py --dataset DIR --out runs/reward

Needs neither simulator nor page: pip install -e '.[fit]' -c constraints.txt
"""

from __future__ import annotations

from pathlib import Path

import tyro

from data import Dataset
from gaitpref import fit, score_episode
from rewardmodel import save_reward


def main(dataset: Path, out: Path, seed: int = 0) -> None:
    """Fit, save, and say which episodes the reward likes best.

    Args:
        dataset: Directory of the data set.
        out: Directory for the reward.
        seed: Bootstrap draws and folds.
    """
    source = Dataset.open(dataset)
    reward, report = fit([source], seed=seed)
    save_reward(reward, out)
    print(f"foreseen of {report.held_out_pairs}: {report.held_out_accuracy}")
    worth = {}
    for entry in source.entries():
        paid = score_episode(reward, source.features(entry.sha256))
        worth[entry.sha256] = float(paid.mean())
    for sha256 in sorted(worth, key=worth.__getitem__, reverse=True)[:5]:
        print(f"{worth[sha256]:+.2f}  {sha256[:12]}")


if __name__ == "__main__":
    tyro.cli(main)
