"""Whether more answers would still change what is wanted.

Members of the ensemble are fitted to resampled answers, so that they differ as much as
rewards of other answers of the same person would. Where they all order the clips alike,
the next answer is foreseen by each of them and moves none. Members that were taught
nothing may agree by chance, but do not foresee answers.

Shapes: M ensemble members, C clips, K pairs of clips.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rewardmodel.answers.answered_pairs import AnsweredPairs
from rewardmodel.models.fit_report import FitReport
from rewardmodel.models.model import RewardModel

SETTLED = 0.96
"""Mean rank correlation of the members from which on no order is left to be learned."""
FORESEEN = 0.6
"""Held-out accuracy that its interval must clear before answers are called enough."""
MIN_HELD_OUT = 30
"""Held-out answers below which their accuracy tells nothing."""
_FEW = 0.1
"""Share of the members that does not make an order open."""
_MAX_PAIRS = 250
_LEAST_STD = 1e-6
"""Deviation of what a member was taught about clips, in logits, that is any."""


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """What there is left to ask about the newest clips."""

    agreement: float
    """Mean rank correlation (Spearman) of the clips' returns, over pairs of members."""
    open_share: float
    """Pairs of clips of which more than a tenth of the members prefer either."""

    @property
    def settled(self) -> bool:
        """Whether the members order the clips alike."""
        return self.agreement >= SETTLED


def remaining(model: RewardModel, pairs: AnsweredPairs) -> Remaining:
    """What the members still disagree about, of the clips of the newest round."""
    rounds = torch.tensor(pairs.rounds)
    is_newest = rounds == rounds.max()
    # Few are enough, and the clips of all would not fit into memory twice.
    newest = pairs.subset(is_newest & (is_newest.cumsum(dim=0) <= _MAX_PAIRS))
    returns = torch.cat(
        [model.clip_returns(newest.left), model.clip_returns(newest.right)], dim=1
    )
    fell = torch.cat([newest.left.fell, newest.right.fell]).float()
    learned = returns + model.provenance.cfg.fall_logit * fell
    return order_left(returns, learned)


def order_left(returns: Tensor, learned: Tensor) -> Remaining:
    """What members disagree about, of clips with these returns.

    Args:
        returns: [M, C] of the clips.
        learned: [M, C] the same without what no answer taught.
    """
    left, right = torch.triu_indices(returns.shape[1], returns.shape[1], 1)
    # Half where a member has no opinion: an order nobody knows is open.
    lead = returns[:, left] - returns[:, right]
    preferred = (0.5 + 0.5 * lead.sign()).mean(dim=0)  # [K]
    minority = torch.minimum(preferred, 1 - preferred)
    return Remaining(
        agreement=_rank_correlation(returns, learned.std(dim=1) > _LEAST_STD),
        open_share=float((minority > _FEW).float().mean()),
    )


def enough(left: Remaining, report: FitReport) -> bool:
    """Whether more answers of the same kind will not help now.

    Never without enough held-out answers that were foreseen: a rater who answers at
    random teaches nothing, however many answers there are.
    """
    interval = report.held_out_interval
    foreseen = interval is not None and interval[0] > FORESEEN
    return left.settled and foreseen and report.held_out_pairs >= MIN_HELD_OUT


def _rank_correlation(returns: Tensor, taught: Tensor) -> float:
    """Mean over pairs of members of the correlation of ranks of returns [M, C]; 0 with
    a member who was not `taught` [M] (bool) anything: the price of a fall is no
    opinion."""
    # Equal returns share a rank, or their order in memory would be an opinion.
    ranks = torch.stack(
        [(own[:, None] - own).sign().sum(dim=1) for own in returns]
    ).double()
    correlation = torch.corrcoef(ranks).nan_to_num(0.0) * taught * taught[:, None]
    first, second = torch.triu_indices(len(returns), len(returns), 1)
    return float(correlation[first, second].mean())
