"""The facts of a run, and its method: everything that decides how it goes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from data.errors import GaitprefError
from data.files.plain import NONE_AS_BEFORE
from gaitpref.method.method import Method
from gaitpref.programs.program_cfg import ProgramCfg
from gaitpref.raters.rater_cfg import RaterCfg
from policy.env.env_cfg import EnvCfg
from policy.env.feature_row import OBS_DIM
from policy.robots.shipped import WALK
from policy.rollouts.record_cfg import RecordCfg
from policy.sim.making import SimCfg
from policy.training.ppo import PpoCfg
from rewardmodel.answers.answered_pairs import MIN_ANSWERS
from rewardmodel.asking.clip_questions import ClipCfg

RATERS = ("simulated", "human")
"""Who can answer but a program."""
NEW_BASES = ("task", "none")
"""What a loop can begin with instead of a policy file."""


def file_of_base(base: str) -> Path | None:
    """The policy file that `base` names; None where a policy is trained first."""
    if base in NEW_BASES:
        return None
    return WALK if base == "walk" else Path(base)


class RunError(GaitprefError):
    """A run directory cannot be used."""


@dataclass(frozen=True, kw_only=True)
class StepsCfg:
    """Environment steps of the trainings of a run."""

    base: int
    """Steps of the policy the first questions are asked about."""
    round: int
    """Steps of a retraining."""
    last: int
    """Steps of the last retraining."""
    sim: SimCfg | None = field(default=None, metadata=NONE_AS_BEFORE)
    """Where policies are trained, None is the CPU; they are recorded and evaluated on
    the CPU."""


@dataclass(frozen=True, kw_only=True)
class LoopCfg:
    """Everything that decides how a run goes."""

    method: Method
    """What is decided on the way, and how."""
    rounds: int
    """Times questions are asked and the policy is retrained."""
    labels: int
    """Answers in all."""
    rater: Literal["simulated", "human"] | ProgramCfg
    """Who answers."""
    simulated: RaterCfg = field(default_factory=RaterCfg)
    """How the simulated rater errs; as it is, never."""
    criterion: str
    """What the simulated rater looks for, and what the report measures."""
    base: str
    """`walk`, `task`, `none` or a policy file."""
    robot: str | None
    """MJCF file; None is the Go1 that ships."""
    seed: int
    """Where all chance comes from."""
    steps: StepsCfg
    """How long is trained, and where."""
    clips: ClipCfg = field(default_factory=ClipCfg)
    """How episodes are cut into clips."""
    stop_asking: bool = False
    """Whether a round asks no further batch where more answers will not help now."""
    record: RecordCfg = field(default_factory=RecordCfg)
    """How many episodes are recorded every round, and how long; of what, the method
    says."""
    evaluation_episodes: int = 64
    """Episodes of each round's evaluation."""
    env: EnvCfg = field(default_factory=EnvCfg)
    """The environment."""
    ppo: PpoCfg = field(default_factory=PpoCfg)
    """The algorithm."""

    def __post_init__(self) -> None:
        if self.rounds < 1:
            raise RunError(f"--rounds must be at least 1, got {self.rounds}")
        each = self.method.budget.least
        least = MIN_ANSWERS + each * (self.rounds - 1)
        if self.labels < least:
            raise RunError(
                f"--labels {self.labels} is too few for {self.rounds} rounds: the "
                f"first needs {MIN_ANSWERS} answers and each other {each}, so "
                f"give at least {least}, or fewer --rounds"
            )
        if (learner := self.method.learner) is not None:
            learner.rows(self.ppo.num_envs, OBS_DIM)
            if self.steps.sim is not None and self.steps.sim.device != "cpu":
                raise RunError(
                    "off-policy learning is on the processor: leave --device out, or "
                    "--algorithm fastsac"
                )

    @property
    def base_file(self) -> Path | None:
        """The policy file it begins with; None where it trains its own."""
        return file_of_base(self.base)

    @property
    def keeps_task(self) -> bool:
        """Whether the hand-written walking reward stays part of the total."""
        return self.base != "none"

    @property
    def program(self) -> ProgramCfg | None:
        """The program that answers; None where none does."""
        return self.rater if isinstance(self.rater, ProgramCfg) else None

    @property
    def rater_words(self) -> str:
        """Who answers, in words."""
        if self.program is None:
            return f"{self.rater} rater"
        unchecked = ", which nobody compared with people" * self.program.unchecked
        return f"rater {self.program.rater_id}{unchecked}"

    @property
    def unchecked(self) -> bool:
        """Whether answers of programs teach: of the one that was let in, and of no
        other."""
        return self.program is not None

    @property
    def wish(self) -> str | None:
        """The criterion that is looked for; None where people know what they want."""
        return self.criterion if self.rater == "simulated" else None
