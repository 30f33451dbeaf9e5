"""`gaitpref` whose loops are evaluated on few episodes: all else is as it is typed.

`python -m tests.helpers.few_evaluated ARGUMENTS`: a quarter of the time of a small loop
would else go to figures that nobody looks at.
"""

from __future__ import annotations

import sys
from functools import partial

import pytest

from gaitpref.cli.main import main
from gaitpref.loop import presets
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.training import tracking_limit


def evaluate_few(patch: pytest.MonkeyPatch) -> None:
    """Of every loop that is begun from now on."""
    patch.setattr(presets, "LoopCfg", partial(LoopCfg, evaluation_episodes=8))
    patch.setattr(tracking_limit, "_EPISODES", 8)


if __name__ == "__main__":
    evaluate_few(pytest.MonkeyPatch())
    sys.exit(main(sys.argv[1:]))
