"""A run that an earlier version made, in a directory of its own."""

from __future__ import annotations

import tarfile
from pathlib import Path

from gaitpref.cli.main import main
from rewardmodel import RewardError, load_reward

_STORED = Path(__file__).parents[1] / "stored" / "run_of_one_room.tar.xz"


def older_run(run: Path) -> Path:
    """Put the run into the directory `run`: one round of a few hundred steps, finished.

    A reward that lacks a habit of today is refused by name, and fitted again as that
    message says.
    """
    with tarfile.open(_STORED) as archive:
        archive.extractall(run, filter="data")
    for reward in sorted(run.glob("rounds/*/reward")):
        try:
            load_reward(reward)
        except RewardError:
            fitted = ["--out", str(reward), "--method", "style", "--round", "0"]
            assert main(["fit", "--dataset", str(run / "dataset"), *fitted]) == 0
    return run
