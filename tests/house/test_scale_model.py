"""The model of a training with many actors agrees with what can be told without it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.scale_costs import Costs, measured_costs
from benchmarks.scale_model import Options, main, saturations, simulate

FREE = Costs(
    actor_s=100e-6,
    learner_s=0.0,
    adopt_s=0.0,
    step_bytes=1.0,
    weights_bytes=1.0,
    gradient_bytes=1.0,
    rater_cores=0.02,
    log_bytes_per_s=50e3,
)
STEADY = Options(jitter=0.0)


@pytest.mark.parametrize("actors", [1, 7, 300])
def test_actors_add_up_where_nothing_else_costs(actors: int) -> None:
    seen = simulate(FREE, actors, STEADY)
    assert seen.steps_per_s == pytest.approx(actors * 10_000, rel=0.01)
    assert seen.limit == "actors"


def test_a_learner_is_never_faster_than_it_is() -> None:
    """And is kept busy by more actors than fill it."""
    costs = replace(FREE, learner_s=40e-6)
    filled = saturations(costs, STEADY)["actors_that_fill_the_learner"]
    assert filled == pytest.approx(2.5)
    for actors in (1, 2, 3, 50):
        seen = simulate(costs, actors, STEADY)
        most = min(actors * 10_000, 25_000)
        assert 0.5 * most < seen.steps_per_s <= 1.001 * most
        assert (seen.limit == "learner") == (actors > filled)


def test_a_line_fills_too() -> None:
    costs = replace(FREE, step_bytes=1_250.0)
    options = replace(STEADY, line_bytes_per_s=125e6)
    seen = simulate(costs, 20, options)
    assert seen.steps_per_s == pytest.approx(100_000, rel=0.02)
    assert seen.limit == "line"


def test_costs_are_measured_and_kept(tmp_path: Path) -> None:
    page = tmp_path / "page.json"
    page.write_text(json.dumps({"cores_8_raters": 0.16}))
    costs = measured_costs(envs=8, repeats=1, page=page)
    assert costs.rater_cores == pytest.approx(0.02)
    # 90 columns of features, what is seen and what is done, in four bytes each.
    assert 500 < costs.step_bytes < 1_000
    # 47,257 parameters of actor and critic, in four bytes each.
    assert costs.gradient_bytes == 189_028
    assert 0.0 < costs.adopt_s < costs.learner_s
    kept = tmp_path / "costs.json"
    kept.write_text(json.dumps({"costs": vars(costs)}))
    out = tmp_path / "scale.json"
    main(Options(costs=kept, actors=(1, 4), updates=6, json=out))
    assert [row["actors"] for row in json.loads(out.read_text())["rows"]] == [1, 4]
