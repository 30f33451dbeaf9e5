"""Is a policy still where people have judged? Distances in descriptor space.

The labelled clips form clusters (standing, stumbling, walking), which one ellipsoid
would not fit; the distance to the nearest labelled piece makes no such assumption. How
far is far is told by the labelled pieces themselves, each compared with those of other
episodes.

Shapes: P labelled pieces, Q pieces asked about, K steps of a piece, T steps, N
sequences, F features, D descriptors.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.descriptors.normaliser import fill_missing
from rewardmodel.models.model import RewardModel

PIECE_STEPS = 12
"""Control steps of a piece: about half a stride. Robots that fall all the time leave
longer ones no chance to be whole."""
FAR_QUANTILE = 0.95
"""Labelled pieces that are nearer to their own kind than a far piece is."""
RANGE_QUANTILE = 0.01
"""Labelled pieces left out at either end of the range of a habit."""


@dataclass(frozen=True)
class Drift:
    """How far pieces are from the labelled ones."""

    share_far: float
    """Share farther than `FAR_QUANTILE` of the labelled pieces are from their own kind;
    0.05 is no drift at all."""
    quantile: float
    """Share of the labelled pieces that are nearer to their own kind than the median
    piece here."""
    share_overpaid: float
    """Share that the reward pays more than any labelled piece: it extrapolates."""
    extrapolated: float
    """What the mean piece is paid, in standard deviations of the reward, for what lies
    beyond the judged range of some habit."""
    pieces: int

    @property
    def share_beyond(self) -> float:
        """The larger share: far away, or paid for what no judged piece has."""
        return max(self.share_far, self.share_overpaid)


class Support:
    """The labelled pieces, and how near they are to one another."""

    def __init__(self, model: RewardModel, pieces: Tensor, episode: Tensor) -> None:
        """Take descriptors [P, D] as `model` sees them, and whose they are [P]."""
        self._model = model
        self._pieces = pieces
        self._most_paid = self._paid(pieces).amax() if len(pieces) else torch.inf
        ends = (RANGE_QUANTILE, 1 - RANGE_QUANTILE)
        self._range = [pieces.quantile(end, dim=0) for end in ends if len(pieces)]
        distance = torch.cdist(pieces, pieces)
        distance[episode[:, None] == episode] = torch.inf
        own = distance.amin(dim=1)
        self._own = own[own.isfinite()].sort().values

    @property
    def far(self) -> float:
        """Distance beyond which a piece is far, in standard deviations."""
        if not len(self._own):
            return float("inf")
        return float(self._own.quantile(FAR_QUANTILE))

    def drift(self, features: Tensor, valid: Tensor) -> Drift | None:
        """How far rows are; None where no piece is whole.

        Args:
            features: [T, N, F].
            valid: [T, N] bool, steps that exist. Pieces with one that does not are
                left out.
        """
        pieces, _ = _cut(self._model, features, valid)
        if not len(pieces) or not len(self._own):
            return None
        distances = torch.cdist(pieces, self._pieces).amin(dim=1)
        median = distances.median()
        paid, usual = self._paid(pieces), self._paid(pieces.clamp(*self._range))
        return Drift(
            share_far=float((distances > self.far).float().mean()),
            quantile=float((self._own < median).float().mean()),
            share_overpaid=float((paid > self._most_paid).float().mean()),
            extrapolated=float((paid - usual).mean() / self._model.reward_std),
            pieces=len(distances),
        )

    def _paid(self, pieces: Tensor) -> Tensor:
        """Raw reward [Q] of the mean step of pieces [Q, D], as if it lasted."""
        return self._model.payer.lasting(pieces).mean(dim=0)


def support_of(pairs: AnsweredPairs, model: RewardModel) -> Support:
    """The support of answered pairs, as `model` sees them."""
    numbers: dict[str, int] = {}
    pieces, episodes = [], []
    for clips, side in ((pairs.left, 0), (pairs.right, 1)):
        names = [episode[side] for episode in pairs.episodes]
        ids = torch.tensor([numbers.setdefault(n, len(numbers)) for n in names])
        rows = clips.features.transpose(0, 1)
        cut, sequence = _cut(model, rows, clips.scored.mT)
        pieces.append(cut)
        episodes.append(ids[sequence])
    return Support(model, torch.cat(pieces), torch.cat(episodes))


def _cut(model: RewardModel, features: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """Means [Q, D] of whole pieces as `model` sees them, and their sequence."""
    steps, sequences = valid.shape
    whole = steps // PIECE_STEPS
    shape = (whole, PIECE_STEPS, sequences)
    kept = valid[: whole * PIECE_STEPS].reshape(shape).all(dim=1)  # [pieces, N]
    # A feature that hardware does not tell is no distance to anything.
    described = fill_missing(model.standardised(features[: whole * PIECE_STEPS]))
    means = described.reshape(*shape, described.shape[-1]).mean(dim=1)
    sequence = torch.arange(sequences).expand(whole, -1)
    return means[kept], sequence[kept]
