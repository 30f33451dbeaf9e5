"""A sum of curves, one for every descriptor, of which the answers pick few.

A wish about a walk that is there already is about one or two habits, and hardly ever a
straight line: a trunk carried *so* low, one foot held *so* high. The reward of a step
is a sum of smooth curves, one of each descriptor, of which each member takes those its
answers speak for (`rewardmodel.forward`). All others are nothing, however many
descriptors there are, so this model sees the legs one by one and the stride rate too.

Shapes: M ensemble members, B pairs, T steps, D descriptors, G curves (D and the stride
rate's), W weights of a curve, P = G W.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from .cfg import FitCfg, SparseCfg
from .clips import PAST_STEPS, mean_over
from .descriptors import TOLD, names_seen, quadratic_seen
from .evidence import ERROR_SHARES, erring, evidence, expected_share
from .forward import chosen_curves
from .history import since_start
from .legs import CONTACTS, SINGLE
from .linear import MIN_SPREAD
from .normaliser import Normaliser
from .training import TrainingPairs, bootstrap_counts

_CENTRES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of the bumps a curve is made of besides a straight line, on the judged range, each as
wide as they are apart."""
_WEIGHTS = 1 + len(_CENTRES)
_LEAST_STEPS = 20
"""The fewest steps a count of lift-offs is divided by: early in an episode one is no
rate."""
_RATES = (0.5, 1.75)
"""Range of the stride rate, in its median: a foot that chatters on the ground has many
times the rate of a walk, and on a range up to there all walks are alike."""
_RANGE_QUANTILE = 0.01
"""Judged steps left out at either end of the range of a descriptor. Beyond it a curve
is flat: from a crouch nobody was shown, no answer says whether it is too low."""
_ROOT_FROM = 0.01
"""Added to a share of the judged range before its root is taken."""
_CONTACTS = tuple(
    index
    for index, name in enumerate(names_seen("legs"))
    if name.startswith("contact_")
)
_SINGLE = tuple(
    index
    for index, name in enumerate(names_seen("legs"))
    if name in {item.name for item in (*CONTACTS, *SINGLE)}
)
_TOLD = tuple(
    index
    for index, name in enumerate(names_seen("legs"))
    if name in (*TOLD, "forward_speed", "leftward_speed", "yaw_rate")
    or name.startswith("foot_speed")
)
"""What a command says. Over a stride the feet go as fast as the robot does."""
_SINGLES_PRICE = 10.0
"""Logarithm of the odds against single legs before any answer: fits of wishes about all
legs alike gained up to 8, of one about one foot 21 from 73 answers."""
_AT_ONCE = 64
"""Pairs whose steps are looked at together, some 20 MB."""


