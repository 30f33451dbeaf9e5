"""How strong players are, from who was preferred to whom.

Bradley and Terry (1952): P(i preferred to j) = s(theta_i - theta_j), s the logistic
function. A tie is half a win for either. A weak prior N(0, 1/a) keeps strengths finite
where somebody won always. Intervals are percentiles over a bootstrap of the questions,
as answers to one question hang together. A bootstrap of three wins out of three knows
of no defeat, so that intervals and order are never surer than the curvature of the
likelihood at its maximum says (Laplace).

Shapes: P players, R resamples.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist

import numpy as np

_PRIOR = 0.1
"""a: a tenth of a match against an average player."""
_STEPS, _ENOUGH = 50, 1e-9
_SURE = 0.95
_Z = 1.96


@dataclass(frozen=True, kw_only=True)
class Match:
    """An answer about clips of two players.

    Raises:
        ValueError: a player is beside itself, or the score is no share.
    """

    first: int
    """Number of a player."""
    second: int
    score: float
    """1 where the first is preferred, 0 where the second is, 0.5 for a tie."""
    question: str
    """What was asked: answers to the same question hang together."""

    def __post_init__(self) -> None:
        if self.first == self.second or not 0.0 <= self.score <= 1.0:
            raise ValueError(f"no match: {self}")


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """What the answers say of all players."""

    strengths: np.ndarray
    """[P] logits, 0 in the mean."""
    low: np.ndarray
    """[P] lower end of the 95 % interval."""
    high: np.ndarray
    """[P] upper end."""
    order: tuple[int, ...]
    """Players, the best first."""
    kept: tuple[float, ...]
    """[P - 1] for each neighbours in the order, the share of resamples in which they
    stand so."""

    @property
    def is_sure(self) -> bool:
        """Whether every place is, at 95 %."""
        return all(share >= _SURE for share in self.kept)


def wins_of(matches: Iterable[Match], players: int) -> np.ndarray:
    """[P, P] how often each was preferred to each, row over column, ties half."""
    wins = np.zeros((players, players))
    for match in matches:
        wins[match.first, match.second] += match.score
        wins[match.second, match.first] += 1 - match.score
    return wins


def strengths_of(wins: np.ndarray) -> np.ndarray:
    """[..., P] strengths from wins [..., P, P], row over column, ties half each: the
    maximum of the likelihood times the prior, by Newton's method."""
    players = wins.shape[-1]
    played = wins + wins.swapaxes(-1, -2)
    theta = np.zeros(wins.shape[:-1])
    for _ in range(_STEPS):
        expected = 1 / (1 + np.exp(theta[..., None, :] - theta[..., :, None]))
        slope = (wins - played * expected).sum(-1) - _PRIOR * theta
        weight = played * expected * (1 - expected)
        curve = -weight
        curve[..., range(players), range(players)] += weight.sum(-1) + _PRIOR
        step = np.linalg.solve(curve, slope[..., None])[..., 0]
        # Far from the maximum a whole step may overshoot.
        step /= np.maximum(1.0, np.abs(step).max(-1, keepdims=True))
        theta = theta + step
        if np.abs(step).max() < _ENOUGH:
            break
    return theta - theta.mean(-1, keepdims=True)


def covariance_of(wins: np.ndarray, strengths: np.ndarray) -> np.ndarray:
    """[P, P] covariance of strengths [P] about their mean, from the curvature of the
    likelihood of wins [P, P] and of the prior."""
    share = 1 / (1 + np.exp(strengths[None, :] - strengths[:, None]))
    weight = (wins + wins.T) * share * (1 - share)
    curve = np.diag(weight.sum(1) + _PRIOR) - weight
    about_mean = np.eye(len(strengths)) - 1 / len(strengths)
    return about_mean @ np.linalg.inv(curve) @ about_mean


def ranking_of(
    matches: Sequence[Match],
    players: int,
    rng: np.random.Generator,
    *,
    resamples: int = 1000,
) -> Ranking:
    """Strengths with intervals, and how sure the order is.

    Args:
        matches: Answers; none is a ranking that is open.
        players: How many there are.
        rng: Draws the resamples.
        resamples: Draws.
    """
    by_question: dict[str, list[Match]] = defaultdict(list)
    for match in matches:
        by_question[match.question].append(match)
    each = np.array([wins_of(own, players) for own in by_question.values()])
    each = each.reshape(-1, players, players)
    strengths = strengths_of(each.sum(0))
    order = tuple(int(player) for player in np.argsort(-strengths, kind="stable"))
    if not len(each):
        open_ = np.full(players, np.inf)
        kept = (0.5,) * (players - 1)
        return Ranking(
            strengths=strengths, low=-open_, high=open_, order=order, kept=kept
        )
    drawn = rng.multinomial(len(each), np.full(len(each), 1 / len(each)), resamples)
    many = strengths_of(np.tensordot(drawn, each, axes=1))
    low, high = np.quantile(many, [0.025, 0.975], axis=0)
    spread = covariance_of(each.sum(0), strengths)
    low = np.minimum(low, strengths - _Z * np.sqrt(np.diag(spread)))
    high = np.maximum(high, strengths + _Z * np.sqrt(np.diag(spread)))
    kept = []
    for a, b in pairwise(order):
        drawn_so = np.mean(many[:, a] > many[:, b])
        drawn_so += np.mean(many[:, a] == many[:, b]) / 2
        deviation = np.sqrt(spread[a, a] + spread[b, b] - 2 * spread[a, b])
        curved_so = NormalDist().cdf((strengths[a] - strengths[b]) / deviation)
        kept.append(float(min(drawn_so, curved_so)))
    return Ranking(
        strengths=strengths, low=low, high=high, order=order, kept=tuple(kept)
    )


def least_sure(
    ranking: Ranking, matches: Sequence[Match], *, at_least: int
) -> tuple[int, int] | None:
    """The two players the next question is best about; None where the order is sure.

    Neighbours in the order that met less than `at_least` times come first, then those
    whose order is most open.
    """
    met = defaultdict(int)
    for match in matches:
        met[frozenset((match.first, match.second))] += 1
    neighbours = list(pairwise(ranking.order))
    new = [pair for pair in neighbours if met[frozenset(pair)] < at_least]
    if new:
        return min(new, key=lambda pair: met[frozenset(pair)])
    open_ = [
        (share, pair)
        for share, pair in zip(ranking.kept, neighbours, strict=True)
        if share < _SURE
    ]
    return min(open_)[1] if open_ else None
