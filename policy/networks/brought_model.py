"""RSL-RL's model around a network of others, so that PPO trains it on."""

from __future__ import annotations

from typing import Any

from rsl_rl.models import MLPModel
from tensordict import TensorDict
from torch import nn

from .recipe import Recipe, RecipeNetwork


class BroughtModel(MLPModel):
    """An actor whose network is that of a recipe; its weights are loaded afterwards."""

    def __init__(
        self,
        obs: TensorDict,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        *,
        recipe: Recipe,
        distribution_cfg: dict[str, Any],
    ) -> None:
        super().__init__(
            obs,
            obs_groups,
            obs_set,
            output_dim,
            hidden_dims=(1,),
            distribution_cfg=distribution_cfg,
        )
        self.mlp = RecipeNetwork(recipe)

    def as_jit(self) -> nn.Module:
        """The network alone; it is traced, not scripted."""
        return self.mlp
