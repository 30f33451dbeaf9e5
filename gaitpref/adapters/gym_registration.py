"""Telling Gymnasium about the environment, without importing what it needs."""

from __future__ import annotations

from gymnasium.envs.registration import register as register_env
from gymnasium.envs.registration import registry

ENV_ID = "gaitpref/Quadruped-v0"


def register() -> None:
    """Make `gymnasium.make` and `make_vec` know `ENV_ID`."""
    if ENV_ID not in registry:
        register_env(
            id=ENV_ID,
            entry_point="gaitpref.adapters.gym_env:QuadrupedGymEnv",
            vector_entry_point="gaitpref.adapters.gym_env:QuadrupedVectorEnv",
        )
