"""Which pairs of clips to ask about next: what may be asked, and what is alike.

Shapes: C clips, K candidate pairs (two indices into the clips each).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from data.answers.answer_records import Pair
from data.datasets.dataset import EpisodeEntry
from data.episodes.clips import Clip
from rewardmodel.errors import RewardError
from rewardmodel.measures.held_out import fold_of

from .phase import overlapping
from .strategy import Strategy

MAX_CLIPS = 1000
"""Clips looked at for one batch, drawn at random: all their pairs fit in memory."""
CANDIDATES_PER_PAIR = 10
"""Candidates a strategy rates for every pair that will be asked."""
MIN_FALLS, MAX_FALLS = 0.05, 0.25
"""Share of a round's questions in which one of the two robots falls: most such answers
are known beforehand, so that they must not use up the questions, but a fall is shown
now and then as long as robots fall."""

Apart = Literal["episodes", "stretches"]
"""Where the two clips of a pair come from: different episodes, or stretches of one
episode that do not overlap."""
ToldApart = Callable[[Sequence[Clip], np.ndarray], np.ndarray]
"""Which of pairs [K, 2], indices into the clips, can be told apart: [K] bool."""


def choose_pairs(
    entries: Iterable[EpisodeEntry],
    clips: Sequence[Clip],
    count: int,
    *,
    strategy: Strategy,
    round: int,
    known_pairs: Iterable[Pair] = (),
    least_candidates: int = 0,
    apart: Apart = "episodes",
    told_apart: ToldApart | None = None,
    rng: np.random.Generator,
) -> list[Pair]:
    """Choose up to `count` pairs worth asking about, best first.

    Both clips obey one command and come from different episodes. Within the batch two
    episodes meet at most once, an episode comes twice only when no other is left, and a
    clip only after that: clips of one episode are near-duplicates. Pairs within one
    fold of episodes come first, because only those can be held out when the fit
    measures itself; which clip is left is a coin toss. The share of falls is bounded
    from both sides.

    Args:
        entries: The episodes of `clips`, with their commands.
        clips: Stretches to choose from.
        count: Pairs wanted; fewer come back when there are no more.
        strategy: What makes a candidate worth asking.
        round: Round of the loop, stored with the pairs.
        known_pairs: Pairs asked already, in either order.
        least_candidates: Pairs `strategy` is asked about, however few are wanted.
        apart: `stretches` chooses within episodes instead, which then may come as often
            as they have clips: for logs that are few and long.
        told_apart: Chooses only what it marks.
        rng: Every random draw.

    Raises:
        NothingToCompare: no two clips that are so far apart share a command.
    """
    entries, known_pairs = list(entries), list(known_pairs)
    drawn = [clips[index] for index in rng.permutation(len(clips))[:MAX_CLIPS]]
    pool = _pool(drawn, entries)
    wanted = max(least_candidates, CANDIDATES_PER_PAIR * count)
    candidates = _candidates(pool, known_pairs, wanted, apart, told_apart, rng)
    if len(candidates) == 0:
        return []
    worth = strategy(drawn, candidates, rng)
    crosses = pool.crosses_folds(candidates)
    order = np.lexsort((-worth, crosses))
    once = apart == "episodes"
    rows = _diverse(candidates, order, pool.episode, crosses, once=once)
    decided = pool.fell[candidates].sum(axis=1) == 1
    asked = _decided_before(known_pairs, entries, round)
    return [
        Pair.make(
            *(drawn[clip] for clip in candidates[row]),
            strategy=strategy.name,
            round=round,
            info={"worth": float(worth[row])},
        )
        for row in _with_falls(rows, decided, count, asked=asked)
    ]


class NothingToCompare(RewardError):
    """No two clips that are far enough apart share a command."""


@dataclass(frozen=True, eq=False)
class _Pool:
    """Facts of clips as small whole numbers [C]; equal facts have equal numbers."""

    clips: Sequence[Clip]
    episode: np.ndarray
    command: np.ndarray
    fold: np.ndarray
    fell: np.ndarray
    """Whether a clip ends in a fall."""

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """[C] first step of every clip, and that behind it."""
        starts = np.array([clip.start for clip in self.clips], dtype=int)
        return starts, starts + np.array([clip.steps for clip in self.clips], dtype=int)

    def crosses_folds(self, pairs: np.ndarray) -> np.ndarray:
        """[K] bool: the clips of pairs [K, 2] are of different folds."""
        return self.fold[pairs[:, 0]] != self.fold[pairs[:, 1]]

    def codes(self, pairs: np.ndarray, of: np.ndarray) -> np.ndarray:
        """[K] one number for what `of` [C] says of both clips, in either order."""
        low, high = np.sort(of[pairs], axis=1).T
        return low * len(self.clips) + high


def _pool(clips: Sequence[Clip], entries: Iterable[EpisodeEntry]) -> _Pool:
    by_sha256 = {entry.sha256: entry for entry in entries}
    own = [by_sha256[clip.rollout] for clip in clips]
    return _Pool(
        clips=clips,
        episode=_numbered([entry.sha256 for entry in own]),
        command=_numbered(
            [asked_for(entry, clip) for entry, clip in zip(own, clips, strict=True)]
        ),
        fold=np.array([fold_of(entry.sha256) for entry in own], dtype=int),
        fell=np.array(
            [
                entry.end_reason == "terminated" and clip.stop >= entry.num_steps
                for clip, entry in zip(clips, own, strict=True)
            ],
            dtype=bool,
        ),
    )


def asked_for(entry: EpisodeEntry, clip: Clip) -> Hashable:
    """What the robot was told to do in a clip: equal for equal commands throughout."""
    change_steps = entry.meta.command_change_steps
    return entry.meta.command, change_steps, clip.start if change_steps else 0


def _numbered(facts: Sequence[Hashable]) -> np.ndarray:
    numbers: dict[Hashable, int] = {}
    return np.array([numbers.setdefault(f, len(numbers)) for f in facts], dtype=int)


def _candidates(
    pool: _Pool,
    known_pairs: Iterable[Pair],
    count: int,
    apart: Apart,
    told_apart: ToldApart | None,
    rng: np.random.Generator,
) -> np.ndarray:
    """Up to `count` admissible pairs [K, 2], drawn at random.

    Two episodes meet in a second candidate only when all have met in one, and pairs
    within a fold come before pairs across folds.
    """
    pairs = np.stack(np.triu_indices(len(pool.clips), 1), axis=1)
    left, right = pairs.T
    same_command = pool.command[left] == pool.command[right]
    different = pool.episode[left] != pool.episode[right]
    if apart == "stretches":
        start, stop = pool.bounds
        behind = (stop[left] <= start[right]) | (stop[right] <= start[left])
        different = ~different & behind
    pairs = pairs[same_command & different]
    if len(pairs) == 0:
        raise NothingToCompare(_nothing_to_compare(pool, apart))
    pairs = pairs[~_known(pool, pairs, known_pairs)]
    if told_apart is not None:
        pairs = pairs[told_apart(pool.clips, pairs)]

    pairs = rng.permutation(pairs)
    meetings = _occurrence(pool.codes(pairs, pool.episode))
    pairs = pairs[np.lexsort((pool.crosses_folds(pairs), meetings))][:count]

    swapped = rng.random(len(pairs)) < 0.5
    return np.where(swapped[:, None], pairs[:, ::-1], pairs)


def _known(pool: _Pool, pairs: np.ndarray, known_pairs: Iterable[Pair]) -> np.ndarray:
    """[K] bool: pairs asked already, in either order, of about the same clips."""
    clips_of: dict[str, list[Clip]] = {}
    for clip in pool.clips:
        clips_of.setdefault(clip.rollout, []).append(clip)
    index = {clip: position for position, clip in enumerate(pool.clips)}
    known = [
        (index[a], index[b])
        for pair in known_pairs
        for a in overlapping(pair.a, clips_of.get(pair.a.rollout, ()))
        for b in overlapping(pair.b, clips_of.get(pair.b.rollout, ()))
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
    candidates: np.ndarray,
    order: np.ndarray,
    episode: np.ndarray,
    crosses: np.ndarray,
    *,
    once: bool,
) -> list[int]:
    """Rows of `candidates` [K, 2] in `order`, without look-alikes.

    No two episodes meet twice, if they are to meet `once`. Behind the rows of fresh
    episodes come those of fresh clips, and then the others; pairs across folds, marked
    in `crosses` [K], come last.
    """
    met: set[frozenset[int]] = set()
    seen: set[int] = set()
    seen_episodes: set[int] = set()
    chosen: list[int] = []
    taken: set[int] = set()
    for crossing in (False, True):
        rows = [row for row in order.tolist() if crosses[row] == crossing]
        for repeats in ("none", "episodes", "clips"):
            for row in rows:
                clips = set(candidates[row].tolist())
                meeting = frozenset(episode[candidates[row]].tolist())
                if (
                    (once and meeting in met)
                    or row in taken
                    or (repeats == "none" and meeting & seen_episodes)
                    or (repeats == "episodes" and clips & seen)
                ):
                    continue
                met.add(meeting)
                seen |= clips
                seen_episodes |= meeting
                chosen.append(row)
                taken.add(row)
    return chosen


def _decided_before(
    known_pairs: Iterable[Pair], entries: Iterable[EpisodeEntry], round: int
) -> list[bool]:
    """Whether one of the two robots falls, of each pair the round has asked about."""
    ends = {e.sha256: e.num_steps for e in entries if e.end_reason == "terminated"}

    def falls(clip: Clip) -> bool:
        return clip.stop >= ends.get(clip.rollout, math.inf)

    return [falls(p.a) != falls(p.b) for p in known_pairs if p.round == round]


def _with_falls(
    rows: Sequence[int], decided: np.ndarray, count: int, *, asked: Sequence[bool] = ()
) -> list[int]:
    """Up to `count` of `rows`, in their order, with the right share of falls.

    Args:
        rows: Rows of candidates, best first.
        decided: [K] bool: of the two robots of a candidate, one falls.
        count: Rows wanted.
        asked: The same of what the round has asked before: of a few at a time, the
            least share is less than one.
    """
    falls = [row for row in rows if decided[row]]
    others = [row for row in rows if not decided[row]]
    usual = sum(row in set(falls) for row in rows[:count])
    share_of_all = len(falls) / max(len(rows), 1)
    least = math.floor((len(asked) + count) * min(MIN_FALLS, share_of_all))
    least = min(max(0, least - sum(asked)), count)
    kept = min(max(usual, least), math.ceil(MAX_FALLS * count), len(falls))
    # Where there are no others left, a fall is better than no question.
    kept = max(kept, min(len(falls), count - len(others)))
    taken = {*falls[:kept], *others[: count - kept]}
    return [row for row in rows if row in taken]


def _nothing_to_compare(pool: _Pool, apart: Apart) -> str:
    if apart == "stretches":
        return (
            f"no two of {len(pool.clips)} clips under one command lie apart "
            f"({len(set(pool.episode))} episodes, {len(set(pool.command))} commands); "
            "ask about shorter clips with --clip-s, or record more or longer episodes "
            "with `gaitpref record`"
        )
    return (
        f"no two of {len(pool.clips)} clips come from different episodes under one "
        f"command ({len(set(pool.episode))} episodes, {len(set(pool.command))} "
        "commands); record more episodes with `gaitpref record`, with fewer commands"
    )
