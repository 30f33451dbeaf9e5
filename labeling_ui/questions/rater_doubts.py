"""Raters who seem not to look: found by tests that hardly ever blame one who does.

Each needs no reward, so that people are told while they still answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from data.answers.rater_habits import guesses, sides_of

from .rater_figures import RaterFigures, Row, Share, agreement_of

GOLD = 0.8
"""Known answers that a rater who looks gives, at least."""
SELF = 0.65
"""Own answers that such a rater gives again, at least: many pairs are close."""
_ERRORS = 2.0
"""Standard errors by which the others may agree less than it seems."""


def doubts(rows: Sequence[Row], own: RaterFigures) -> tuple[str, ...]:
    """What says that a rater does not look; nothing of most.

    Args:
        rows: Current answers of everybody.
        own: The figures of the rater, from these.
    """
    rater_id = own.rater_id
    found = [
        str(sides)
        for sides in sides_of(a for _, a in rows if a.rater_id == rater_id)
        if sides.one_sided
    ]
    others = [row for row in rows if row[1].rater_id != rater_id]
    together = agreement_of(others, {answer.rater_id for _, answer in others})
    for share, expected, what in (
        (own.gold, GOLD, "known answers were given"),
        (own.self_consistency, SELF, "answers were the same when asked again"),
        (own.agreement, _at_least(together), "answers are those of others"),
    ):
        if expected is not None and guesses(share.hits, share.of, expected):
            found.append(
                f"{rater_id} answers as if at random: {share.hits} of {share.of} {what}"
            )
    return tuple(found)


def _at_least(share: Share) -> float | None:
    """How often other raters agree at least; None where that is no more than chance."""
    if share.share is None:
        return None
    error = math.sqrt(share.share * (1 - share.share) / share.of)
    least = min(share.share - _ERRORS * error, 1 - 1e-9)
    return least if least > 0.5 else None
