"""Which policy stays: the new one, or the one it was to better.

Where answers err, a reward may be right about most pairs and still ruin what is trained
on it. So the first questions of a round are about its new policy beside the one it was
to better.
"""

from __future__ import annotations

from dataclasses import dataclass

from .context import RoundContext

ODDS_BEFORE = 10.0
"""That a new policy is better before anybody is asked: 22 of 24 were."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A new policy is judged beside the one before it."""

    first: int
    """Round of the first policy that is judged: a first walk from scratch need not
    please yet."""
    noisy_labels: int = 7
    """Answers that judge each new policy where answers err, and are kept for the last;
    0 judges none."""
    last_labels: int = 0
    """Answers that judge the last policy alone where answers do not err: the longest
    training ends where nobody is asked any more."""
    odds_to_go_on: float = 1 / ODDS_BEFORE
    """How much likelier than not answers alone must make it that a new policy is better
    for the next training to begin from it."""
    odds_to_stay: float = 3 / ODDS_BEFORE
    """The odds for it to be the last one, where answers err."""

    def labels(self, context: RoundContext) -> int:
        """Answers that are kept for judging the last policy, if there are so many."""
        return self.noisy_labels if context.noisy else self.last_labels

    def judges(self, context: RoundContext) -> bool:
        """Whether the policy of a round is judged, where answers are kept for it."""
        return context.number >= self.first and (context.is_last or bool(context.noisy))

    def odds_needed(self, context: RoundContext) -> float:
        """Odds, by the answers alone, from which on the new policy is approved."""
        strict = context.is_last and bool(context.noisy)
        return self.odds_to_stay if strict else self.odds_to_go_on


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the answers say of a new policy beside the one it was to better."""

    for_new: int
    """Answers that prefer it."""
    for_old: int
    """Answers that prefer the other."""
    error_share: float
    """Share of answers that are random, as the newest reward found it, in (0, 1)."""
    needed: float
    """Odds from which on the new policy is approved."""

    def __post_init__(self) -> None:
        if not 0.0 < self.error_share < 1.0:
            raise ValueError(f"error_share must lie in (0, 1), got {self.error_share}")

    @property
    def odds(self) -> float:
        """That the new policy is better, if either was as likely before."""
        wrong = self.error_share / 2
        return ((1 - wrong) / wrong) ** (self.for_new - self.for_old)

    @property
    def approved(self) -> bool:
        return self.odds >= self.needed
