"""PPO that begins from the networks of a policy file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from data.files.weights import misfits

from .policy_error import PolicyError
from .reward_ppo import RewardPpo

LOOKING_ON = 10
"""Updates of a new critic before the policy it judges is changed."""


def take_over(
    alg: RewardPpo, init: Path, payload: dict[str, Any], *, sizes: tuple[int, ...]
) -> None:
    """Give `alg` the actor of a policy file, and its critic if it has one.

    Critics of others were shown other rewards, and an off-policy learner's judges
    actions: a new one looks on first.

    Raises:
        PolicyError: they are other networks.
    """
    _require_same_critic(alg, init, payload)
    parts: dict[str, Any] = {"actor": alg.actor, "critic": alg.critic}
    if "critic_state_dict" not in payload:
        del parts["critic"]
        alg.looking_on = LOOKING_ON
    for part, network in parts.items():
        found = payload.get(f"{part}_state_dict", {})
        if differences := misfits(found, network.state_dict()):
            raise PolicyError(
                f"{init} cannot be trained further with networks of {sizes}, its "
                f"{part} does not fit: {differences}"
            )
    alg.load(payload, dict.fromkeys(parts, True), strict=True)


def _require_same_critic(alg: RewardPpo, init: Path, payload: dict[str, Any]) -> None:
    """Say what differs where the critic of `init` was shown something else."""
    mean = "obs_normalizer._mean"
    theirs = payload.get("critic_state_dict", {}).get(mean)
    ours = alg.critic.state_dict().get(mean)
    if theirs is None or ours is None or theirs.shape == ours.shape:
        return
    raise PolicyError(
        f"the critic of {init} was shown {theirs.shape[-1]} numbers and would be "
        f"shown {ours.shape[-1]}: with --randomize it sees what was drawn at "
        "random. Train on with the --randomize it was trained with, off or not off"
    )
