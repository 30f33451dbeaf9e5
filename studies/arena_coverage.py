"""How often an arena's intervals hold what is true, as it chooses and stops by itself.

`python -m studies.arena_coverage` draws answers about players of known strengths from
Bradley and Terry's law. A question is about whom the arena would ask about next, until
the order is sure or all questions are asked.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import tyro

from gaitpref.arena.arena import MEET, ArenaCfg
from gaitpref.arena.strengths import Match, Ranking, least_sure, ranking_of


@dataclass(frozen=True, kw_only=True)
class Options:
    """The share of arenas whose intervals hold what is true, whose order is sure, and
    whose sure order is right."""

    strengths: tuple[float, ...] = (0.8, 0.0, -0.8)
    """Of the players, the best first, logits; 0 in the mean."""
    draws: int = 200
    """Arenas."""
    most: int = ArenaCfg.most
    """Questions of an arena."""
    resamples: int = 1000
    """Of the questions, each time the order is looked at."""
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """What became of many arenas."""

    held: tuple[float, ...]
    """Of each player, the share of arenas whose interval holds its strength."""
    sure: float
    """Share of arenas that ended with a sure order."""
    right: float
    """Share of these whose order is right; 1 of none."""
    asked: float
    """Questions in the mean."""


def held_arena(options: Options, draw: int) -> tuple[Ranking, int]:
    """How an arena ends, and after how many questions."""
    rng = np.random.default_rng([options.seed, draw])
    matches: list[Match] = []
    while True:
        # An arena draws its resamples from its seed, however many answers it has.
        resampling = np.random.default_rng(draw)
        players = len(options.strengths)
        ranking = ranking_of(matches, players, resampling, resamples=options.resamples)
        about = least_sure(ranking, matches, at_least=MEET)
        if about is None or len(matches) == options.most:
            return ranking, len(matches)
        first, second = about
        lead = options.strengths[first] - options.strengths[second]
        score = float(rng.random() < 1 / (1 + np.exp(-lead)))
        question = str(len(matches))
        matches.append(
            Match(first=first, second=second, score=score, question=question)
        )


def coverage(options: Options) -> Coverage:
    """Hold many arenas."""
    ended = [held_arena(options, draw) for draw in range(options.draws)]
    true = np.array(options.strengths)
    held = [(found.low <= true) & (found.high >= true) for found, _ in ended]
    orders = [found.order for found, _ in ended if found.is_sure]
    right = tuple(range(len(true)))
    return Coverage(
        held=tuple(np.mean(held, axis=0).tolist()),
        sure=len(orders) / len(ended),
        right=float(np.mean([order == right for order in orders])) if orders else 1.0,
        asked=float(np.mean([asked for _, asked in ended])),
    )


def main(options: Options) -> int:
    found = coverage(options)
    shares = ", ".join(f"{share:.3f}" for share in found.held)
    print(
        f"of {options.draws} arenas, intervals of each player that hold: {shares}; "
        f"order sure in {found.sure:.2f}, right in {found.right:.2f} of these; "
        f"{found.asked:.0f} questions in the mean"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
