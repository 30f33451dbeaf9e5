"""Which pairs of clips to ask about next.

Shapes: C clips, K candidate pairs (two indices into the clips each), M members.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from data.answers import Pair
from data.clips import Clip
from data.dataset import EpisodeEntry

from .clips import ClipRows, pad_clips
from .errors import RewardError
from .fit import fold_of
from .model import RewardModel

MAX_CLIPS = 1000
"""Clips looked at for one batch, drawn at random: all their pairs fit in memory."""
CANDIDATES_PER_PAIR = 10
"""Candidates a strategy rates for every pair that will be asked."""
SAME_POLICY_WEIGHT = 0.25
"""How often a pair from one checkpoint becomes a candidate, against one from two:
clips of one checkpoint look alike, and look-alikes are hard to judge."""


class Strategy(Protocol):
    """How much an answer to each candidate would be worth."""

    @property
    def name(self) -> str:
        """Stored with the pair."""
        ...

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """Worth [K] of candidates [K, 2], which index `clips`; more is better."""
        ...


@dataclass(frozen=True)
class Uniform:
    """Any candidate is worth as much as any other."""

    name: str = "uniform"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        return rng.random(len(candidates))


@dataclass(frozen=True)
class Disagreement:
    """Standard deviation over the ensemble of the probability that left is better."""

    model: RewardModel
    clip_rows: ClipRows
    name: str = "disagreement"

    def __call__(
        self, clips: Sequence[Clip], candidates: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        used, positions = np.unique(candidates, return_inverse=True)
        batch = pad_clips([self.clip_rows(clips[index]) for index in used])
        left, right = positions.reshape(candidates.shape).T
        returns = self.model.clip_returns(batch)  # [M, C]
        leads = returns[:, left] - returns[:, right]
        return leads.sigmoid().std(dim=0).numpy()


def choose_pairs(
    entries: Iterable[EpisodeEntry],
    clips: Sequence[Clip],
    count: int,
    *,
    strategy: Strategy,
    round: int,
    known_pairs: Iterable[Pair] = (),
    folds: int = 5,
    rng: np.random.Generator,
) -> list[Pair]:
    """Choose up to `count` pairs worth asking about, best first.

    Both clips obey one command and come from different episodes. Within the batch two
    episodes meet at most once, and a clip comes twice only when no other is left. Pairs
    within one fold of episodes come first, because only those can be held out when the
    fit measures itself; which clip is left is a coin toss.

    Args:
        entries: The episodes of `clips`, with their commands and policies.
        clips: Stretches to choose from.
        count: Pairs wanted; fewer come back when there are no more.
        strategy: What makes a candidate worth asking.
        round: Round of the loop, stored with the pairs.
        known_pairs: Pairs asked already, in either order.
        folds: Groups of episodes, as in `FitCfg.folds`.
        rng: Every random draw.

    Raises:
        RewardError: no two clips of different episodes share a command.
    """
    drawn = [clips[index] for index in rng.permutation(len(clips))[:MAX_CLIPS]]
    pool = _pool(drawn, entries, folds)
    candidates = _candidates(pool, known_pairs, CANDIDATES_PER_PAIR * count, rng)
    if len(candidates) == 0:
        return []
    worth = strategy(drawn, candidates, rng)
    order = np.lexsort((-worth, pool.crosses_folds(candidates)))
    return [
        Pair.make(
            *(drawn[clip] for clip in candidates[row]),
            strategy=strategy.name,
            round=round,
            info={"worth": float(worth[row])},
        )
        for row in _diverse(candidates, order, pool.episode)[:count]
    ]


@dataclass(frozen=True, eq=False)
class _Pool:
    """Facts of clips as small whole numbers [C]; equal facts have equal numbers."""

    clips: Sequence[Clip]
    episode: np.ndarray
    command: np.ndarray
    policy: np.ndarray
    fold: np.ndarray

    def crosses_folds(self, pairs: np.ndarray) -> np.ndarray:
        """[K] bool: the clips of pairs [K, 2] are of different folds."""
        return self.fold[pairs[:, 0]] != self.fold[pairs[:, 1]]

    def codes(self, pairs: np.ndarray, of: np.ndarray) -> np.ndarray:
        """[K] one number for what `of` [C] says of both clips, in either order."""
        low, high = np.sort(of[pairs], axis=1).T
        return low * len(self.clips) + high


def _pool(clips: Sequence[Clip], entries: Iterable[EpisodeEntry], folds: int) -> _Pool:
    by_sha256 = {entry.sha256: entry for entry in entries}
    own = [by_sha256[clip.rollout] for clip in clips]
    return _Pool(
        clips=clips,
        episode=_numbered([entry.sha256 for entry in own]),
        command=_numbered([entry.meta.command for entry in own]),
        policy=_numbered([entry.meta.policy_sha256 for entry in own]),
        fold=np.array([fold_of(entry.sha256, folds) for entry in own], dtype=int),
    )


def _numbered(facts: Sequence[Hashable]) -> np.ndarray:
    numbers: dict[Hashable, int] = {}
    return np.array([numbers.setdefault(f, len(numbers)) for f in facts], dtype=int)


def _candidates(
    pool: _Pool, known_pairs: Iterable[Pair], count: int, rng: np.random.Generator
) -> np.ndarray:
    """Up to `count` admissible pairs [K, 2], drawn at random.

    Two episodes meet in a second candidate only when all have met in one, and pairs
    within a fold come before pairs across folds.
    """
    pairs = np.stack(np.triu_indices(len(pool.clips), 1), axis=1)
    left, right = pairs.T
    same_command = pool.command[left] == pool.command[right]
    pairs = pairs[same_command & (pool.episode[left] != pool.episode[right])]
    if len(pairs) == 0:
        raise RewardError(_nothing_to_compare(pool))
    pairs = pairs[~_known(pool, pairs, known_pairs)]

    same_policy = pool.policy[pairs[:, 0]] == pool.policy[pairs[:, 1]]
    # The smallest of such times are a draw without replacement by weight.
    times = rng.exponential(size=len(pairs))
    pairs = pairs[np.argsort(times / np.where(same_policy, SAME_POLICY_WEIGHT, 1.0))]
    meetings = _occurrence(pool.codes(pairs, pool.episode))
    pairs = pairs[np.lexsort((pool.crosses_folds(pairs), meetings))][:count]

    swapped = rng.random(len(pairs)) < 0.5
    return np.where(swapped[:, None], pairs[:, ::-1], pairs)


def _known(pool: _Pool, pairs: np.ndarray, known_pairs: Iterable[Pair]) -> np.ndarray:
    """[K] bool: pairs asked already, in either order."""
    index = {clip: position for position, clip in enumerate(pool.clips)}
    known = [
        (index[pair.a], index[pair.b])
        for pair in known_pairs
        if pair.a in index and pair.b in index
    ]
    everything = np.arange(len(pool.clips))
    asked = pool.codes(np.array(known, dtype=int).reshape(-1, 2), everything)
    return np.isin(pool.codes(pairs, everything), asked)


def _occurrence(codes: np.ndarray) -> np.ndarray:
    """How many equal codes [K] stand before each."""
    order = np.argsort(codes, kind="stable")
    _, firsts, counts = np.unique(codes[order], return_index=True, return_counts=True)
    occurrence = np.empty_like(order)
    occurrence[order] = np.arange(len(codes)) - np.repeat(firsts, counts)
    return occurrence


def _diverse(
    candidates: np.ndarray, order: np.ndarray, episode: np.ndarray
) -> list[int]:
    """Rows of `candidates` [K, 2] in `order`, without look-alikes.

    No two episodes meet twice. Rows with a clip that came before are put last.
    """
    met: set[frozenset[int]] = set()
    seen: set[int] = set()
    chosen: list[int] = []
    for repeats_allowed in (False, True):
        for row in order.tolist():
            clips = set(candidates[row].tolist())
            meeting = frozenset(episode[candidates[row]].tolist())
            if meeting in met or (clips & seen and not repeats_allowed):
                continue
            met.add(meeting)
            seen |= clips
            chosen.append(row)
    return chosen


def _nothing_to_compare(pool: _Pool) -> str:
    return (
        f"no two of {len(pool.clips)} clips come from different episodes under one "
        f"command ({len(set(pool.episode))} episodes, {len(set(pool.command))} "
        "commands); record more episodes with `gaitpref record`, with fewer commands"
    )
