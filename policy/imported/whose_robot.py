"""Which robot a policy is tried on, where nobody gives its model."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from policy.law.law import LawError

from .bring import Understood

SHIPPED = "go1"
"""What the robot that ships is called, in commands and by others."""
_MODEL = "robot.xml"
"""The robot's model beside a policy that was exported here."""


@dataclass(frozen=True, kw_only=True)
class Taken:
    """A robot, and why it is this one."""

    xml: Path | None
    """Its model; None is the one that ships."""
    because: str
    """In words."""


def given(robot: Path | None) -> Path | None:
    """The model that was asked for; None where it is the one that ships, or open."""
    if robot is None or (robot == Path(SHIPPED) and not robot.exists()):
        return None
    return robot


def robot_of(known: Understood, robot: Path | None) -> Taken:
    """The robot to try a policy on: what was asked for, else what the policy says.

    Args:
        known: The policy.
        robot: What was asked for: a model, or the name of the robot that ships.

    Raises:
        LawError: nobody says which it is, or it is one that does not ship.
    """
    draft = known.draft
    says = f"{draft.source} names the robot {draft.robot}" if draft.robot else ""
    if robot is not None:
        xml = given(robot)
        asked = f"{xml or f'the {SHIPPED} that ships'}, as asked"
        return Taken(xml=xml, because=f"{asked}; {says}" if says else asked)
    beside = known.file.with_name(_MODEL)
    if draft.carried and beside.is_file():
        return Taken(xml=beside, because=f"{beside}, which lies beside the policy")
    ask = (
        "give its model with --robot SCENE.xml, or --robot "
        f"{SHIPPED} for the Go1 that ships"
    )
    if draft.robot is None:
        raise LawError(
            f"nothing says which robot {known.file} is of ({draft.source} names none): "
            f"{ask}"
        )
    if not re.search(rf"(?<![a-z0-9]){SHIPPED}(?![0-9])", draft.robot.lower()):
        raise LawError(f"{says}, and the robot that ships is a Go1: {ask}")
    return Taken(xml=None, because=f"the {SHIPPED} that ships: {says}")
