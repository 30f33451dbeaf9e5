"""What the ways to choose a pair are called; a pair keeps the name of its own."""

from __future__ import annotations

from typing import Literal

StrategyName = Literal[
    "uniform",
    "disagreement",
    "information",
    "entropy",
    "bald",
    "improvement",
    "kcenter",
    "kcenter-entropy",
    "medoids",
    "dpp",
]
NEEDS_MODEL = (
    "disagreement",
    "information",
    "entropy",
    "bald",
    "improvement",
    "kcenter-entropy",
)
"""Names of strategies that ask an ensemble, and of it the hardest questions; kcenter
and dpp use one where there is one."""
DRIVEN = "driven"
"""Name on pairs of what two robots did while a person drove them."""
ASKED_AGAIN = "again"
"""Name on pairs that earlier versions asked once more, as the answers looked wrong."""
APPROVAL, ARENA = "approval", "arena"
"""Names on pairs of two policies that are compared, in a loop and in an arena."""
