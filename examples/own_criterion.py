"""A loop whose simulated rater wants something of your own.

    python examples/own_criterion.py --run runs/own-criterion

A criterion is a function of feature rows [..., F] that gives a score [...]; the loop
never sees it, only its answers. Killed, the same command goes on.
"""

from __future__ import annotations

from pathlib import Path

import tyro
from torch import Tensor

from data import column
from gaitpref import LoopCfg, loop_cfg, run_loop


def level_trunk(features: Tensor) -> Tensor:
    """Likes a trunk that neither rolls nor pitches."""
    sideways_g = features[..., column("gravity_b")][..., :2]
    return -sideways_g.square().sum(dim=-1)


def cfg(seed: int = 0) -> LoopCfg:
    """Twenty questions about a robot that has learned to walk."""
    name = f"{__name__}:{level_trunk.__name__}"
    return loop_cfg(criterion=name, quick=True, labels=20, seed=seed)


def main(run: Path, seed: int = 0) -> None:
    """Run the loop.

    Args:
        run: Directory of the run.
        seed: Where all chance comes from.
    """
    print(f"the report is {run_loop(run, cfg(seed))}")


if __name__ == "__main__":
    tyro.cli(main)
