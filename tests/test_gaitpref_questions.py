"""From episodes to questions."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.walks import walking_dataset
from gaitpref.questions import ClipCfg, with_known_answer


def test_the_robot_that_does_not_fall_is_the_known_answer(tmp_path: Path) -> None:
    """Three of twelve robots fall, so there are three such pairs, and no more."""
    entries = walking_dataset(tmp_path / "set", pairs=0).entries()
    falls = {
        entry.sha256: entry.num_steps for entry in entries if entry.num_steps < 300
    }
    assert len(falls) == 3
    pairs = with_known_answer(
        entries,
        ClipCfg(),
        10,
        known=(),
        round_number=2,
        rng=np.random.default_rng(0),
    )
    assert len(pairs) == 3
    for pair in pairs:
        sides = {"a": pair.a, "b": pair.b}
        better = sides.pop(pair.gold or "")
        (worse,) = sides.values()
        assert better.rollout not in falls
        assert worse.stop == falls[worse.rollout]
        assert pair.round == 2
