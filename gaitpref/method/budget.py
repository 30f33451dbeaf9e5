"""How many answers every round asks for."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

from rewardmodel.answers.answered_pairs import MIN_ANSWERS

from .acceptance import LEAST_LAST
from .context import RoundContext


@dataclass(frozen=True, kw_only=True)
class FrontLoaded:
    """Much in the first round, and then more from round to round.

    What a first policy is trained on decides where all others begin; the later a
    policy, the more there is to say of it, and the longer its reward is trained on.
    """

    REMOVED: ClassVar = ("most_first_share", "first_least", "first_agreement")
    """Settings that older files have: of a first round that asked on."""

    first_share: float
    """Share of the answers asked for in the first round, of those not kept for judging
    the last policy."""
    least: int = 4
    """Answers every other round asks for at least."""

    def __post_init__(self) -> None:
        if not 0.0 < self.first_share < 1.0:
            raise ValueError(f"first_share must lie in (0, 1), got {self.first_share}")
        if self.least < 1:
            raise ValueError(f"least must be at least 1, got {self.least}")

    def labels_of(
        self, context: RoundContext, *, kept: int = 0, planned: int | None = None
    ) -> int:
        """Answers asked for in the round.

        Args:
            context: The round.
            kept: Answers kept for judging the last policy: those alone in the last.
            planned: Those that were to be kept when the first round asked; by default
                as many.
        """
        if context.is_last:
            return kept
        own = self._first(context, kept if planned is None else planned)
        if context.is_first:
            return own
        left = context.labels - own - kept
        return _growing(left, context.rounds - 1, self.least)[context.number - 1]

    def most_kept(
        self, context: RoundContext, wanted: int, *, planned: int | None = None
    ) -> int:
        """Answers, `wanted` or fewer, that can be kept for judging the last policy:
        every round before it needs some, the first what it asked for where so many were
        `planned`; none where they could not decide."""
        others = self.least * (context.rounds - 1)
        first = MIN_ANSWERS if planned is None else self._first(context, planned)
        kept = min(wanted, context.labels - first - others)
        return kept if kept >= LEAST_LAST else 0

    def _first(self, context: RoundContext, kept: int) -> int:
        """Answers of the first round: enough for a fit, and no more than the others can
        spare."""
        if context.rounds == 1:
            return context.labels - kept
        share = int(self.first_share * (context.labels - kept))
        others = self.least * (context.rounds - 1)
        return min(max(MIN_ANSWERS, share), context.labels - kept - others)


def _growing(labels: int, rounds: int, least: int) -> list[int]:
    """Answers of each round; the shares grow linearly."""
    weights = range(rounds, 0, -1)
    spare = labels - least * rounds
    marks = [spare * sum(weights[:i]) // sum(weights) for i in range(rounds + 1)]
    return [least + b - a for a, b in pairwise(marks)][::-1]
