"""How many answers every round asks for."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from rewardmodel.answers.answered_pairs import MIN_ANSWERS

from .acceptance import LEAST_LAST
from .context import RoundContext


@dataclass(frozen=True, kw_only=True)
class FrontLoaded:
    """Much in the first round, and then more from round to round.

    What a first policy is trained on decides where all others begin; the later a
    policy, the more there is to say of it, and the longer its reward is trained on.
    """

    first_share: float
    """Share of the answers asked for in the first round, of those not kept for judging
    the last policy."""
    most_first_share: float = 0.0
    """Share of the answers the first round may go on to, while they leave open what is
    wanted; 0: it asks for its own only."""
    first_least: int = 0
    """Answers the first round asks for however few there are in all, as far as
    `most_first_share` lets it."""
    least: int = 4
    """Answers every other round asks for at least."""
    first_agreement: float = 0.94
    """Rank correlation, over the clips, of the members of a reward fitted to them from
    which on the first round's answers leave nothing open."""

    def __post_init__(self) -> None:
        if not 0.0 < self.first_share < 1.0:
            raise ValueError(f"first_share must lie in (0, 1), got {self.first_share}")
        if self.least < 1:
            raise ValueError(f"least must be at least 1, got {self.least}")
        if not 0.0 <= self.most_first_share < 1.0:
            raise ValueError(
                f"most_first_share must lie in [0, 1), got {self.most_first_share}"
            )

    def labels_of(self, context: RoundContext, *, kept: int = 0) -> int:
        """Answers asked for in the round, where `kept` are kept for judging the last
        policy: those alone in the last."""
        if context.is_last:
            return kept
        own = self._first(context, kept)
        if context.is_first:
            return own
        left = context.labels - own - kept
        return _growing(left, context.rounds - 1, self.least)[context.number - 1]

    def most_first(self, context: RoundContext, *, kept: int = 0) -> int:
        """Answers the first round may go on to."""
        if not self.most_first_share or context.rounds == 1:
            return 0
        most = int(self.most_first_share * context.labels)
        return self._bounded(context, most, kept)

    def most_kept(self, context: RoundContext, wanted: int) -> int:
        """Answers, `wanted` or fewer, that can be kept for judging the last policy:
        every round before it needs some; none where they could not decide."""
        first = max(context.first_asked, MIN_ANSWERS)
        others = self.least * (context.rounds - 1)
        kept = min(wanted, context.labels - first - others)
        return kept if kept >= LEAST_LAST else 0

    def _first(self, context: RoundContext, kept: int) -> int:
        """Answers of the first round, which may have asked for more by now."""
        if context.rounds == 1:
            return context.labels - kept
        share = int(self.first_share * (context.labels - kept))
        least = min(self.first_least, self.most_first(context, kept=kept))
        wanted = max(share, least, context.first_asked)
        return self._bounded(context, wanted, kept)

    def _bounded(self, context: RoundContext, wanted: int, kept: int) -> int:
        """`wanted` answers of the first round, enough for a fit, and no more than the
        others can spare."""
        others = self.least * (context.rounds - 1)
        return min(max(MIN_ANSWERS, wanted), context.labels - kept - others)


def _growing(labels: int, rounds: int, least: int) -> list[int]:
    """Answers of each round; the shares grow linearly."""
    weights = range(rounds, 0, -1)
    spare = labels - least * rounds
    marks = [spare * sum(weights[:i]) // sum(weights) for i in range(rounds + 1)]
    return [least + b - a for a, b in pairwise(marks)][::-1]
