"""Episodes of the shipped walk, whose truth is known, to make logs of."""

from __future__ import annotations

from functools import cache

from data.episodes.episode import Episode
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg


@cache
def walked(episodes: int = 3, episode_s: float = 4.0) -> tuple[Episode, ...]:
    """Walks at several commands; a few seconds to make, and made once."""
    cfg = RecordCfg(episodes=episodes, episode_s=episode_s)
    return tuple(record(WALK, cfg, seed=0, round=0))
