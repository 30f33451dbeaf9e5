"""`gaitpref train --algorithm fastsac`: which engine, and with what in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from data.errors import GaitprefError
from gaitpref.cli.options import options
from policy.offpolicy.distance import TOO_FAR
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.offpolicy.sac_cfg import OFFLINE_CLONE_WEIGHT, SacCfg
from policy.parallel.ranks import Ranks
from policy.training.ppo import IterationStats, PpoCfg
from policy.training.train import TrainCfg

_STEPS_PER_ITERATION = 512
"""Environment steps after which figures are written, about."""
_SAVE_EVERY = 100
"""Iterations between two states; each holds all of memory."""


def off_policy_of(
    command: options.Train, ranks: Ranks, tell: Callable[[str], None]
) -> OffPolicy | None:
    """The engine of an off-policy training; None of PPO's.

    Raises:
        GaitprefError: options that do not go together.
    """
    if command.algorithm == "ppo":
        _require_no_options_of_its_own(command)
        return None
    if command.actors is not None or ranks.size > 1:
        raise GaitprefError(
            "--algorithm fastsac collects and learns in one process: leave --actors "
            "and torchrun out, or --algorithm fastsac"
        )
    sac = SacCfg(memory=command.memory, updates_per_step=command.updates_per_step)
    if command.offline:
        sac = replace(sac, clone_weight=OFFLINE_CLONE_WEIGHT)
    return OffPolicy(cfg=sac, replay=command.replay, offline=command.offline, tell=tell)


def off_policy_cfg(cfg: TrainCfg, engine: OffPolicy) -> tuple[TrainCfg, OffPolicy]:
    """`cfg` in short iterations with rare states, and networks as those it begins with.

    Of PPO's settings only the number of environments and the mirror are kept.
    """
    ppo = PpoCfg(
        num_envs=cfg.ppo.num_envs,
        steps_per_env=max(1, _STEPS_PER_ITERATION // cfg.ppo.num_envs),
        hidden_sizes=cfg.ppo.hidden_sizes,
        mirror=cfg.ppo.mirror,
        bonus=cfg.ppo.bonus,
        kl_penalty=cfg.ppo.kl_penalty,
    )
    sac = replace(engine.cfg, actor_sizes=ppo.hidden_sizes)
    return replace(cfg, ppo=ppo, save_every=_SAVE_EVERY), replace(engine, cfg=sac)


def told_of_distance(stats: IterationStats | None) -> str:
    """What to say of a policy that was learned offline; empty where it is sound."""
    found = stats.scalars.get("offline/action_distance") if stats else None
    if found is None:
        return ""
    if found < TOO_FAR:
        return (
            f"its actions differ from those in memory by {found:.2f} of what two of "
            "them differ by; none of it was tried: `gaitpref evaluate` tries it"
        )
    return (
        f"the data do not hold what the reward wants: the policy's actions differ from "
        f"those in memory by {found:.2f} of what two of them differ by, so what it is "
        "thought to be worth is a guess; record episodes nearer to it, or leave "
        "--offline out"
    )


def _require_no_options_of_its_own(command: options.Train) -> None:
    own = options.Train(out=command.out, reward=command.reward)
    for name in ("replay", "offline", "memory", "updates_per_step"):
        if getattr(command, name) != getattr(own, name):
            raise GaitprefError(
                f"--{name.replace('_', '-')} is about off-policy learning: give "
                "--algorithm fastsac too, or leave it out"
            )
