"""`gaitpref export`: a policy for the robot's own computer."""

from __future__ import annotations

import onnx  # noqa: F401 - its absence is told before anything is written
import onnxscript  # noqa: F401

from gaitpref.cli.options import options
from gaitpref.console.progress import console
from gaitpref.console.terminal import say
from policy.exported.export_policy import export
from policy.imported.given_back import export_like
from policy.robots.motor_class import unusual_motors
from policy.training.checkpoint import PolicyError, load_policy


def run(command: options.Export) -> int:
    """Write the files; gives the exit code."""
    policy = load_policy(command.policy)
    if policy.info.env.team is not None:
        raise PolicyError(
            f"{command.policy} walks in a team of two, and what it sees of the other "
            "no sensor of a robot tells: export a policy that walks alone"
        )
    if command.like is not None:
        say(str(export_like(policy, command.like, command.out)))
        return 0
    for path in export(policy, command.out):
        say(str(path))
    for warning in unusual_motors(policy.robot()):
        say(f"warning: {warning}")
    console.next("policy.json says what the numbers mean; docs/how-to/deploy.md, how")
    return 0
