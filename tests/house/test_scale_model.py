"""The model of a training with many actors agrees with what can be told without it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import actors_table, scale_table
from benchmarks.scale_costs import Costs, measured_costs, rater_cores
from benchmarks.scale_model import Options, main, read_costs, saturations, simulate

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
ROOT = Path(__file__).resolve().parents[2]


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
    crowd = tmp_path / "crowd.json"
    costs = measured_costs(envs=8, repeats=1, page=page, crowd=crowd)
    assert costs.rater_cores == pytest.approx(0.02)
    crowd.write_text(json.dumps({"cores": 0.9, "raters": 24}))
    assert rater_cores(page, crowd) == pytest.approx(0.0375)
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


def test_every_part_is_seen_to_be_full() -> None:
    """The learner that was measured, then a faster one, then the line."""
    costs = read_costs(ROOT / "docs/results/scale.json")
    told = scale_table.told(costs, Options(actors=(1, 64, 2_000), updates=6))
    limits = [line.split("|")[-2].strip() for line in told.splitlines() if "%" in line]
    assert limits == ["actors", *["learner"] * 2] * 2 + ["actors", "actors", "line"]
    assert "| a line of 10 Gbit/s | 622 bytes a step | 244 actors," in told


def test_engines_stand_side_by_side_in_the_page(tmp_path: Path) -> None:
    """What was measured, beside what was asked for; of the rest nothing is told."""
    page, figures = tmp_path / "page.md", tmp_path / "actors.json"
    page.write_text("before\n<!-- actors: begin -->\n<!-- actors: end -->\nafter\n")
    options = actors_table.Options(figures=figures, page=page)
    actors_table.main(options)
    assert "| not measured |" in page.read_text()
    assert (
        "| `vtrace_1_over_ppo_steps_per_s` | not measured | >= 0.9 |"
        in page.read_text()
    )
    one = {"steps_per_s": 8123.4, "walk_steps": 600_000.0, "walk_s": 71.6}
    both = {
        "ppo_seeds": 3,
        "ppo_walked": 2,
        **{f"ppo_{name}": value for name, value in one.items()},
        "vtrace_2_steps_per_s": 9000.0,
        "vtrace_2_walked": 1,
        "vtrace_2_walk_steps": None,
        "vtrace_2_clipped_share": 0.125,
        "vtrace_2_over_ppo_walk_steps": 1.25,
    }
    figures.write_text(json.dumps(both))
    actors_table.main(options)
    told = page.read_text().splitlines()
    assert (told[0], told[-1]) == ("before", "after")
    assert "| ppo | 8,123 | 3 | 2 | 600,000 | 72 s |  |  |  |  |  |" in told
    assert "| vtrace, 2 | 9,000 |  | 1 | none |  |  |  | 12.5% |  |  |" in told
    assert "| `vtrace_2_over_ppo_walk_steps` | 1.25 | <= 1.3 |" in told
    assert not any("sync" in line for line in told)
