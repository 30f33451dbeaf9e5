"""Presets of the loop: from the command line to a configuration."""

from __future__ import annotations

from gaitpref.cli.options.options import Erring, Loop
from gaitpref.loop.loop_cfg import LoopCfg, RunError, StepsCfg
from gaitpref.method.method import FROM_SCRATCH, STYLE
from policy.rollouts.record import LONGEST_S, RecordCfg
from rewardmodel.asking.clip_questions import ClipCfg

from .rater_arguments import erring_rater

_SCRATCH_EPISODES = 192
"""Recorded a round from scratch: robots that tumble show little each."""


def resolve(options: Loop) -> LoopCfg:
    """The preset's configuration with what the command line gives put over it."""
    _check(options)
    quick, scratch = options.preset == "quick", options.base == "none"
    clips = ClipCfg.of(options.clip_s)
    rounds = 4 if scratch else 2 if quick else 4
    labels = 100 if scratch else 30
    return LoopCfg(
        method=FROM_SCRATCH if scratch else STYLE,
        rounds=rounds if options.rounds is None else options.rounds,
        labels=labels if options.labels is None else options.labels,
        rater=options.rater,
        simulated=erring_rater(options.erring),
        criterion=options.criterion,
        base=options.base,
        robot=None if options.robot is None else str(options.robot),
        seed=options.seed,
        steps=_scratch_steps(quick) if scratch else _style_steps(quick),
        clips=clips,
        stop_asking=options.stop_asking,
        record=RecordCfg(
            episodes=_SCRATCH_EPISODES if scratch else RecordCfg.episodes,
            episode_s=max(RecordCfg.episode_s, 3 * clips.clip_s),
            change_s=options.change_s,
        ),
    )


def _scratch_steps(quick: bool) -> StepsCfg:
    # A long one overdoes what a reward got wrong, and nothing is learned then.
    return StepsCfg(base=0, round=600_000, last=800_000 if quick else 1_500_000)


def _style_steps(quick: bool) -> StepsCfg:
    if quick:
        return StepsCfg(base=800_000, round=600_000, last=600_000)
    return StepsCfg(base=1_500_000, round=700_000, last=700_000)


def _check(options: Loop) -> None:
    """
    Raises:
        RunError: an option is out of range, or says something of who is not there.
    """
    if options.change_s is not None and not 0.0 < options.change_s <= LONGEST_S:
        raise RunError(
            f"--change-s must lie in (0, {LONGEST_S:g}] seconds, got "
            f"{options.change_s:g}"
        )
    if options.rater == "human" and options.erring != Erring():
        raise RunError(
            "--beta, --gamma, --mistakes, --skip, --equal and --why say how the "
            "simulated rater answers: leave them out with --rater human"
        )
