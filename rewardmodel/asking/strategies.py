"""Every way to choose questions, by its name: the two in use and their extensions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from data.answers.strategy_names import StrategyName
from rewardmodel.acquisition import Disagreement, Information, Strategy, Uniform
from rewardmodel.answers.clip_batch import ClipRows
from rewardmodel.errors import RewardError
from rewardmodel.extensions.questions.batches import Dpp, KCenter, Medoids
from rewardmodel.extensions.questions.informative import Bald, Entropy, Improvement
from rewardmodel.models.model import RewardModel


@dataclass(frozen=True, kw_only=True)
class Making:
    """How a strategy is made, with or without an ensemble to ask."""

    blind: Callable[[ClipRows], Strategy] | None = None
    """The strategy without a model; None where it needs one."""
    asking: Callable[[RewardModel, ClipRows], Strategy] | None = None
    """The strategy with a model; None where it takes no notice of it."""


STRATEGIES: Mapping[StrategyName, Making] = {
    "uniform": Making(blind=lambda clip_rows: Uniform()),
    "disagreement": Making(asking=Disagreement),
    "information": Making(asking=Information),
    "entropy": Making(asking=Entropy),
    "bald": Making(asking=Bald),
    "improvement": Making(asking=Improvement),
    "kcenter": Making(
        blind=KCenter,
        asking=lambda model, clip_rows: KCenter(
            clip_rows, among=Disagreement(model, clip_rows)
        ),
    ),
    "kcenter-entropy": Making(
        asking=lambda model, clip_rows: KCenter(
            clip_rows, among=Entropy(model, clip_rows), name="kcenter-entropy"
        ),
    ),
    "medoids": Making(blind=Medoids),
    "dpp": Making(
        blind=Dpp,
        asking=lambda model, clip_rows: Dpp(
            clip_rows, quality=Disagreement(model, clip_rows)
        ),
    ),
}


def make_strategy(
    name: StrategyName, model: RewardModel | None, clip_rows: ClipRows
) -> Strategy:
    """The strategy called `name`.

    Raises:
        RewardError: it needs an ensemble, and there is none.
        ValueError: there is no such strategy.
    """
    making = STRATEGIES.get(name)
    if making is None:
        raise ValueError(
            f"no strategy is called {name!r}; there are {', '.join(STRATEGIES)}"
        )
    if model is not None and making.asking is not None:
        return making.asking(model, clip_rows)
    if making.blind is None:
        raise RewardError(
            f"--strategy {name} needs an ensemble: give --reward REWARD_DIR, "
            f"which `gaitpref fit` makes"
        )
    return making.blind(clip_rows)
