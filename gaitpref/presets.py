"""Presets of the loop: from the command line to a configuration."""

from __future__ import annotations

from dataclasses import replace

from policy.record import LONGEST_S, RecordCfg
from policy.variation import VariationCfg
from rewardmodel.cfg import FitCfg, LinearCfg, SparseCfg

from .loop_cfg import ExplorationCfg, LoopCfg, RunError
from .options import Erring, Loop
from .questions import ClipCfg
from .rater_cfg import erring_rater


def resolve(options: Loop) -> LoopCfg:
    """The preset's configuration with what the command line gives put over it."""
    quick = options.preset == "quick"
    scratch = options.base == "none"
    clips = ClipCfg.of(options.clip_s)
    _check(options)
    recorded = RecordCfg(
        episode_s=max(RecordCfg.episode_s, 3 * clips.clip_s),
        change_s=options.change_s,
        variation=VariationCfg(share=0.5),
    )
    common = {
        "clips": clips,
        "rater": options.rater,
        "simulated": erring_rater(options.erring),
        "criterion": options.criterion,
        "base": options.base,
        "robot": None if options.robot is None else str(options.robot),
        "seed": options.seed,
        "stop_asking": options.stop_asking,
    }
    if scratch:
        return LoopCfg(
            rounds=4 if options.rounds is None else options.rounds,
            labels=100 if options.labels is None else options.labels,
            # Whether a walk is better than standing has to be clear at once; the other
            # answers are worth more about walks, when there are some.
            first_share=0.48,
            most_first_share=0.75,
            first_least=30,
            base_steps=0,
            round_steps=600_000,
            # A long one overdoes what a reward got wrong, and nobody is asked any more.
            last_round_steps=800_000 if quick else 1_500_000,
            learned_weight=1.0,
            exploration=ExplorationCfg(),
            # Beside clips without noise, those with it teach that moving is bad; and a
            # robot that only shakes shows nobody what walking would be like.
            record=replace(recorded, episodes=192, noisy_share=1.0, babble_share=0.3),
            # Robots that tumble move their feet and joints whatever they do of what
            # they are told; answers that err cannot tell the two apart.
            fit=FitCfg(kind="linear", linear=LinearCfg(told_most=True)),
            **common,
        )
    rounds = 3 if quick else 5
    return LoopCfg(
        rounds=rounds if options.rounds is None else options.rounds,
        labels=60 if options.labels is None else options.labels,
        base_steps=800_000 if quick else 1_500_000,
        round_steps=300_000 if quick else 600_000,
        last_round_steps=600_000 if quick else 1_200_000,
        learned_weight=3.0,
        last_labels=5,
        exploration=None,
        calm_std=0.1,
        record=recorded,
        most_first_share=0.75,
        first_agreement=0.8,
        # A wish about a walk that is there is about few things, and not about following
        # commands, which the task pays for; of robots that tumble, everything is to be
        # learned at once.
        fit=FitCfg(kind="sparse", sparse=SparseCfg(told=False)),
        **common,
    )


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
            "--beta, --gamma, --mistakes, --skip and --equal say how the simulated "
            "rater errs: leave them out with --rater human"
        )