class SparseScorer(nn.Module):
    """Weights of all members over the curves of all descriptors."""

    history_steps = PAST_STEPS

    def __init__(self, num_members: int, num_descriptors: int) -> None:
        super().__init__()
        self.weights: Tensor
        self.rate_mean: Tensor
        self.rate_std: Tensor
        self.judged: Tensor
        """[2, G] the range of each descriptor in the judged clips"""
        self.quadratic: Tensor
        """[G] bool, what is laid out by its root"""
        total = (num_descriptors + 1) * _WEIGHTS
        self.register_buffer("weights", torch.zeros(num_members, total))
        self.register_buffer("rate_mean", torch.zeros(()))
        self.register_buffer("rate_std", torch.ones(()))
        self.register_buffer("judged", torch.zeros(2, num_descriptors + 1))
        quadratic = torch.tensor([*quadratic_seen("legs"), False])
        self.register_buffer("quadratic", quadratic, persistent=False)

    def look_at(self, pairs: TrainingPairs) -> None:
        """Take from `pairs` what standardises the stride rate, and what was judged."""
        rate = stride_rate(
            pairs.steps, scored=pairs.scored, before=pairs.lift_offs_before
        )[pairs.scored]
        std, mean = torch.std_mean(rate, correction=0)
        self.rate_mean.copy_(mean)
        self.rate_std.copy_(std if std > 1e-6 else torch.ones(()))
        low, high = (share * rate.median() for share in _RATES)
        rate = (rate.clamp(low, high) - self.rate_mean) / self.rate_std
        seen = torch.cat([pairs.scored_steps, rate[:, None]], dim=-1).sort(dim=0).values
        last = len(seen) - 1
        ends = [round(share * last) for share in (_RANGE_QUANTILE, 1 - _RANGE_QUANTILE)]
        self.judged.copy_(seen[ends])

    def seen(
        self,
        steps: Tensor,
        starts: Tensor | None = None,
        *,
        scored: Tensor | None = None,
        before: Tensor | None = None,
    ) -> Tensor:
        """[..., T, G] what has a curve, for standardised sequences [..., T, D]: 0 and 1
        are the ends of what was judged, and nothing goes beyond."""
        return self.places(steps, starts, scored=scored, before=before).clamp(0, 1)

    def places(
        self,
        steps: Tensor,
        starts: Tensor | None = None,
        *,
        scored: Tensor | None = None,
        before: Tensor | None = None,
    ) -> Tensor:
        """The same, and how far beyond what was judged. Of squares it is the root, as
        nearly all of a gait would lie at the low end of its curve."""
        rate = stride_rate(steps, starts, scored=scored, before=before)
        rate = (rate - self.rate_mean) / self.rate_std
        return self._on_range(torch.cat([steps, rate[..., None]], dim=-1))

    @property
    def average(self) -> Tensor:
        """[G] the same of a step that is average in everything."""
        return self._on_range(torch.zeros_like(self.judged[0])).clamp(0, 1)

    def agreed(self) -> SparseScorer:
        """What is paid: one member whose curves are the mean ones, each the lower the
        fewer members have it.

        A curve that few answers more or less bring and take away stands for another: a
        policy whose rate of steps is right can still have more lift-offs. How often
        something is chosen from resampled answers tells what is there from what fits by
        chance (stability selection, Meinshausen and Bühlmann 2010). Where all who have
        a curve are of one mind, the share of them is what is left of the mean by least
        squares: its square beside its square and the members' variance.
        """
        weights = self.weights.unflatten(1, (-1, _WEIGHTS))
        share = (weights != 0).any(dim=-1).to(weights.dtype).mean(dim=0)
        one = SparseScorer(1, len(self.quadratic) - 1)
        one.weights = (weights.mean(dim=0) * share[:, None]).flatten()[None]
        one.rate_mean, one.rate_std = self.rate_mean, self.rate_std
        one.judged, one.quadratic = self.judged, self.quadratic
        return one

    @property
    def heights(self) -> Tensor:
        """[G] how much each curve, the stride rate's last, makes of the judged range:
        between its highest and its lowest point, in the mean over the members."""
        shares = torch.linspace(0, 1, 2 * len(_CENTRES) - 1, device=self.judged.device)
        worth = self.along(shares[:, None].expand(-1, self.judged.shape[1])).mean(dim=0)
        return worth.amax(dim=0) - worth.amin(dim=0)

    def forward(
        self,
        steps: Tensor,
        starts: Tensor | None = None,
        *,
        scored: Tensor | None = None,
        before: Tensor | None = None,
    ) -> Tensor:
        """Raw rewards [M, ..., T] of standardised sequences [..., T, D], as in
        `stride_rate`."""
        return self.paid(self.seen(steps, starts, scored=scored, before=before))

    def paid(self, seen: Tensor) -> Tensor:
        """Raw rewards [M, ..., T] for what `seen` gives, [..., T, G]."""
        weights = self.weights.unflatten(1, (-1, _WEIGHTS))
        used = weights.abs().sum(dim=(0, 2)) > 0
        parts = curves(seen[..., used])
        return (parts @ weights[:, used].flatten(1).mT).movedim(-1, 0)

    def along(self, shares: Tensor) -> Tensor:
        """What each curve adds to the raw reward, [M, K, G], at `shares` [K, G] of the
        judged range."""
        return self.at(self._laid_out(shares.clamp(0, 1)))

    def at(self, seen: Tensor) -> Tensor:
        """The same at places [K, G] as `seen` gives them."""
        weights = self.weights.unflatten(1, (-1, _WEIGHTS))
        parts = curves(seen).unflatten(1, (-1, _WEIGHTS))
        return (parts * weights[:, None]).sum(dim=-1)

    def _on_range(self, standardised: Tensor) -> Tensor:
        low, high = self.judged
        return self._laid_out((standardised - low) / (high - low).clamp_min(1e-6))

    def _laid_out(self, shares: Tensor) -> Tensor:
        return torch.where(self.quadratic, _root(shares.clamp_min(0)), shares)


