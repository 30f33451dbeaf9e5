"""`gaitpref` whose loops are evaluated on few short episodes and draw no curves: all
else is as it is typed.

`python -m tests.helpers.few_evaluated ARGUMENTS`: half of the time of a small loop
would else go to figures that nobody looks at.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import pytest

from gaitpref.cli.main import main
from gaitpref.loop import presets
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.training import tracking_limit
from policy.env.env_cfg import EnvCfg
from tests.helpers.curves_of_reports import blank


def evaluate_few(patch: pytest.MonkeyPatch) -> None:
    """Of every loop that is begun from now on."""

    def few(*, env: EnvCfg, **others: Any) -> LoopCfg:
        return LoopCfg(env=replace(env, episode_s=2.0), evaluation_episodes=8, **others)

    patch.setattr(presets, "LoopCfg", few)
    patch.setattr(tracking_limit, "_EPISODES", 8)


if __name__ == "__main__":
    evaluate_few(pytest.MonkeyPatch())
    with blank():
        sys.exit(main(sys.argv[1:]))
