"""What a part of the answers says of the players: those about a command, of a rater.

A part is small, and most of it are coincidences: a strength is told of who was asked
about often enough, with its interval, and of nobody else.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .games import Answered, Player
from .strengths import Match, Ranking, ranking_of

LEAST = 8
"""Questions about a player from which on its strength is told."""
About = str | tuple[float, ...]
"""What a part is about: a rater, or a command."""
_RNG_SEED = 0
"""Equal answers give an equal page, whatever the seed of the arena."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """A player in a part of the answers."""

    player: int
    answers: int
    preferred: float
    """Share of them, ties half."""
    strength: float | None
    """Logits beside the mean of all who were asked about in the part; None: too few
    questions for one."""
    interval: tuple[float, float] | None
    """95 % of it."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """A part of the answers."""

    about: About
    answers: int
    shares: dict[int, Share]
    """By player, of those that were asked about."""


def parts_of(
    answers: Sequence[Answered], by: Callable[[Answered], About]
) -> list[Part]:
    """The answers parted as `by` says, in the order of what it gives."""
    parted: dict[About, list[Match]] = defaultdict(list)
    for each in answers:
        parted[by(each)].append(each.match)
    return [_part(about, parted[about]) for about in sorted(parted, key=str)]


def of_command(answer: Answered) -> tuple[float, ...]:
    """What the robot was told."""
    return answer.command


def of_rater(answer: Answered) -> str:
    """Who answered."""
    return answer.rater


def _part(about: About, matches: Sequence[Match]) -> Part:
    players = sorted({number for m in matches for number in (m.first, m.second)})
    place = {player: number for number, player in enumerate(players)}
    own = [
        Match(
            first=place[match.first],
            second=place[match.second],
            score=match.score,
            question=match.question,
        )
        for match in matches
    ]
    ranking = ranking_of(own, len(players), np.random.default_rng(_RNG_SEED))
    return Part(
        about=about,
        answers=len(matches),
        shares={
            player: _share(player, number, own, ranking)
            for player, number in place.items()
        },
    )


def _share(
    player: int, place: int, matches: Sequence[Match], ranking: Ranking
) -> Share:
    scores = [m.score for m in matches if m.first == place]
    scores += [1 - m.score for m in matches if m.second == place]
    asked = {m.question for m in matches if place in (m.first, m.second)}
    enough = len(asked) >= LEAST
    ends = float(ranking.low[place]), float(ranking.high[place])
    return Share(
        player=player,
        answers=len(scores),
        preferred=float(np.mean(scores)),
        strength=float(ranking.strengths[place]) if enough else None,
        interval=ends if enough else None,
    )


def parts_json(
    parts: Sequence[Part], name: str, players: Sequence[Player]
) -> list[dict[str, Any]]:
    """Plain values of parts, of which `name` says what they are about."""
    return [
        {
            name: list(part.about) if isinstance(part.about, tuple) else part.about,
            "answers": part.answers,
            "players": [
                {
                    "name": players[share.player].name,
                    "answers": share.answers,
                    "preferred": share.preferred,
                    "strength": share.strength,
                    "interval": list(share.interval) if share.interval else None,
                }
                for share in part.shares.values()
            ],
        }
        for part in parts
    ]
