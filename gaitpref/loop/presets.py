"""The configuration of a loop: what is given, and the preset's word for the rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from gaitpref.method.meanwhile import Meanwhile
from gaitpref.method.method import FROM_SCRATCH, STYLE, Method
from gaitpref.programs.function_rater import Look, name_of
from gaitpref.programs.program_cfg import ProgramCfg, is_program
from gaitpref.raters.rater_cfg import RaterCfg
from policy.rollouts.record_cfg import LONGEST_S, RecordCfg
from policy.training.setup import setting_of
from rewardmodel.asking.clip_questions import ClipCfg

from .loop_cfg import LoopCfg, RunError, StepsCfg, file_of_base

_SCRATCH_EPISODES = 192
"""Recorded a round from scratch: robots that tumble show little each."""


def loop_cfg(
    *,
    criterion: str = "high_step",
    base: str | Path | None = None,
    robot: Path | None = None,
    quick: bool = False,
    rounds: int | None = None,
    labels: int | None = None,
    steps: int | None = None,
    rater: str | ProgramCfg | Look = "simulated",
    simulated: RaterCfg | None = None,
    clip_s: float = 1.2,
    change_s: float | None = None,
    stop_asking: bool = False,
    unchecked: bool = False,
    method: Method | None = None,
    seed: int = 0,
) -> LoopCfg:
    """A loop; what is not given is the preset's.

    Args:
        criterion: What the simulated rater looks for: a built-in name, or
            `module:function`.
        base: `walk`, which ships and is the default, `task`, `none` or a policy file,
            as of `gaitpref loop --base`.
        robot: MJCF of another robot than the one that ships.
        quick: Two rounds, about three minutes on two cores; from scratch four in about
            seven.
        rounds: Times questions are asked and the policy is retrained.
        labels: Answers in all.
        steps: Environment steps of each training.
        rater: Who answers: `simulated`, `human`, or a program, as a `ProgramCfg`, the
            name `package.module:function` of a function, or that function.
        unchecked: Let a program's answers teach though nobody compared it with people.
        simulated: How the simulated rater errs; by default never.
        clip_s: Length of a clip.
        change_s: Another command every so many seconds of what is recorded.
        stop_asking: End a round's questions where more will not help now.
        method: What is decided on the way, and how; by default `FROM_SCRATCH` without a
            base and `STYLE` with one, which ask people meanwhile.
        seed: Where all chance comes from.

    Raises:
        GaitprefError: a value is out of range, or a file cannot be used.
    """
    if change_s is not None and not 0.0 < change_s <= LONGEST_S:
        raise RunError(
            f"--change-s must lie in (0, {LONGEST_S:g}] seconds, got {change_s:g}"
        )
    if steps is not None and steps < 1:
        raise RunError(f"--steps must be at least 1, got {steps}")
    base = usual_base(robot) if base is None else str(base)
    scratch = base == "none"
    clips = ClipCfg.of(clip_s)
    usual = FROM_SCRATCH if scratch else STYLE
    if rater == "human":
        # Who is asked by a program has nothing else to do meanwhile.
        usual = replace(usual, meanwhile=Meanwhile())
    usual_rounds = 4 if scratch else 2 if quick else 4
    usual_labels = 100 if scratch else 30
    setting = setting_of(file_of_base(base), robot)
    return LoopCfg(
        method=method or usual,
        rounds=usual_rounds if rounds is None else rounds,
        labels=usual_labels if labels is None else labels,
        rater=_rater_of(rater, unchecked),
        simulated=simulated or RaterCfg(),
        criterion=criterion,
        base=base,
        robot=None if robot is None else str(robot),
        seed=seed,
        steps=_steps(scratch=scratch, quick=quick, given=steps),
        clips=clips,
        stop_asking=stop_asking,
        record=RecordCfg(
            episodes=_SCRATCH_EPISODES if scratch else RecordCfg.episodes,
            episode_s=max(RecordCfg.episode_s, 3 * clips.clip_s),
            change_s=change_s,
        ),
        env=setting.env,
        ppo=setting.ppo,
    )


def usual_base(robot: Path | None) -> str:
    """What a loop begins with that is told nothing else: the walk that ships, on the
    robot it is of."""
    return "walk" if robot is None else "task"


def _rater_of(
    rater: str | ProgramCfg | Look, unchecked: bool
) -> Literal["simulated", "human"] | ProgramCfg:
    """
    Raises:
        GaitprefError: it is nobody, or a function that no name imports again.
    """
    if isinstance(rater, ProgramCfg):
        return rater
    if isinstance(rater, str) and rater in ("simulated", "human"):
        return rater
    if callable(rater):
        return ProgramCfg(name=name_of(rater), unchecked=unchecked)
    if isinstance(rater, str) and is_program(rater):
        return ProgramCfg(name=rater, unchecked=unchecked)
    raise RunError(
        f"rater is 'simulated', 'human', a function that looks at a pair of clips, or "
        f"its name as package.module:function; got {rater!r}"
    )


def _steps(*, scratch: bool, quick: bool, given: int | None) -> StepsCfg:
    if given is not None:
        return StepsCfg(base=0 if scratch else given, round=given, last=given)
    if scratch:
        # A long one overdoes what a reward got wrong, and nothing is learned then.
        return StepsCfg(base=0, round=600_000, last=800_000 if quick else 1_500_000)
    if quick:
        return StepsCfg(base=800_000, round=600_000, last=600_000)
    return StepsCfg(base=1_500_000, round=700_000, last=700_000)
