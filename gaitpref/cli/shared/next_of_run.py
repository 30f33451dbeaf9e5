"""What comes after a look at a run or a training."""

from __future__ import annotations

from pathlib import Path

from gaitpref.loop.run_report import PAGE_NAME
from policy.training.training_dir import POLICY_NAME


def next_of_run(run: Path) -> str:
    """In one sentence, by what is there."""
    if (run / PAGE_NAME).exists():
        return f"`gaitpref report --run {run} --open` shows what came of it"
    if (policy := run / POLICY_NAME).exists():
        return f"`gaitpref play --policy {policy} --open` lets you drive it"
    return f"`gaitpref watch {run} --open` shows how far it is"
