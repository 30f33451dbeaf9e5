"""`gaitpref train --algorithm fastsac`: which engine, and what learning offline was
worth."""

from __future__ import annotations

from collections.abc import Callable

from data.errors import GaitprefError
from data.files.files import read_json
from gaitpref.cli.options import options
from gaitpref.cli.shared.training_command import refuse_unasked
from gaitpref.console.terminal import EXIT_BAD_INPUT
from gaitpref.training.offline_gain import offline_gain
from policy.engines.actors_cfg import ActorsCfg
from policy.env.env_cfg import EnvCfg
from policy.offpolicy.distance import TOO_FAR
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.offpolicy.sac_cfg import PriorityCfg, SacCfg
from policy.parallel.ranks import Ranks
from policy.robots.robot import Robot
from policy.training.checkpoint import load_policy
from policy.training.ppo import ScoreFn
from policy.training.session import TrainResult
from policy.training.training_dir import SUMMARY_NAME

EXIT_NO_GAIN = 1
_DISTANCE, _RETURN = "offline/action_distance", "train/return"


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
                *("actor_sizes", "critic_sizes", "clone_weight"),
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
    if not command.offline:
        refuse_unasked(
            command, ("clone_weight",), "is about --offline learning: give that"
        )
    try:
        sac = SacCfg(
            clone_weight=command.clone_weight if command.offline else 0.0,
            critic_sizes=command.critic_sizes,
            memory=command.memory,
            updates_per_step=command.updates_per_step,
            priorities=PriorityCfg() if command.prioritised else None,
        )
    except ValueError as error:
        raise GaitprefError(f"--{str(error).replace('_', '-')}") from None
    return OffPolicy(
        cfg=sac,
        replay=command.replay,
        offline=command.offline,
        actors=actors,
        tell=tell,
    )


def told_offline(
    command: options.Train,
    result: TrainResult,
    robot: Robot,
    env: EnvCfg,
    reward_fn: ScoreFn | None,
    tell: Callable[[str], None],
) -> int:
    """Tell how far a policy went from the data it was learned from, and what that was
    worth, what is wrong last; gives the exit code, the same however often a training
    that is finished is gone on with."""
    found = read_json(result.policy.with_name(SUMMARY_NAME))
    before = found[_RETURN] if command.init is None else load_policy(command.init)
    after = load_policy(result.policy)
    gain = offline_gain(before, after, robot, env, reward_fn)
    distance = found[_DISTANCE]
    if distance >= TOO_FAR:
        tell(gain.words)
        tell(
            f"the data do not hold what the reward wants: the policy's actions differ "
            f"from those in memory by {distance:.2f} of what two of them differ by, so "
            "what it is thought to be worth is a guess; record episodes nearer to it, "
            "or leave --offline out"
        )
        return EXIT_BAD_INPUT
    tell(
        f"its actions differ from those in memory by {distance:.2f} of what two of "
        "them differ by"
    )
    tell(gain.words)
    return 0 if gain.gained else EXIT_NO_GAIN
