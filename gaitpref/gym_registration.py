"""Telling Gymnasium about the environment; cheap, for Gymnasium calls it at import."""

from __future__ import annotations

from gymnasium.envs.registration import register as register_env
from gymnasium.envs.registration import registry

ENV_ID = "gaitpref/Quadruped-v0"


def register() -> None:
    """Make `gymnasium.make` and `make_vec` know `ENV_ID`.

    An installed gaitpref is found by Gymnasium itself, through an entry point.
    """
    if ENV_ID not in registry:
        register_env(
            id=ENV_ID,
            entry_point="gaitpref.gym_env:QuadrupedGymEnv",
            vector_entry_point="gaitpref.gym_env:QuadrupedVectorEnv",
        )
