"""Tells an answer from a key that is held down, a double click and a late event."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime

from .judgement import Judgement, Verdict


@dataclass(frozen=True, kw_only=True)
class GuardCfg:
    """How long things take at least when a person means them."""

    min_shown_s: float = 0.5
    """A pair shown for less was not judged."""
    repeat_gap_s: float = 0.25
    """Pause after which an equal verdict is no held key, however long one is held."""
    same_verdict_s: float = 1.1
    """After an accepted verdict the same one waits this long: a held key repeats for
    the first time after up to a second."""


@dataclass(frozen=True)
class GuardState:
    """What the guard remembers of one browser tab."""

    question_id: str | None = None
    """What is on the screen."""
    since: datetime | None = None
    """Since when."""
    event: tuple[Verdict, datetime] | None = None
    """The last verdict that arrived, accepted or not."""
    accepted: tuple[Verdict, datetime] | None = None

    def on_screen(self, question_id: str | None, at: datetime) -> GuardState:
        """The state once a question is shown; showing it again changes nothing."""
        if question_id == self.question_id:
            return self
        return replace(self, question_id=question_id, since=at)


def weigh(
    state: GuardState, judgement: Judgement, at: datetime, cfg: GuardCfg
) -> tuple[GuardState, str]:
    """Decide on a judgement that arrives at `at`.

    Returns:
        The state afterwards, and why it is ignored: empty if it is an answer.
    """
    reason = _objection(state, judgement, at, cfg)
    event = (judgement.verdict, at)
    accepted = state.accepted if reason else event
    return replace(state, event=event, accepted=accepted), reason


def _objection(
    state: GuardState, judgement: Judgement, at: datetime, cfg: GuardCfg
) -> str:
    if judgement.dialog_open:
        return "Close the dialog first."
    if judgement.question_id != state.question_id or state.since is None:
        return "This pair is not on the screen any more."
    if _within(state.since, at, cfg.min_shown_s):
        return "The pair has only just appeared."
    for last, limit_s in (
        (state.event, cfg.repeat_gap_s),
        (state.accepted, cfg.same_verdict_s),
    ):
        if last and last[0] == judgement.verdict and _within(last[1], at, limit_s):
            return "The key was held down, or pressed twice."
    return ""


def _within(earlier: datetime, at: datetime, limit_s: float) -> bool:
    # A clock that was set back must not lock the rater out.
    return 0.0 <= (at - earlier).total_seconds() < limit_s
