"""What moved a reward about a pair, drawn for the labeling page.

Who answers is shown it on demand, and after the answer.
"""

from __future__ import annotations

import logging
from functools import lru_cache
from pathlib import Path

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.errors import GaitprefError

from .answer_credit import credited
from .credit_picture import credit_picture
from .crediting import load_crediting
from .pictures import svg_of

logger = logging.getLogger(__name__)
_model = lru_cache(maxsize=1)(load_crediting)


def answer_picture(dataset: Path, reward: Path, pair: Pair, answer: Answer) -> str:
    """The figure of `credit` as SVG; empty where it cannot be drawn."""
    try:
        found = credited(_model(reward), Dataset.open(dataset), pair, answer)
    except (GaitprefError, OSError) as error:
        logger.warning("pair %s is not explained: %s", pair.pair_id[:12], error)
        return ""
    return svg_of(credit_picture(found.credit, dt_s=found.dt_s).axes[0])


def newest_picture(run: Path, pair: Pair, answer: Answer) -> str:
    """The same of the newest reward of a loop; empty before there is one."""
    rewards = sorted(run.glob("rounds/*/reward"))
    if not rewards:
        return ""
    return answer_picture(run / "dataset", rewards[-1], pair, answer)
