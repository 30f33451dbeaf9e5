"""Which moment and which habit a reward likes.

The shares of a step's descriptors add up to its reward minus the reward of an average
step of the judged clips: exactly for a linear model, up to the error of the integral
for integrated gradients, and not at all for occlusion, which asks what would change if
a group of habits were average.

Shapes: K steps, D descriptors, G groups.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from rewardmodel.answers.clip_batch import ClipBatch
from rewardmodel.descriptors.normaliser import fill_missing
from rewardmodel.descriptors.table import columns_seen
from rewardmodel.errors import RewardError
from rewardmodel.models.model import RewardModel

Method = Literal["auto", "exact", "gradients", "occlusion"]

_INTEGRATION_STEPS = 32


@dataclass(frozen=True, eq=False)
class Explanation:
    """A stretch of motion as a reward sees it, step by step."""

    reward: np.ndarray
    """[K] reward of each step."""
    spread: np.ndarray
    """[K] standard deviation over the ensemble."""
    groups: tuple[str, ...]
    shares: np.ndarray
    """[K, G] what each group adds to the reward of an average judged step."""
    descriptors: np.ndarray
    """[K, D] the same by descriptor, as `names`; NaN where occlusion asked only
    about groups."""
    names: tuple[str, ...]
    """Names of the descriptors."""
    average: float
    """Reward of an average judged step."""
    method: str
    robots: np.ndarray | None = None
    """[K, R] what each robot of a team earns; they add up to the reward. None of a
    robot alone."""

    def part(self, steps: np.ndarray) -> Explanation:
        """The steps that are marked in `steps` [K] bool."""
        return replace(
            self,
            reward=self.reward[steps],
            spread=self.spread[steps],
            shares=self.shares[steps],
            descriptors=self.descriptors[steps],
            robots=None if self.robots is None else self.robots[steps],
        )


def explain(
    model: RewardModel, clip: ClipBatch, *, method: Method = "auto"
) -> Explanation:
    """Share the reward of the steps of one clip.

    It is seen as the fit saw clips; what nobody measured counts as average.

    Raises:
        ValueError: the batch holds more than one clip.
        RewardError: `exact` was asked of a model that is not linear, `gradients` of
            one that looks back, or without captum.
    """
    if len(clip) != 1:
        raise ValueError(f"one clip is explained at a time, got {len(clip)}")
    reward, spread = model.clip_rewards(clip)
    steps = fill_missing(model.standardised(clip.features[0]))  # [K, D]
    chosen = _chosen(model, method)
    match chosen:
        case "exact":
            assert model.scorer.linear_weights is not None
            weights = model.scorer.linear_weights.mean(dim=0)
            shares = steps * weights / model.reward_std
        case "gradients":
            shares = _gradients(model, steps)
        case "occlusion":
            shares = torch.full_like(steps, torch.nan)
        case _:
            raise ValueError(f"no way to explain is called {chosen!r}")
    of_each = [column.group for column in columns_seen(model.sight)]
    groups = tuple(dict.fromkeys(of_each))
    members = [[own == group for own in of_each] for group in groups]
    if chosen == "occlusion":
        by_group = torch.stack(
            [
                _occluded(model, steps, torch.tensor(own), clip.lift_offs_before)
                for own in members
            ],
            dim=1,
        )
    else:
        by_group = torch.stack([shares[:, own].sum(dim=1) for own in members], dim=1)
    return Explanation(
        reward=reward[0].numpy(),
        spread=spread[0].numpy(),
        groups=groups,
        shares=by_group.numpy(),
        descriptors=shares.numpy(),
        names=model.names,
        average=float(model.reward_of(model.payer.of_average(steps.shape[1]))),
        method=chosen,
    )


def _chosen(model: RewardModel, method: Method) -> str:
    linear = model.scorer.linear_weights is not None
    if method == "exact" and not linear:
        raise RewardError(
            "only a linear model has exact shares; take --method gradients or occlusion"
        )
    if method == "gradients" and model.history_steps:
        raise RewardError(
            "a step of a model that looks back is several inputs, of which gradients "
            "would name only one; take --method occlusion"
        )
    if method != "auto":
        return method
    if linear:
        return "exact"
    if model.history_steps:
        return "occlusion"
    return "gradients" if _integrated_gradients() else "occlusion"


def _occluded(
    model: RewardModel, steps: Tensor, hidden: Tensor, before: Tensor | None
) -> Tensor:
    """Loss of reward [K] where the descriptors `hidden` [D] are average ones."""
    scorer, before = model.payer, None if before is None else before[0]
    paid = scorer.of_clips(steps, None, before)
    left = scorer.hiding(steps, hidden, before)
    return model.reward_of(paid) - model.reward_of(left)


def _gradients(model: RewardModel, steps: Tensor) -> Tensor:
    """Integrated gradients [K, D] on the way from an average judged step."""
    method = _integrated_gradients()
    if method is None:
        raise RewardError(
            "--method gradients needs the package captum: pip install -e '.[explain]' "
            "-c constraints.txt; or take --method occlusion"
        )
    found = method(lambda inputs: model.reward_of(model.payer(inputs))).attribute(
        steps.requires_grad_(), n_steps=_INTEGRATION_STEPS
    )
    return found.detach().to(torch.float32)


def _integrated_gradients() -> Callable | None:
    try:
        from captum.attr import IntegratedGradients
    except ModuleNotFoundError:
        return None
    return IntegratedGradients