def _root(shares: Tensor) -> Tensor:
    """Of shares from 0 on; 1 stays 1, and it is no steeper at 0 than a gradient
    bears."""
    low, high = _ROOT_FROM**0.5, (1 + _ROOT_FROM) ** 0.5
    return ((shares + _ROOT_FROM).sqrt() - low) / (high - low)


def curves(seen: Tensor) -> Tensor:
    """Lines and bumps [..., G W] of descriptors [..., G] on their judged range."""
    seen = seen[..., None]
    off = (seen - seen.new_tensor(_CENTRES)) / (_CENTRES[1] - _CENTRES[0])
    bumps = (-0.5 * off.square()).exp()
    return torch.cat([seen, bumps], dim=-1).flatten(-2)


def stride_rate(
    steps: Tensor,
    starts: Tensor | None = None,
    *,
    scored: Tensor | None = None,
    before: Tensor | None = None,
) -> Tensor:
    """[..., T] strides per step of standardised `steps` [..., T, D], over the last
    second of the episode at hand: lift-offs of all feet, by four.

    Args:
        steps: Sequences.
        starts: [..., T] bool, first steps of episodes; None for clips, which begin in
            the middle of a walk.
        scored: [..., T] bool, steps of the clips that count, padding behind them;
            None where all do.
        before: [..., L] lift-offs before the clips, as of `ClipBatch`; None where
            nobody knows them.
    """
    down = steps[..., list(_CONTACTS)]
    # However standardised, a contact takes two values, some deviations apart.
    lifted = (down[..., :-1, :] - down[..., 1:, :] > 0.5).float().sum(dim=-1)
    if before is not None:
        begun = before.isfinite()
        lifted = torch.cat([torch.where(begun, before, 0.0), lifted], dim=-1)
        first = torch.zeros_like(lifted, dtype=torch.bool)
        first[..., : begun.shape[-1]] = begun & (begun.cumsum(dim=-1) == 1)
        return _over_the_last_second(lifted, first)[..., begun.shape[-1] - 1 :]
    lifted = functional.pad(lifted, (1, 0))
    if starts is not None:
        return _over_the_last_second(lifted.masked_fill(starts, 0.0), starts)
    rate = _over_the_last_second(lifted, None)
    if rate.shape[-1] >= PAST_STEPS:
        # Its first whole second tells the rate of all before it; few steps would not.
        last = PAST_STEPS - 1
        early, whole = rate[..., :last], rate[..., last, None]
        if scored is not None:
            whole = torch.where(scored[..., last, None], whole, early)
        rate[..., :last] = whole
    return rate


def _over_the_last_second(lifted: Tensor, starts: Tensor | None) -> Tensor:
    """[..., T] strides per step of lift-offs [..., T], of which none is looked at that
    lies before the newest of `starts` [..., T]."""
    counted = functional.pad(lifted.cumsum(dim=-1), (1, 0))
    time = torch.arange(lifted.shape[-1], device=lifted.device)
    first = (time - PAST_STEPS + 1).clamp_min(0).expand(lifted.shape)
    if starts is not None:
        first = torch.maximum(first, since_start(starts))
    strides = (counted[..., 1:] - counted.gather(-1, first)) / 4
    return strides / (time - first + 1).clamp_min(_LEAST_STEPS)


def fit_sparse(
    pairs: TrainingPairs, cfg: FitCfg, *, generator: torch.Generator
) -> SparseScorer:
    """Fit each member to its own bootstrap of standardised `pairs`."""
    scorer = SparseScorer(cfg.sparse.num_members, pairs.steps.shape[-1])
    scorer.look_at(pairs)
    inputs, units = scaled_curves(scorer, pairs)
    counts = bootstrap_counts(cfg.sparse.num_members, len(pairs), generator=generator)
    theta, _ = relevant(inputs, pairs, counts.double(), cfg)
    scorer.weights.copy_(theta / units)
    return scorer


