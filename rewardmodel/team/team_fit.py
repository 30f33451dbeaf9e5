"""Fits the reward of a team to answers about the team alone.

Nobody says which of both robots a clip was better for: the same weights count for
either, and what differs between them in many clips tells whose it was.

Shapes: B pairs, T steps, R = 2 robots, F + V columns of a row, D descriptors of a
robot, P of the pair, K steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.team_rows import team_rows
from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.answers.likelihood import Errors
from rewardmodel.cfg import FitCfg
from rewardmodel.descriptors.habits import TOLD, named
from rewardmodel.descriptors.normaliser import Normaliser, fill_missing
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES, describe
from rewardmodel.errors import RewardError
from rewardmodel.fitting.tables import fit_measured
from rewardmodel.linear.linear import of_one_piece
from rewardmodel.prepared.described import DescribedPairs
from rewardmodel.prepared.prepared import Prepared, PreparedClips

from .pair_habits import PAIR_NAMES, describe_pair
from .team_reward import TeamReward, Walkers, either_fell

_MIN_STD = 1e-4
"""Raw rewards, in logits, that vary less than this are no opinion."""

_OWN_STRENGTH = 0.1
"""How strong opinions about how a robot moves are expected to be beside others."""
TeamRows = Callable[[str], np.ndarray]
"""Gives the rows [T, R, F + V] of a whole episode, by its hash."""


class _AsTheyAre(PreparedClips):
    """Descriptors that are standardised already, robot by robot."""

    @cached_property
    def normaliser(self) -> Normaliser:
        return Normaliser(self._described.steps.shape[-1])


class PreparedTeams(Prepared):
    """Means of both robots, beside the pair; every model sees all of it."""

    @property
    def opinions(self) -> Tensor:
        """A team is judged by what is between its robots, and by whether either does
        what it is told; that one which walks also rocks and slips, and one which stands
        does not, must not become the reason."""
        told = torch.cat([named(TOLD), torch.zeros(len(PAIR_NAMES), dtype=torch.bool)])
        strength = torch.ones(len(told))
        strength[: len(DESCRIPTOR_NAMES)][~named(TOLD)] = _OWN_STRENGTH
        return of_one_piece(strength, told)

    @classmethod
    def of(cls, described: DescribedPairs, pool: None = None) -> PreparedTeams:  # pyright: ignore[reportIncompatibleMethodOverride]
        return cls(described, _AsTheyAre(described))

    def seen_by(self, sight: str) -> PreparedTeams:
        return self


def rows_in(datasets: Sequence[Dataset]) -> TeamRows:
    """Reads rows of teams out of data sets, each episode once.

    Raises, when it is called:
        DatasetError: an episode is in none of them, or shows one robot alone.
    """
    kept: dict[str, np.ndarray] = {}

    def rows(sha256: str) -> np.ndarray:
        if sha256 not in kept:
            held = [d for d in datasets if d.holds(sha256)] or [datasets[0]]
            kept[sha256] = team_rows(held[0].read(sha256))
        return kept[sha256]

    return rows


def fit_team(
    pairs: AnsweredPairs,
    rows: TeamRows,
    *,
    seed: int,
    walkers: Walkers | None = None,
    advance: Callable[[], None] = lambda: None,
) -> TeamReward:
    """Fit a linear reward to answers about teams.

    Args:
        pairs: What was answered; its clips name episodes of teams.
        rows: Reads them.
        seed: Bootstrap draws.
        walkers: Who is seen in them, where it will be asked of others.
        advance: Called after each model, of `models_fitted(FitCfg())`.

    Raises:
        RewardError: too few answers prefer a team, or one clip shows no steps.
        DatasetError: a clip shows one robot alone.
    """
    if pairs.too_little:
        raise RewardError(pairs.too_little)
    cfg = FitCfg()
    # What robots do is expected to be good or bad of nobody before any answer.
    cfg = replace(cfg, linear=replace(cfg.linear, unsteady_logit=0.0))
    left, right = (
        [torch.from_numpy(_clip_rows(names[side], rows)) for names in pairs.clips]
        for side in (0, 1)
    )
    clips = [*left, *right]
    scored = [clip[:, :, :].isfinite().all(dim=-1).all(dim=-1) for clip in clips]
    own, pair = _normalisers(clips, scored)
    steps = [_seen(clip, own, pair) for clip in clips]
    stands = [~either_fell(clip) for clip in clips]
    prepared = PreparedTeams.of(_described(steps, stands, pairs, cfg))
    fitted = fit_measured(
        prepared,
        pairs.episodes,
        cfg,
        seed=seed,
        at_random=pairs.at_random,
        advance=advance,
    )
    weights = fitted.scorer.linear_weights
    assert weights is not None
    judged = prepared.described.scored_steps @ weights.mean(dim=0)
    std = float(judged.std(correction=0))
    return TeamReward(
        own=own,
        pair=pair,
        weights=weights,
        scale=std if std > _MIN_STD else 1.0,
        report=fitted.report,
        answers_sha256=pairs.answers_sha256,
        episodes=frozenset(name for names in pairs.episodes for name in names),
        walkers=walkers,
    )


def _clip_rows(key: str, rows: TeamRows) -> np.ndarray:
    """The rows [T, R, F + V] of the clip that is called `key`."""
    sha256, _, place = key.partition(":")
    start, steps = (int(number) for number in place.split("+"))
    return np.array(rows(sha256)[Clip(sha256, start, steps).rows])


def _normalisers(
    clips: Sequence[Tensor], scored: Sequence[Tensor]
) -> tuple[Normaliser, Normaliser]:
    """Of one robot, over the steps of both alike, and of the pair."""
    steps = torch.cat([clip[kept] for clip, kept in zip(clips, scored, strict=True)])
    own = describe(steps).flatten(0, 1)
    pair = describe_pair(steps)
    return (
        Normaliser(own.shape[-1]).fit(own),
        Normaliser(pair.shape[-1]).fit(pair),
    )


def _seen(clip: Tensor, own: Normaliser, pair: Normaliser) -> Tensor:
    """Descriptors [T, D + P] of a clip: the mean of both robots, and the pair."""
    of_each = fill_missing(own(describe(clip))).mean(dim=-2)
    return torch.cat([of_each, fill_missing(pair(describe_pair(clip)))], dim=-1)


def _described(
    steps: Sequence[Tensor],
    stands: Sequence[Tensor],
    pairs: AnsweredPairs,
    cfg: FitCfg,
) -> DescribedPairs:
    """The answers, clips padded to one length; `stands` [T] of each clip are the steps
    at which neither robot fell."""
    count = len(pairs)
    sides, scored = (
        torch.nn.utils.rnn.pad_sequence(list(each), batch_first=True).unflatten(
            0, (2, count)
        )
        for each in (steps, stands)
    )
    fell = torch.tensor([not bool(each.all()) for each in stands]).view(2, count)
    fell = fell.float()
    return DescribedPairs(
        steps=sides,
        scored=scored,
        fall_lead=cfg.fall_logit * (fell[1] - fell[0]),
        target=pairs.target,
        errors=Errors.alike(cfg.error_share, count, tie_threshold=cfg.tie_threshold),
    )
