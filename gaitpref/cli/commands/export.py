"""`gaitpref export`: a policy for the robot's own computer."""

from __future__ import annotations

import onnx  # noqa: F401 - its absence is told before anything is written
import onnxscript  # noqa: F401

from gaitpref.cli.options import options
from gaitpref.console.terminal import say
from policy.training.checkpoint import load_policy
from policy.training.export_policy import export


def run(command: options.Export) -> int:
    """Write the files; gives the exit code."""
    for path in export(load_policy(command.policy), command.out):
        say(str(path))
    return 0