def scaled_curves(scorer: SparseScorer, pairs: TrainingPairs) -> tuple[Tensor, Tensor]:
    """Differences [B, P] of the clips' curves in float64, and what they are divided by.

    A curve's straight line and its bumps, all together, shift a pair by the usual
    amount for one unit of weight.
    """
    parts = []
    for chosen in torch.arange(len(pairs)).split(_AT_ONCE):
        part = pairs.subset(chosen)
        seen = scorer.seen(part.steps, scored=part.scored, before=part.lift_offs_before)
        values = curves(seen).mT
        left, right = mean_over(values, part.scored[..., None, :])
        parts.append((left - right).double())
    difference = torch.cat(parts)
    squares = difference.square().mean(dim=0).unflatten(0, (-1, _WEIGHTS))
    line, bumps = squares[:, :1], squares[:, 1:].sum(dim=1, keepdim=True)
    units = torch.cat([line, bumps.expand(-1, len(_CENTRES))], dim=1).sqrt()
    units = units.clamp_min(MIN_SPREAD).flatten()
    return difference / units, units


def standardised_curves(pairs: TrainingPairs) -> tuple[Tensor, TrainingPairs]:
    """What `scaled_curves` gives for raw `pairs`, and these standardised by their own
    steps."""
    normaliser = Normaliser(pairs.steps.shape[-1]).fit(pairs.scored_steps)
    standardised = pairs.transformed(normaliser)
    scorer = SparseScorer(1, pairs.steps.shape[-1])
    scorer.look_at(standardised)
    inputs, _ = scaled_curves(scorer, standardised)
    return inputs, standardised


def relevant(
    inputs: Tensor, pairs: TrainingPairs, counts: Tensor, cfg: FitCfg
) -> tuple[Tensor, Tensor]:
    """Weights [M, P] of the curves that matter, and their variances [M, P].

    Args:
        inputs: [B, P] float64 scaled differences of the clips' curves.
        pairs: Their answers and falls.
        counts: [M, B] float64, how often a member sees an answer.
        cfg: The likelihood of an answer, and which curves may matter.
    """
    curves = inputs.unflatten(1, (-1, _WEIGHTS))
    allowed = curves.abs().sum(dim=(0, 2)) > 0
    if not cfg.sparse.single_legs:
        allowed[list(_SINGLE)] = False
    if not cfg.sparse.told:
        allowed[list(_TOLD)] = False
    return chosen_curves(curves, pairs, counts, cfg, allowed=allowed.nonzero()[:, 0])


def find(pairs: TrainingPairs, cfg: FitCfg) -> FitCfg:
    """`cfg` with what described `pairs` speak for put in, done adapting: the share of
    random answers, and whether single legs matter.

    To weights that cannot say what was wanted, all answers look random; curves that can
    say it tell the raters' errors from their own. Among so many curves of single legs
    some always fit a few answers, so the evidence for them has to be overwhelming.
    """
    inputs, standardised = standardised_curves(pairs.seen_by(cfg))
    tried: dict[tuple[SparseCfg, float], float] = {}
    for sparse in _open_settings(cfg.sparse):
        price = _SINGLES_PRICE if sparse.single_legs else 0.0
        for share in ERROR_SHARES:
            own = erring(standardised, cfg, share)
            counts = inputs.new_ones(1, len(own))
            settings = replace(cfg, sparse=sparse)
            theta, variance = relevant(inputs, own, counts, settings)
            found = evidence(inputs, own, cfg, 1 / variance[0], start=theta)
            tried[sparse, share] = expected_share(cfg, share) + found - price
    sparse, share = max(tried, key=lambda settings: tried[settings])
    return replace(cfg, adapt=False, error_share=share, sparse=sparse)


def _open_settings(cfg: SparseCfg) -> Iterator[SparseCfg]:
    """`cfg` with what it leaves open put in, in every way."""
    both = (False, True)
    for singles in both if cfg.single_legs is None else (cfg.single_legs,):
        yield replace(cfg, single_legs=singles)
