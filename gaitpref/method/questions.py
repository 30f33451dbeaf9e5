"""Which pairs of clips a round asks about."""

from __future__ import annotations

from dataclasses import dataclass, field

from data.answers.strategy_names import StrategyName
from data.files.plain import NONE_AS_BEFORE
from rewardmodel.answers.answered_pairs import MIN_ANSWERS


@dataclass(frozen=True, kw_only=True)
class Questions:
    """Pairs in batches, each chosen where the answers so far leave doubt.

    Within one batch, questions about the same doubt are as good as one.
    """

    strategy: StrategyName = "disagreement"
    """How a pair is chosen."""
    uniform_share: float = 0.2
    """Share of the pairs chosen at random: they measure the reward."""
    batch: int = 10
    """Questions chosen at a time; a reward is fitted to all answers before the next."""

    informed_from: int = MIN_ANSWERS
    """Answers from which on a reward fitted to them chooses."""
    apart: float | None = field(default=None, metadata=NONE_AS_BEFORE)
    """How different the two clips of a pair look that people are asked about, in
    differences they just notice; None is one."""

    def __post_init__(self) -> None:
        if self.apart is not None and not self.apart >= 0.0:
            raise ValueError(f"apart must be at least 0, got {self.apart:g}")
        if self.batch < 1:
            raise ValueError(f"batch must be at least 1, got {self.batch}")
        if not 0.0 <= self.uniform_share <= 1.0:
            raise ValueError(
                f"uniform_share must lie in [0, 1], got {self.uniform_share}"
            )
