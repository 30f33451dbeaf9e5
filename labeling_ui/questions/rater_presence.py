"""Who is at the page, and when each was there last."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from data.answers.answer_records import utc_text
from data.answers.store import AnswerStore

_HERE = """
SELECT count(*) FROM question WHERE rater_id = :rater AND expires_utc > :now
"""
_MINUTE_S, _HOUR_S, _DAY_S = 60, 3600, 86_400


@dataclass(frozen=True)
class Seen:
    """What is known of a rater's presence."""

    answers: int
    last_utc: str | None
    """When the last answer came; None before the first."""
    has_a_pair: bool
    """Whether a pair is on the rater's screen, or was a moment ago."""

    def words(self, now: datetime) -> str:
        """Since when the rater is away, or that a pair is on the screen."""
        if self.has_a_pair:
            return "has a pair on the screen, or had ten minutes ago"
        if self.last_utc is None:
            return "was never here"
        ago_s = max(0.0, (now - datetime.fromisoformat(self.last_utc)).total_seconds())
        for unit_s, unit in ((_DAY_S, "d"), (_HOUR_S, "h"), (_MINUTE_S, "min")):
            if ago_s >= unit_s:
                return f"last answer {ago_s / unit_s:.0f} {unit} ago"
        return "last answer just now"


def seen_of(store: AnswerStore, rater_id: str, now: datetime) -> Seen:
    """What the store knows of a rater's presence."""
    here = {"rater": rater_id, "now": utc_text(now.isoformat())}
    newest = store.history(rater_id, 1)
    return Seen(
        answers=store.count(rater_id=rater_id),
        last_utc=newest[0][1].created_utc if newest else None,
        has_a_pair=bool(store.query(_HERE, here)[0][0]),
    )
