"""Which policy a training goes on from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class BestLiked:
    """The policy so far that the newest reward likes best.

    A reward learned in between knows more than the one a policy was trained on: where
    the training went too far, or followed what later answers took back, an earlier
    policy is better, and the newest reward says so without another answer.
    """

    def choose(self, worth: Mapping[int, float]) -> int:
        """Round of the policy to go on from, by what the reward is `worth`; of equals
        the newest, as where one stayed for a round."""
        return max(worth, key=lambda number: (worth[number], number))
