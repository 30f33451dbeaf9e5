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

from .clips import ClipBatch
from .descriptors import describe
from .normaliser import Normaliser
from .pairs import AnsweredPairs

PIECE_STEPS = 24
"""Control steps of a piece: about one stride, and one rollout of PPO."""
FAR_QUANTILE = 0.95
"""Labelled pieces that are nearer to their own kind than a far piece is."""


@dataclass(frozen=True)
class Drift:
    """How far pieces are from the labelled ones."""

    share_far: float
    """Share farther than `FAR_QUANTILE` of the labelled pieces are from their own kind;
    0.05 is no drift at all."""
    quantile: float
    """Share of the labelled pieces that are nearer to their own kind than the median
    piece here."""
    pieces: int


class Support:
    """The labelled pieces, and how near they are to one another."""

    def __init__(self, normaliser: Normaliser, pieces: Tensor, episode: Tensor) -> None:
        """Take descriptors [P, D] in the units of `normaliser`, and whose they are."""
        self._normaliser = normaliser
        self._pieces = pieces
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

    def distances(self, features: Tensor, valid: Tensor) -> Tensor:
        """Distance [Q] to the nearest labelled piece.

        Args:
            features: [T, N, F].
            valid: [T, N] bool, steps that exist. Pieces with one that does not are
                left out.
        """
        pieces, _ = _cut(self._normaliser, features, valid)
        return torch.cdist(pieces, self._pieces).amin(dim=1)

    def drift(self, features: Tensor, valid: Tensor) -> Drift | None:
        """How far rows [T, N, F] are; None where no piece is whole."""
        distances = self.distances(features, valid)
        if not len(distances) or not len(self._own):
            return None
        median = distances.median()
        return Drift(
            share_far=float((distances > self.far).float().mean()),
            quantile=float((self._own < median).float().mean()),
            pieces=len(distances),
        )


def support_of(pairs: AnsweredPairs, normaliser: Normaliser) -> Support:
    """The support of answered pairs."""
    numbers: dict[str, int] = {}
    pieces, episodes = [], []
    for clips, side in ((pairs.left, 0), (pairs.right, 1)):
        names = [episode[side] for episode in pairs.episodes]
        ids = torch.tensor([numbers.setdefault(n, len(numbers)) for n in names])
        cut, sequence = _cut(normaliser, *_rows(clips))
        pieces.append(cut)
        episodes.append(ids[sequence])
    return Support(normaliser, torch.cat(pieces), torch.cat(episodes))


def _rows(clips: ClipBatch) -> tuple[Tensor, Tensor]:
    return clips.features.transpose(0, 1), clips.scored.mT


def _cut(
    normaliser: Normaliser, features: Tensor, valid: Tensor
) -> tuple[Tensor, Tensor]:
    """Means [Q, D] of whole pieces of standardised descriptors, and their sequence."""
    steps, sequences = valid.shape
    whole = steps // PIECE_STEPS
    shape = (whole, PIECE_STEPS, sequences)
    kept = valid[: whole * PIECE_STEPS].reshape(shape).all(dim=1)  # [pieces, N]
    described = normaliser(describe(features[: whole * PIECE_STEPS]))
    means = described.reshape(*shape, described.shape[-1]).mean(dim=1)
    sequence = torch.arange(sequences).expand(whole, -1)
    return means[kept], sequence[kept]
