"""`gaitpref export`: a policy for the robot's own computer."""

from __future__ import annotations

import onnx  # noqa: F401 - its absence is told before anything is written
import onnxscript  # noqa: F401

from policy.training.checkpoint import load_policy
from policy.training.export_policy import export

from . import options
from .terminal import say


def run(command: options.Export) -> int:
    """Write the files; gives the exit code."""
    for path in export(load_policy(command.policy), command.out):
        say(str(path))
    return 0
