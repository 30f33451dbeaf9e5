"""What commands that train refuse, and say at the end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from data.errors import GaitprefError
from gaitpref.cli.options import options
from gaitpref.console.terminal import EXIT_INTERRUPTED, complain
from policy.training.checkpoint import PolicyError
from policy.training.training_dir import POLICY_NAME, RESUME_NAME


def refuse_unasked(command: options.Train, names: Sequence[str], about: str) -> None:
    """Options `names` that were given, though `about` says they are of something else,
    are refused.

    Raises:
        GaitprefError: there is one.
    """
    own = options.Train(out=command.out, reward=command.reward)
    for name in names:
        if getattr(command, name) != getattr(own, name):
            option = name.replace("_", "-")
            raise GaitprefError(f"--{option} {about} too, or leave it out")


def refuse_trained(out: Path) -> None:
    """A directory in which a training began is refused.

    Raises:
        PolicyError: `out` is one.
    """
    if any((out / name).exists() for name in (POLICY_NAME, RESUME_NAME)):
        raise PolicyError(
            f"{out} holds a training run: --resume goes on with it, or give another "
            "--out"
        )


def told_stopped(steps: int) -> int:
    """Say that a training was interrupted after `steps`; gives the exit code."""
    complain(f"stopped after {steps:,} steps; the same command with --resume goes on")
    return EXIT_INTERRUPTED
