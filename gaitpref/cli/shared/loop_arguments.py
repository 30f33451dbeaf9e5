"""From the command line to the configuration of a loop."""

from __future__ import annotations

from dataclasses import replace

from gaitpref.cli.options.options import Erring, Loop
from gaitpref.loop.loop_cfg import NEW_BASES, RATERS, LoopCfg, RunError
from gaitpref.loop.presets import loop_cfg
from policy.env.env_cfg import EnvCfg, getup_env
from policy.offpolicy.sac_cfg import SacCfg

from .rater_arguments import erring_rater, program_of
from .simulator import sim_of


def resolve(options: Loop) -> LoopCfg:
    """The preset's configuration with what the command line gives put over it.

    Raises:
        GaitprefError: an option is out of range, says something of who is not there, or
            names a file that cannot be used.
    """
    if options.rater != "simulated" and options.erring != Erring():
        raise RunError(
            "--beta, --gamma, --mistakes, --skip, --equal and --why say how the "
            f"simulated rater answers: leave them out with --rater {options.rater}"
        )
    if options.rater != "human" and options.apart is not None:
        raise RunError(
            "--apart says how different clips look that people are asked about: leave "
            f"it out with --rater {options.rater}"
        )
    program = program_of(options.rater, RATERS, options.asking, options.teaching)
    cfg = loop_cfg(
        criterion=options.criterion,
        base="task" if options.base is None and options.getup else options.base,
        robot=options.robot,
        quick=options.preset == "quick",
        rounds=options.rounds,
        labels=options.labels,
        steps=options.steps,
        rater=program or options.rater,
        simulated=erring_rater(options.erring),
        clip_s=options.clip_s,
        change_s=options.change_s,
        stop_asking=options.stop_asking,
        seed=options.seed,
    )
    cfg = _learned(options, cfg)
    if options.apart is not None:
        questions = replace(cfg.method.questions, apart=options.apart)
        cfg = replace(cfg, method=replace(cfg.method, questions=questions))
    cfg = replace(cfg, steps=replace(cfg.steps, sim=sim_of(options)))
    return replace(cfg, env=_lying(cfg.env, cfg.base)) if options.getup else cfg


def _learned(options: Loop, cfg: LoopCfg) -> LoopCfg:
    """`cfg` with who learns, and with networks of which sizes.

    Raises:
        RunError: sizes are given of what has none, or others.
    """
    if options.algorithm == "ppo":
        sizes = options.actor_sizes, options.critic_sizes
        if sizes != (Loop.actor_sizes, Loop.critic_sizes):
            raise RunError(
                "--actor-sizes and --critic-sizes are about off-policy learning: give "
                "--algorithm fastsac too, or leave them out"
            )
        return cfg
    learner = SacCfg(critic_sizes=options.critic_sizes)
    cfg = replace(cfg, method=replace(cfg.method, learner=learner, exploration=None))
    if not options.actor_sizes:
        return cfg
    if cfg.base_file is not None:
        raise RunError(
            f"--actor-sizes is of a new policy, and --base {cfg.base} has networks of "
            "its own: leave it out, or give --base task or none"
        )
    return replace(cfg, ppo=replace(cfg.ppo, hidden_sizes=options.actor_sizes))


def _lying(env: EnvCfg, base: str) -> EnvCfg:
    """The environment of a loop about getting up.

    Raises:
        RunError: what it goes on with is a policy for something else.
    """
    if env.getup is not None:
        return env
    if base not in NEW_BASES:
        raise RunError(
            f"--getup with --base {base}: that policy was never trained lying; give "
            f"one of `gaitpref train --getup`, or --base none or task"
        )
    return getup_env(env)
