"""A team out of a policy that walks alone: it walks as before until it learns to look.

The networks get inputs for what is seen of the other, with weights of zero. Where each
robot is to have a policy of its own, both begin as the same one.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from data.episodes.team_rows import SIGHT_DIM
from policy.env.env_cfg import RandomiseCfg
from policy.env.feature_row import OBS_DIM
from policy.env.team_cfg import TeamCfg
from policy.networks.two_model import of_both
from policy.networks.widened import widened
from policy.training.checkpoint import (
    PolicyError,
    PolicyInfo,
    payload_bytes,
    policy_info,
    read_plain,
)

_NETWORKS = ("actor_state_dict", "critic_state_dict")


def as_team(path: Path, team: TeamCfg, *, policies: int = 1) -> bytes:
    """The contents of a policy file of teams, out of one of a robot alone; with 2
    `policies`, or out of one of a team that shares it.

    Raises:
        PolicyError: the policy sees something else than this project's observation, or
            is of such a team already, or its file cannot be used.
    """
    payload = read_plain(path)
    info = policy_info(path, payload)
    states = {name: payload[name] for name in _NETWORKS if name in payload}
    if info.env.team is None:
        states, info = _widened_states(path, states, info, team)
    elif policies == 1 or info.ppo.policies is not None:
        raise PolicyError(f"{path} is of a team already: train it further as it is")
    if policies == 1:
        return payload_bytes(states, info)
    assert info.env.team is not None
    states = {name: of_both(state) for name, state in states.items()}
    env = replace(info.env, team=replace(info.env.team, told_apart=True))
    return payload_bytes(
        states, replace(info, env=env, ppo=replace(info.ppo, policies=2))
    )


def _widened_states(
    path: Path, states: dict[str, Any], info: PolicyInfo, team: TeamCfg
) -> tuple[dict[str, Any], PolicyInfo]:
    """Networks that see the other, out of those of a robot alone."""
    if info.ppo.gaits is not None:
        raise PolicyError(
            f"{path} chooses among frozen gaits, which PPO does not train: make a team "
            "of one of its gaits"
        )
    if info.env.law is None and info.ppo.recipe is not None:
        raise PolicyError(
            f"the network of {path} is none of PPO's, as that of --algorithm fastsac, "
            "and a team is trained by PPO: give a policy of PPO"
        )
    if info.env.law is not None:
        raise PolicyError(
            f"{path} was brought in from elsewhere, or does not see the velocity of "
            "its base; a team begins from a policy that sees what `gaitpref train` "
            "shows by default"
        )
    states = {
        name: widened(state, OBS_DIM, SIGHT_DIM) for name, state in states.items()
    }
    critic = states.get("critic_state_dict", {}).get("mlp.0.weight")
    if critic is None or critic.shape[-1] != OBS_DIM + SIGHT_DIM:
        # It was shown what only a simulator knows: a new one looks on first.
        states.pop("critic_state_dict", None)
    env = replace(info.env, team=team, randomise=RandomiseCfg(), curriculum=None)
    ppo = replace(info.ppo, privileged_critic=False, mirror=False)
    return states, replace(info, env=env, ppo=ppo)
