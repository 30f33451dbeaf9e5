"""From recorded episodes to the questions of a round."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from data.answers.answer_records import Pair
from data.answers.strategy_names import NEEDS_MODEL, StrategyName
from data.datasets.dataset import Dataset, EpisodeEntry
from data.episodes.clips import Clip, cut_clips
from data.errors import GaitprefError
from rewardmodel.acquisition import Strategy, Uniform, asked_for, choose_pairs, in_step
from rewardmodel.acquisition.choose import Apart, NothingToCompare, ToldApart
from rewardmodel.errors import RewardError
from rewardmodel.models.model import RewardModel

from .strategies import make_strategy

LONGEST_CLIP_S = 60.0
"""Nobody judges more at a glance."""
_LOOKS = 5
"""How often others are chosen in place of pairs that look alike once in step."""


@dataclass(frozen=True, kw_only=True)
class ClipCfg:
    """How episodes are cut into clips."""

    clip_s: float = 1.2
    """Length of a clip."""
    min_clip_s: float = 0.4
    """Shortest clip that ends in a fall."""
    stride_s: float = 0.6
    """Time from the start of a clip to that of the next."""

    def __post_init__(self) -> None:
        if not 0.0 < self.clip_s <= LONGEST_CLIP_S:
            raise GaitprefError(
                f"--clip-s must lie in (0, {LONGEST_CLIP_S:g}], got {self.clip_s:g}"
            )

    @classmethod
    def of(cls, clip_s: float) -> ClipCfg:
        """Clips of this length that overlap by half of it."""
        shortest_s, stride_s = round(clip_s / 3, 6), round(clip_s / 2, 6)
        return cls(clip_s=clip_s, min_clip_s=shortest_s, stride_s=stride_s)


def clips_of(entries: Sequence[EpisodeEntry], cfg: ClipCfg) -> list[Clip]:
    """Clips of all `entries`, whatever their control rates."""
    clips: list[Clip] = []
    for entry in entries:
        dt_s = entry.meta.control_dt_s
        clips += cut_clips(
            [entry],
            steps=max(1, round(cfg.clip_s / dt_s)),
            stride=max(1, round(cfg.stride_s / dt_s)),
            min_steps=max(1, round(cfg.min_clip_s / dt_s)),
        )
    return clips


def ask(
    dataset: Dataset,
    entries: Sequence[EpisodeEntry],
    cfg: ClipCfg,
    count: int,
    *,
    known: Sequence[Pair],
    model: RewardModel | None,
    round_number: int,
    uniform_share: float,
    strategy: StrategyName = "disagreement",
    told_apart: ToldApart | None = None,
    rng: np.random.Generator,
) -> list[Pair]:
    """Choose `count` pairs: a share at random, the others by `strategy`.

    Robots that walk begin with the same foot: see `in_step`.
    A strategy that needs `model` chooses at random as long as there is none. What
    `told_apart` does not mark is asked only where nothing else is left.

    Raises:
        RewardError: the episodes do not give that many pairs.
    """
    _require_long_enough(entries, cfg)
    clips = clips_of(entries, cfg)
    blind = model is None and strategy in NEEDS_MODEL
    at_random = count if blind else math.ceil(uniform_share * count)
    plan: list[tuple[int, Strategy]] = [(at_random, Uniform())]
    if not blind:
        chooser = make_strategy(strategy, model, dataset.clip_features)
        plan.append((count - at_random, chooser))
    by_sha256 = {entry.sha256: entry for entry in entries}
    shown = partial(
        in_step,
        entries=by_sha256,
        clip_rows=dataset.clip_features,
        # Half a stride: the clip stays nearer to its own place than to the next one's.
        reach_s=cfg.stride_s / 2,
    )
    chosen: list[Pair] = []
    for wanted, chooser in plan:
        choose = partial(
            choose_pairs,
            entries,
            clips,
            strategy=chooser,
            round=round_number,
            least_candidates=1500 if chooser.name == "information" else 0,
            rng=rng,
        )
        plain: list[Pair] = []
        if told_apart is not None:
            before = [*known, *chosen]
            plain = _told_apart(choose, wanted, told_apart, shown, known=before)
        before = [*known, *chosen, *plain]
        chosen += plain + _as_many(choose, wanted - len(plain), known=before)
    if len(chosen) < count:
        raise RewardError(
            f"{len(entries)} episodes give {len(chosen)} new pairs of equal command, "
            f"{count} are wanted: ask for fewer, or about shorter clips with --clip-s, "
            f"or record more with `{_recorder(entries)} --policy POLICY --dataset "
            f"{dataset.root}`"
        )
    return [shown(pair) for pair in chosen]


def _told_apart(
    choose: Callable[..., list[Pair]],
    wanted: int,
    told_apart: ToldApart,
    shown: Callable[[Pair], Pair],
    *,
    known: list[Pair],
) -> list[Pair]:
    """Up to `wanted` pairs that can still be told apart as they are `shown`."""
    found: list[Pair] = []
    looked_at: list[Pair] = []
    for _ in range(_LOOKS):
        more = _as_many(
            partial(choose, told_apart=told_apart),
            wanted - len(found),
            known=[*known, *looked_at],
        )
        if not more:
            break
        looked_at += more
        clips = [clip for pair in map(shown, more) for clip in (pair.a, pair.b)]
        marks = told_apart(clips, np.arange(len(clips)).reshape(-1, 2))
        found += [pair for pair, mark in zip(more, marks, strict=True) if mark]
    return found


def _as_many(
    choose: Callable[..., list[Pair]], wanted: int, *, known: list[Pair]
) -> list[Pair]:
    """Up to `wanted` pairs.

    Two episodes meet again only where all have met once, and stretches of one episode
    meet only where those of different episodes are used up: clips that lie near each
    other show much the same.

    Raises:
        NothingToCompare: there is none.
    """
    found: list[Pair] = []
    some = bool(known)
    ways: tuple[Apart, ...] = ("episodes", "stretches")
    for apart in ways:
        while len(found) < wanted:
            left = wanted - len(found)
            try:
                more = choose(left, known_pairs=[*known, *found], apart=apart)
            except NothingToCompare:
                if apart == "stretches" and not some:
                    raise
                break
            some = True
            if not more:
                break
            found += more
    return found


def _recorder(entries: Sequence[EpisodeEntry]) -> str:
    """The command that records such episodes."""
    of_teams = any(entry.meta.is_team for entry in entries)
    return "gaitpref team record" if of_teams else "gaitpref record"


def _require_long_enough(entries: Sequence[EpisodeEntry], cfg: ClipCfg) -> None:
    longest = max(entries, key=lambda entry: entry.num_steps, default=None)
    # Clips are whole control steps long.
    if longest is None or longest.num_steps >= round(
        cfg.clip_s / longest.meta.control_dt_s
    ):
        return
    raise RewardError(
        f"none of {len(entries)} episodes holds a clip of {cfg.clip_s:g} s, the "
        f"longest lasts {longest.num_steps * longest.meta.control_dt_s:g} s: ask about "
        "shorter clips with --clip-s, or record longer ones with "
        f"`{_recorder(entries)} --episode-s`"
    )


def with_known_answer(
    entries: Sequence[EpisodeEntry],
    cfg: ClipCfg,
    count: int,
    *,
    known: Sequence[Pair],
    round_number: int,
    rng: np.random.Generator,
) -> list[Pair]:
    """Up to `count` pairs under one command of which one robot falls, and one does not.

    Such a pair asks nothing about gaits: its answer is known, and measures the rater.
    Each robot that fell comes once at most.
    """
    by_sha256 = {entry.sha256: entry for entry in entries}
    clips = clips_of(entries, cfg)
    taken = {frozenset((pair.a, pair.b)) for pair in known}
    chosen: list[Pair] = []
    for index in rng.permutation(len(clips)):
        clip, entry = clips[index], by_sha256[clips[index].rollout]
        if len(chosen) == count:
            break
        if entry.end_reason != "terminated" or clip.stop < entry.num_steps:
            continue
        standing = [
            other
            for other in clips
            if by_sha256[other.rollout].end_reason == "truncated"
            and asked_for(by_sha256[other.rollout], other) == asked_for(entry, clip)
            and frozenset((clip, other)) not in taken
        ]
        if not standing:
            continue
        better = standing[rng.integers(len(standing))]
        sides = (better, clip) if rng.random() < 0.5 else (clip, better)
        gold = "a" if sides[0] == better else "b"
        info = {"gold": gold, "because": "the other robot falls"}
        chosen.append(Pair.make(*sides, strategy="gold", round=round_number, info=info))
    return chosen
