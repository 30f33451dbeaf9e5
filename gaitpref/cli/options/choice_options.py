"""Options of the command that chooses among gaits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from .bounds import Count, Seed


@dataclass(frozen=True, kw_only=True)
class Options:
    """Learn which gait to use when, on a course of obstacles; the gaits stay as they
    are.

    The result is a policy file like any other. Without --dataset and --wish it is paid
    for metres along the course, less energy and changes of gait. People judge choices
    so: `gaitpref record` and `pairs --clip-s 8` with the policy, `label`, then this
    command again with --dataset and another --out. The same command goes on with a
    training that was interrupted.
    """

    out: Path
    """Directory that gets policy.pt, reward.json and what a training goes on from."""
    policy: tyro.conf.UseAppendAction[tuple[str, ...]]
    """NAME=FILE of a gait, as walk=runs/walk/policy.pt; twice or more, of one robot and
    one rate."""
    steps: Count = 150_000
    """Environment steps, counted over all robots."""
    envs: Count = 64
    """Robots side by side."""
    termination: Literal["fixed", "learned"] = "fixed"
    """A gait ends after --length-s, or where it was learned that another is worth
    more."""
    length_s: float = 1.0
    """With --termination fixed: how long a gait runs."""
    interrupt: float | None = None
    """Leave a gait before its end where another is worth more by this, in units of the
    return, as metres; by default none is interrupted."""
    course: tuple[Literal["steps", "bar", "slope"], ...] = ("steps", "bar", "slope")
    """The obstacles in their order, with open ground between them."""
    step_m: float = 0.04
    """Height of a step, for the robot that ships."""
    bar_m: float = 0.29
    """From the ground to the lower edge of the bar, for the robot that ships."""
    slope_rad: float = 0.2
    """Steepness of the slope."""
    speed_m_s: float = 0.6
    """Forward speed that is asked for on the whole course."""
    dataset: Path | None = None
    """Data set with answers about clips of choices of this robot on this course, at
    this rate: the reward is fitted to them."""
    wish: str | None = None
    """A simulated rater instead of people: what it likes, as
    `changes_per_s=-1,crouch:bar=2`; a wrong name lists the columns. It answers about
    clips that are recorded into OUT/dataset."""
    answers: Count = 60
    """With --wish: how many answers it gives."""
    seed: Seed = 0
    """Where all chance comes from."""
