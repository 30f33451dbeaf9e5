"""`gaitpref train --algorithm fastsac`: which engine, and with what in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from data.errors import GaitprefError
from gaitpref.cli.options import options
from gaitpref.cli.shared.training_command import refuse_unasked
from policy.engines.actors_cfg import ActorsCfg
from policy.offpolicy.distance import TOO_FAR
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.offpolicy.sac_cfg import OFFLINE_CLONE_WEIGHT, PriorityCfg, SacCfg
from policy.parallel.ranks import Ranks
from policy.training.ppo import IterationStats

_DISTANCE = "offline/action_distance"


def off_policy_of(
    command: options.Train,
    actors: ActorsCfg | None,
    ranks: Ranks,
    tell: Callable[[str], None],
) -> OffPolicy | None:
    """The engine of an off-policy training; None of PPO's.

    Raises:
        GaitprefError: options that do not go together.
    """
    if command.algorithm == "ppo":
        refuse_unasked(
            command,
            (
                *("replay", "offline", "memory", "updates_per_step", "prioritised"),
                *("actor_sizes", "critic_sizes"),
            ),
            "is about off-policy learning: give --algorithm fastsac",
        )
        return None
    if ranks.size > 1:
        raise GaitprefError(
            "--algorithm fastsac learns in one process: start it without torchrun, or "
            "leave it out; --actors N collects in several"
        )
    if command.most_lag != options.Train.most_lag:
        raise GaitprefError(
            "--most-lag drops steps of older weights, and --algorithm fastsac learns "
            "from all of them: leave one of the two out"
        )
    if command.actor_sizes and command.init is not None:
        raise GaitprefError(
            "--actor-sizes is of a new policy, and --init has networks of its own: "
            "leave one of the two out"
        )
    try:
        sac = SacCfg(
            critic_sizes=command.critic_sizes,
            memory=command.memory,
            updates_per_step=command.updates_per_step,
            priorities=PriorityCfg() if command.prioritised else None,
        )
    except ValueError as error:
        raise GaitprefError(f"--{str(error).replace('_', '-')}") from None
    if command.offline:
        sac = replace(sac, clone_weight=OFFLINE_CLONE_WEIGHT)
    return OffPolicy(
        cfg=sac,
        replay=command.replay,
        offline=command.offline,
        actors=actors,
        tell=tell,
    )


def is_too_far(stats: IterationStats | None) -> bool:
    """Whether a policy that was learned offline left the data behind."""
    return bool(stats and stats.scalars.get(_DISTANCE, 0.0) >= TOO_FAR)


def told_of_distance(stats: IterationStats | None) -> str:
    """What to say of a policy that was learned offline; empty where it is sound."""
    found = stats.scalars.get(_DISTANCE) if stats else None
    if found is None:
        return ""
    if not is_too_far(stats):
        return (
            f"its actions differ from those in memory by {found:.2f} of what two of "
            "them differ by"
        )
    return (
        f"the data do not hold what the reward wants: the policy's actions differ from "
        f"those in memory by {found:.2f} of what two of them differ by, so what it is "
        "thought to be worth is a guess; record episodes nearer to it, or leave "
        "--offline out"
    )
