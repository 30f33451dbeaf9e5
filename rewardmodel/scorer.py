"""What every kind of reward model can be asked.

Shapes: M ensemble members, B clips, T steps, N sequences, D descriptors, K steps or
points of a range, G descriptors that have a curve, L lift-offs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn


@dataclass(frozen=True, eq=False)
class Additive:
    """What single descriptors add to the raw reward, each over a range of its own."""

    values: Tensor
    """[K, G] standardised."""
    added: Tensor
    """[M, K, G] by member."""
    rate: tuple[Tensor, Tensor] | None = None
    """Mean and deviation, in lift-offs a step, of a stride rate that is the last of the
    G."""


class Scorer(nn.Module):
    """An ensemble that turns standardised descriptors into raw rewards of its members.

    As it stands, one that looks at each step by itself.
    """

    history_steps = 0
    """Steps before a step that matter to its reward."""

    @property
    def payer(self) -> Scorer:
        """The ensemble whose mean is paid: itself, or what its members agree on."""
        return self

    @property
    def linear_weights(self) -> Tensor | None:
        """[M, D] of a raw reward that is a weighted sum; None of any other."""
        return None

    @property
    def error_share_found(self) -> float | None:
        """Share of the answers that are random, as the fit found it; None of one that
        was told."""
        return None

    @property
    def heights(self) -> Tensor | None:
        """[G] how much each curve makes of a reward that is a sum of curves; None of
        any other."""
        return None

    def require_sound(self) -> None:
        """
        Raises:
            ValueError: what was read from a file is no such model.
        """

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ..., T] of standardised sequences [..., T, D].

        Args:
            steps: The sequences.
            starts: [..., T] bool, where episodes begin; None where only the first step
                of each sequence does.
        """
        raise NotImplementedError

    def of_rows(self, steps: Tensor, starts: Tensor) -> Tensor:
        """Raw rewards [M, T, N] of steps [T, N, D], of which `starts` [T, N] says where
        episodes begin."""
        return self(steps)

    def of_clips(
        self, steps: Tensor, scored: Tensor | None, before: Tensor | None
    ) -> Tensor:
        """Raw rewards [M, ..., T] of clips, standardised [..., T, D], whatever is
        padded.

        Args:
            steps: The clips.
            scored: [..., T] bool, steps that count; padding lies behind them. None
                where all do.
            before: [..., L] lift-offs before them, where somebody knows.
        """
        return self(steps)

    def worths(
        self,
        steps: Tensor,
        scored: Tensor,
        before: Tensor | None,
        rng: np.random.Generator,
    ) -> tuple[Tensor, Tensor] | None:
        """What clips, as those of `of_clips`, are worth to some who could have answered
        as was answered, and the share of their answers that are random.

        Args:
            steps: [B, T, D] the clips.
            scored: Steps that count.
            before: Lift-offs before them.
            rng: Draws who.

        Returns:
            Logits [M, B] and shares [M]; None where these are the members, and alike.
        """
        return None

    def lasting(self, steps: Tensor) -> Tensor:
        """Raw rewards [M, K] of steps [K, D], each as if it lasted."""
        return self(steps)

    def hiding(self, steps: Tensor, hidden: Tensor, before: Tensor | None) -> Tensor:
        """Raw rewards [M, T] of a clip [T, D] whose descriptors `hidden` [D] (bool) are
        average ones."""
        return self(steps.masked_fill(hidden, 0.0))

    def of_average(self, num_descriptors: int) -> Tensor:
        """Raw reward [M, 1] or [M] of a step that is average in everything."""
        return self(torch.zeros(1, num_descriptors))

    def additive(self, places: Tensor, low: Tensor, high: Tensor) -> Additive | None:
        """What each descriptor adds; None of a reward that is no sum over them.

        Args:
            places: [K, 1] from 0 to 1, on the range of each.
            low: [D] lower end of that range, standardised, where the model keeps none.
            high: [D] upper end.
        """
        return None


class SequenceScorer(Scorer):
    """An ensemble for which what led to a step matters to its reward."""

    def of_rows(self, steps: Tensor, starts: Tensor) -> Tensor:
        return self(steps.transpose(0, 1), starts.bool().mT).mT

    def lasting(self, steps: Tensor) -> Tensor:
        return self(steps[:, None])[..., 0]
