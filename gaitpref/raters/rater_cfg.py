"""How a simulated rater errs: the settings, without anything heavy to import."""

from __future__ import annotations

import math
from dataclasses import dataclass

from data.answers.answer_records import Aspect


@dataclass(frozen=True, kw_only=True)
class RaterCfg:
    """A rater of the B-Pref family (Lee et al. 2021); by default one who never errs.

    Leads are measured in *typical leads*: 1 is the median distance between the mean
    scores of the two clips of a pair, over all pairs asked so far. So the settings mean
    the same for every criterion, whatever its units.
    """

    beta: float = math.inf
    """Rationality: P(a) = sigmoid(beta * lead). With 1, a quarter of the answers at the
    typical lead is wrong, and about 30 % of all, most of them on close pairs; with 3,
    about 14 % of all. inf always takes the better clip."""
    gamma: float = 1.0
    """Myopia in (0, 1]: a step counts gamma times as much as the one after it."""
    mistakes: float = 0.0
    """Share of the answers that are turned round, however clear the pair."""
    skip: float = 0.0
    """"Can't tell" where both clips are among the worst `skip` of those asked about."""
    equal: float = 0.0
    """"Equal" where the lead is below this, in typical leads."""
    why: Aspect | None = None
    """What of the gait its preferences are said to be about; None: it does not say."""
    why_right: float = 0.8
    """Share of the answers in which it says so; in the others it names another."""

    def __post_init__(self) -> None:
        if not self.beta > 0.0:
            raise ValueError(f"beta must be positive, got {self.beta}")
        if not 0.0 < self.gamma <= 1.0:
            raise ValueError(f"gamma must lie in (0, 1], got {self.gamma}")
        for name in ("mistakes", "skip", "why_right"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} must lie in [0, 1], got {value}")
        if not self.equal >= 0.0:
            raise ValueError(f"equal must not be negative, got {self.equal}")
