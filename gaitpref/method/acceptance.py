"""Which policy stays, and whether a run ended better than it began.

A reward may be right about most pairs and still ruin what is trained on it. What says
so are answers that no reward was fitted to, about clips of two policies under the same
commands: how often one is preferred (`Duel`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

from .context import RoundContext

SURE = 0.95
"""Probability from which on one policy is said to be better than another."""
LEAST_LAST = 4
"""Answers that can make it so probable, where they all agree."""
_BEFORE = 2
"""Answers about the last policy and the one before, at least."""


@dataclass(frozen=True, kw_only=True)
class Duel:
    """How often the clips of one of two policies were preferred.

    Of the share of such answers nothing is known before: it is uniform in [0, 1], and
    after them it has a beta distribution.
    """

    for_new: int
    """Answers that prefer the new one."""
    for_old: int
    """Answers that prefer the other."""

    @property
    def probably(self) -> float:
        """Probability that the new one is preferred more often than not."""
        return self._above(0.5)

    @property
    def interval(self) -> tuple[float, float]:
        """Share of answers for the new one, with 5 % below and 5 % above."""
        return self._quantile(1 - SURE), self._quantile(SURE)

    def sure(self, probability: float) -> bool:
        """Whether one or the other is better so probably."""
        return max(self.probably, 1 - self.probably) >= probability

    def is_lost(self, probability: float) -> bool:
        """Whether the other is better so probably."""
        return 1 - self.probably >= probability

    def least_more(self, probability: float) -> int:
        """Answers after which, if they all say the same, it is."""
        more = 0
        while not any(
            Duel(for_new=self.for_new + a, for_old=self.for_old + b).sure(probability)
            for a, b in ((more, 0), (0, more))
        ):
            more += 1
        return more

    def _above(self, share: float) -> float:
        """Probability that the share is larger: with n answers of which k are for the
        new one, that of at most k successes among n + 1 (DLMF 8.17.5)."""
        tries = self.for_new + self.for_old + 1
        return sum(
            comb(tries, k) * share**k * (1 - share) ** (tries - k)
            for k in range(self.for_new + 1)
        )

    def _quantile(self, probability: float) -> float:
        low, high = 0.0, 1.0
        for _ in range(50):
            middle = (low + high) / 2
            if 1 - self._above(middle) < probability:
                low = middle
            else:
                high = middle
        return low


@dataclass(frozen=True, kw_only=True)
class Compared:
    """New policies are judged beside those before them."""

    first: int
    """Round of the first policy that is judged before the last: a first walk from
    scratch need not please yet."""
    noisy_labels: int = 7
    """Answers that judge each new policy before the last where answers err; 0 judges
    none."""
    noisy_margin: int = 2
    """Answers more for the old one from which on the next training begins from it."""
    last_share: float = 0.2
    """Share of all answers that is kept for the last policy: after it nobody is asked,
    and it is the one that is used."""
    last_most: int = 8
    """The most that are kept."""
    last_most_noisy: int = 14
    """The most where answers err: so many of five that are right to one that is wrong
    are nearly always sure."""
    before_sure: float = 0.85
    """Probability from which on no more is asked about the last policy and the one it
    began from."""

    def last_labels(self, context: RoundContext) -> int:
        """Answers to keep for the last policy, if there are so many."""
        most = self.last_most_noisy if context.noisy else self.last_most
        least = LEAST_LAST + _BEFORE
        return min(most, max(least, int(self.last_share * context.labels)))

    def judges(self, context: RoundContext) -> bool:
        """Whether the policy of a round before the last is judged."""
        if context.is_last or not context.noisy or not self.noisy_labels:
            return False
        return context.number >= self.first

    def goes_on(self, duel: Duel) -> bool:
        """Whether the next training may begin from the new one."""
        return duel.for_old - duel.for_new < self.noisy_margin
