"""`gaitpref` whose loops are evaluated on few short episodes and draw no curves: all
else is as it is typed.

`python -m tests.helpers.few_evaluated ARGUMENTS`: half of the time of a small loop
would else go to figures that nobody looks at. What a loop is made of is imported for a
loop alone, so that other commands begin as fast as they do for everybody.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gaitpref.cli.main import main

if TYPE_CHECKING:
    import pytest

    from gaitpref.loop.loop_cfg import LoopCfg
    from policy.env.env_cfg import EnvCfg


def evaluate_few(patch: pytest.MonkeyPatch) -> None:
    """Of every loop that is begun from now on."""
    from gaitpref.loop import presets
    from gaitpref.loop.loop_cfg import LoopCfg
    from gaitpref.training import tracking_limit

    def few(*, env: EnvCfg, **others: Any) -> LoopCfg:
        return LoopCfg(env=replace(env, episode_s=2.0), evaluation_episodes=8, **others)

    patch.setattr(presets, "LoopCfg", few)
    patch.setattr(tracking_limit, "_EPISODES", 8)


def _loop(arguments: list[str]) -> int:
    """A loop that is typed."""
    import pytest

    from tests.helpers.curves_of_reports import blank

    evaluate_few(pytest.MonkeyPatch())
    with blank():
        return main(arguments)


if __name__ == "__main__":
    typed = sys.argv[1:]
    sys.exit(_loop(typed) if typed[:1] == ["loop"] else main(typed))
