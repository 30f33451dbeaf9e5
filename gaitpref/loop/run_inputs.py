"""What the names in a run's configuration stand for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.files.files import sha256_file
from gaitpref.programs.function_rater import Look, function_of
from gaitpref.raters.criteria import Criterion, load_criterion
from gaitpref.raters.criterion_scores import criterion_context
from policy.offpolicy.as_policy import require_networks
from policy.robots.robot import Robot
from policy.training.checkpoint import read_plain
from policy.training.identity import content_of
from policy.training.setup import setting_of

from .loop_cfg import LoopCfg


@dataclass(frozen=True, eq=False)
class RunInputs:
    """The things from outside that decide how a run goes."""

    robot: Robot
    criterion: Criterion
    base_sha256: str | None
    """Hash of the policy file it begins with; None where it begins with none."""

    look: Look | None = None
    """The function that answers; None where none does."""

    @property
    def contents(self) -> dict[str, Any]:
        """Plain values that are the same as long as what is behind the names is."""
        told = {
            "base": self.base_sha256,
            "robot": self.robot.model_sha256,
            "criterion": content_of(self.criterion),
        }
        return told if self.look is None else told | {"rater": content_of(self.look)}


def inputs_of(cfg: LoopCfg) -> RunInputs:
    """What the names in `cfg` stand for now.

    Raises:
        GaitprefError: one of them cannot be used.
    """
    base = cfg.base_file
    if base is not None and cfg.method.learner is not None:
        require_networks(base, read_plain(base))
    robot = setting_of(base, None if cfg.robot is None else Path(cfg.robot)).robot
    criterion = load_criterion(cfg.criterion, criterion_context(robot, cfg.env))
    sha256 = None if base is None else sha256_file(base)
    program = cfg.program
    look = None
    if program is not None and program.url is None:
        look = function_of(program.name)
    return RunInputs(robot, criterion, sha256, look)
