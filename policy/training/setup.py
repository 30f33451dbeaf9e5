"""Where a policy acts: robot, environment and the size of its networks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from policy.env.env_cfg import EnvCfg
from policy.env.velocity_commands import env_for
from policy.law.driven import driven_by
from policy.robots.robot import Robot, load_robot

from .checkpoint import PolicyError, load_policy
from .clipped_update import LEAST_RATE
from .ppo import PpoCfg


@dataclass(frozen=True, eq=False)
class Setting:
    """What training goes on with has to fit what it started with."""

    robot: Robot
    env: EnvCfg
    ppo: PpoCfg
    """The networks it has; all else is the default."""


def setting_of(policy_file: Path | None, robot_xml: Path | None) -> Setting:
    """The setting of a policy that is trained further, or the default of a new one.

    Args:
        policy_file: The policy; None starts with a new one.
        robot_xml: A robot to use instead of the policy's, or of the one that ships.

    Raises:
        GaitprefError: a file cannot be used.
    """
    if policy_file is None:
        env = EnvCfg()
        robot = load_robot(robot_xml, physics_dt_s=env.physics_dt_s)
        return Setting(robot, env_for(robot, env), PpoCfg())
    policy = load_policy(policy_file)
    if policy.info.ppo.gaits is not None:
        raise PolicyError(
            f"{policy_file} chooses among frozen gaits, which PPO does not train: go "
            "on with `gaitpref options`, or train one of its gaits"
        )
    env = policy.info.env
    robot = policy.robot()
    if robot_xml is not None:
        robot = load_robot(robot_xml, physics_dt_s=env.physics_dt_s)
        if env.law is not None:
            robot = driven_by(robot, env.law)
    trained = policy.info.ppo
    # What a law hides from the policy, the critic may see.
    ppo = PpoCfg(
        hidden_sizes=trained.hidden_sizes, privileged_critic=env.law is not None
    )
    if trained.recipe is not None:
        # How far a step moves the network of a stranger is not known: a rate that suits
        # ours may end its walk at once, and the least one adapts soon.
        ppo = replace(ppo, recipe=trained.recipe, learning_rate=LEAST_RATE)
    return Setting(robot, env, ppo)
