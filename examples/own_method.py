"""A loop with one decision of the method left out, and another one changed.

    python examples/own_method.py --run runs/own-method

`gaitpref method` prints all decisions; docs/method.md says what each is for.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import tyro

from gaitpref import STYLE, LoopCfg, loop_cfg, run_loop

BOLD = replace(
    STYLE,
    mirror=False,  # A style may favour one side.
    clips=replace(STYLE.clips, posture_share=0.25),
)
"""Styles as they ship, but for one-sided ones and for which postures are shown."""


def cfg(seed: int = 0) -> LoopCfg:
    """Higher steps, from the walk that ships."""
    return loop_cfg(
        criterion="high_step", quick=True, labels=20, method=BOLD, seed=seed
    )


def main(run: Path, seed: int = 0) -> None:
    """Run the loop.

    Args:
        run: Directory of the run.
        seed: Where all chance comes from.
    """
    print(f"the report is {run_loop(run, cfg(seed))}")


if __name__ == "__main__":
    tyro.cli(main)
