"""Which pairs of clips to ask about next; a module for every family of strategies."""

from __future__ import annotations

from typing import get_args

from rewardmodel.clips import ClipRows
from rewardmodel.errors import RewardError
from rewardmodel.model import RewardModel
from rewardmodel.strategy_names import AGAIN as AGAIN
from rewardmodel.strategy_names import NEEDS_MODEL as NEEDS_MODEL
from rewardmodel.strategy_names import StrategyName as StrategyName

from .batches import Dpp as Dpp
from .batches import KCenter as KCenter
from .batches import Medoids as Medoids
from .choose import asked_for as asked_for
from .choose import choose_pairs as choose_pairs
from .phase import in_step as in_step
from .strategy import Strategy as Strategy
from .strategy import Uniform as Uniform
from .uncertainty import Bald as Bald
from .uncertainty import Disagreement as Disagreement
from .uncertainty import Entropy as Entropy
from .uncertainty import Improvement as Improvement


def make_strategy(
    name: StrategyName, model: RewardModel | None, clip_rows: ClipRows
) -> Strategy:
    """The strategy called `name`.

    Raises:
        RewardError: it needs an ensemble, and there is none.
        ValueError: there is no such strategy.
    """
    match name:
        case _ if name not in get_args(StrategyName):
            known = ", ".join(get_args(StrategyName))
            raise ValueError(f"no strategy is called {name!r}; there are {known}")
        case "uniform":
            return Uniform()
        case "medoids":
            return Medoids(clip_rows)
        case "kcenter" | "dpp" if model is None:
            return KCenter(clip_rows) if name == "kcenter" else Dpp(clip_rows)
        case _ if model is None:
            raise RewardError(
                f"--strategy {name} needs an ensemble: give --reward REWARD_DIR, "
                f"which `gaitpref fit` makes"
            )
        case "kcenter":
            return KCenter(clip_rows, among=Disagreement(model, clip_rows))
        case "kcenter-entropy":
            among = Entropy(model, clip_rows)
            return KCenter(clip_rows, among=among, name=name)
        case "dpp":
            return Dpp(clip_rows, quality=Disagreement(model, clip_rows))
        case "entropy":
            return Entropy(model, clip_rows)
        case "bald":
            return Bald(model, clip_rows)
        case "improvement":
            return Improvement(model, clip_rows)
        case "disagreement":
            return Disagreement(model, clip_rows)
