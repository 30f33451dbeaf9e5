"""The benchmarks run in their small version, end to end."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import tyro

from benchmarks import (
    ablations,
    actors,
    data_models,
    film,
    harness,
    hour,
    newcomer,
    offpolicy,
    offpolicy_plan,
    offpolicy_styles,
    options,
    preference_fresh,
    preference_row,
    preferences,
    robots,
    team,
    throughput,
    verdict_table,
    walk,
)
from benchmarks.preference_plan import (
    FIGURES,
    HELD_BACK,
    METHODS,
    SCRATCH_ONLY,
    Cell,
    cfg_of,
    plan,
)
from benchmarks.preference_table import EARLIER, MARK, between, publish_rows, together
from benchmarks.wishes import carried_right_foot, nose_up_when_slow
from data.errors import GaitprefError
from data.features import FEATURE_DIM, column
from gaitpref.cli.main import parse
from gaitpref.loop.presets import loop_cfg
from gaitpref.loop.run import run_loop
from gaitpref.method.method import FROM_SCRATCH, STYLE
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.raters.rater_cfg import RaterCfg
from policy.robots.shipped import WALK
from policy.rollouts.walking import TRACKING_ERROR_M_S
from policy.training.checkpoint import load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from rewardmodel.descriptors.table import describe
from rewardmodel.extensions_cfg import RawCfg
from tests.helpers.foreign_robots import Drawing, mjcf
from tests.helpers.required import needed
from tests.helpers.small_loop import small_cfg

ROOT = Path(__file__).resolve().parents[2]


def test_actors(tmp_path: Path) -> None:
    """PPO beside an actor on Ray, by steps, time and staleness."""
    needed("ray", "RAY")
    figures = tmp_path / "figures.json"
    # In a process of its own, which takes Ray's open files with it.
    command = [sys.executable, "-m", "benchmarks.actors", "--quick"]
    subprocess.run(
        [*command, "--json", str(figures), "--work", str(tmp_path / "work")], check=True
    )
    result = json.loads(figures.read_text())
    assert result["vtrace_1_lag_most"] <= 2.0
    assert result["vtrace_1_over_ppo_steps_per_s"] > 0.0
    assert result["vtrace_1_clipped_share"] >= 0.0
    # Nothing of it is corrected, so that none is said to be clipped.
    assert "ppo_clipped_share" not in result


def test_a_film_is_timed_as_a_whole_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the clock, and by the processor, which other work changes little."""
    spent = harness.gaitpref("--version")
    assert spent.cpu_s > 0
    lines: list[tuple[str, ...]] = []

    def filmed(*args: str | Path) -> harness.Run:
        lines.append(tuple(map(str, args)))
        Path(args[-1]).write_bytes(bytes(5000))
        return spent

    monkeypatch.setattr(film, "gaitpref", filmed)
    figures = tmp_path / "film.json"
    assert film.main(film.FilmOptions(quick=True, json=figures)) == 0
    result = json.loads(figures.read_text())
    assert result["film_s"] == 1.0
    for kind, line in zip(("webp", "mp4"), lines, strict=True):
        assert line[:3] == ("film", "--policy", str(WALK))
        assert line[-1].endswith(kind)
        assert result[f"{kind}_cpu_s"] == round(spent.cpu_s, 1)
        assert result[f"{kind}_kb"] == 5


def test_figures_of_actors_are_of_what_is_counted() -> None:
    """Of gradients, none of which V-trace corrects, no share is clipped; of what was
    not to walk, no walk is told. Ratios are of steps a second."""
    iterations = [
        {"steps": 100.0 * n, "took_s": 0.5, "actors/lag_mean": 1.0} for n in (1, 2)
    ]
    slow = actors.outcome_of(iterations)
    fast = replace(slow, steps_per_s=1.5 * slow.steps_per_s)
    assert (slow.steps_per_s, slow.lag_mean, slow.clipped_share) == (200.0, 1.0, None)
    ways = ("gradients", "physics")
    runs = {f"{way}_{n}": [(slow, fast)[n - 1]] for way in ways for n in (1, 2)}
    runs |= {"ppo": [slow], "torchrun_2": [fast]}
    figures = actors.figures_of(runs)
    assert not [name for name in figures if name.endswith("clipped_share")]
    assert figures["gradients_1_walked"] == 0
    assert not [name for name in figures if "physics" in name and "walk" in name]
    for ratio in ("gradients_2_over_gradients_1", "physics_2_over_physics_1"):
        assert figures[f"{ratio}_steps_per_s"] == pytest.approx(1.5)
    assert figures["torchrun_2_over_ppo_steps_per_s"] == pytest.approx(1.5)


def test_off_policy_beside_ppo(tmp_path: Path) -> None:
    """A style out of data alone is a share of what PPO gains, and so is one out of the
    answers of loops, which are finished here and not run again."""
    figures, work = tmp_path / "figures.json", tmp_path / "work"
    shipped = load_policy(WALK)
    # Its episodes take a second.
    cfg = TrainCfg(steps=0, env=replace(shipped.info.env, episode_s=1.0), ppo=PpoCfg())
    base = train(tmp_path / "base", shipped.robot(), cfg, init=WALK).policy
    for name, returns in (("ppo", (1.0, 3.0)), ("fastsac", (1.0, 1.5))):
        row = work / "answers-high_step-0"
        for number, earned in enumerate(returns):
            report = row / name / f"rounds/{number:02d}/report.json"
            report.parent.mkdir(parents=True)
            report.write_text(json.dumps({"evaluation": {"return_mean": earned}}))
        (row / f"{name}-done").touch()
    offpolicy.main(
        offpolicy.Options(
            parts=("offline", "answers"),
            clone_weights=(0.2,),
            base=base,
            work=work,
            quick=True,
            json=figures,
        )
    )
    result = json.loads(figures.read_text())
    assert result["answers_share_0"] == result["answers_share_median"] == 0.25
    assert result["offline_clone_0.2_distance_0"] > 0.0
    gain, online = result["offline_clone_0.2_gain_0"], result["online_gain_0"]
    share = gain / online if online > 0 else 0.0
    assert result["offline_clone_0.2_share_median"] == pytest.approx(share)
    done = (work / "offline-high_step-0").glob("*-done")
    assert {path.name for path in done} == {"offline_clone_0.2-done", "online-done"}


def test_every_line_of_off_policy_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each part with its option of two words, which is of the off-policy trainings
    alone; and its figures are of what these come to."""
    lines: list[list[str]] = []
    walks: list[tuple[str, walk.Options]] = []

    def trained(how: walk.Options, seed: int) -> walk.Outcome:
        walks.append((how.work.name, how))
        lines.append(["train", "--out", "o", "--reward", "task"])
        lines[-1] += shlex.split(how.more)
        # PPO in 900 steps, off-policy in 300, by priority in 200.
        steps = {"ppo": 900, "fastsac": 300, "prioritised": 200}[how.work.name]
        return walk.Outcome(9.0, steps, 0.1, 10.0)

    def earned(options: object, reward: str, file: Path) -> float:
        return 2.0 if "prioritised" in str(file) or "online" in str(file) else 1.5

    def typed(*args: str | Path, well: object = ()) -> None:
        line = [str(word) for word in args]
        lines.append(line)
        if line[0] == "record":
            Path(line[line.index("--dataset") + 1]).mkdir(parents=True)
        if line[0] == "train":
            out = Path(line[line.index("--out") + 1])
            out.mkdir(parents=True)
            (out / "summary.json").write_text('{"offline/action_distance": 0.5}')
        if line[0] == "loop":
            run, end = Path(line[2]), 3.0 if "fastsac" not in line else 2.0
            for number, mean in ((0, 1.0), (2, end)):
                report = run / f"rounds/{number:02d}/report.json"
                report.parent.mkdir(parents=True)
                report.write_text(json.dumps({"evaluation": {"return_mean": mean}}))

    monkeypatch.setattr(walk, "trained", trained)
    for module in (offpolicy, offpolicy_styles):
        monkeypatch.setattr(module, "earned", earned)
    monkeypatch.setattr(offpolicy_styles, "gaitpref", typed)
    args = ["--more=--actors 2", "--seeds", "0", "--work", str(tmp_path)]
    found = offpolicy.measured(tyro.cli(offpolicy_plan.Options, args=args))
    assert len(lines) == 4 + 1 + 3 + 1 + 2
    for line in lines:
        assert parse(line)
        fast = "fastsac" in line and line[0] == "train"
        assert ("--actors" in line) == fast
        if fast:
            assert line[line.index("--actors") + 1] == "2"
    assert [name for name, _ in walks] == ["ppo", "fastsac", "fastsac", "prioritised"]
    assert ["--prioritised" in how.more for _, how in walks] == [False] * 3 + [True]
    assert found["steps_share_worst"] == pytest.approx(1 / 3)
    assert found["return_gain_by_priority_median"] == 0.5
    assert found["answers_share_median"] == 0.5


def test_what_rows_are_measured_against_is_trained_once(tmp_path: Path) -> None:
    """Of the same base and episodes; what is of another base is not taken."""
    cell = Cell(task="trot", answers=20, rater="perfect", method="default", seed=0)
    cfg = cfg_of(cell, WALK, quick=True)
    places = preference_row.Places(
        work=tmp_path / "work",
        results=tmp_path / "rows",
        references=tmp_path / "references",
        quick=True,
    )
    found = preference_row.references_of(cell, cfg, WALK, places)
    assert {"start", "true"} <= set(found)
    kept = tmp_path / f"references/true-trot-{preference_row.steps_of(cfg)}.json"
    elsewhere = replace(places, work=tmp_path / "elsewhere")
    assert preference_row.references_of(cell, cfg, WALK, elsewhere) == found
    assert not elsewhere.work.exists()
    told = json.loads(kept.read_text())
    told["of"]["base_sha256"] = "another"
    told["true"]["return_mean"] = -1.0
    kept.write_text(json.dumps(told))
    assert preference_row.references_of(cell, cfg, WALK, places) == found
    assert json.loads(kept.read_text())["true"] == found["true"]


def test_robots_of_others(tmp_path: Path) -> None:
    """A robot is trained, measured and published with the keys of the goals."""
    xml = tmp_path / "menagerie" / robots.ROBOTS["spot"]
    xml.parent.mkdir(parents=True)
    xml.write_text(mjcf(Drawing()))
    figures = tmp_path / "figures.json"
    robots.main(
        robots.Options(
            robots=("spot",),
            assets=(tmp_path / "menagerie",),
            work=tmp_path / "work",
            quick=True,
            json=figures,
        )
    )
    result = json.loads(figures.read_text())
    assert (result["spot_walked"], result["spot_seeds"]) == (0, 1)
    assert result["spot_steps_most"] == 384
    assert isinstance(result["spot_falls"], int)
    assert result["spot_tracking_error_m_s"] > 0.1
    # A robot of half a metre is asked for more than one of 0.29 m.
    assert result["spot_fastest_m_s"] > 1.1


def test_a_model_apart_is_stored_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rest of two data sets weighs the same."""
    monkeypatch.setattr(data_models, "EPISODES", 4)
    monkeypatch.setattr(data_models, "STEPS", 10)
    xml = tmp_path / "other.xml"
    xml.write_text(mjcf(Drawing()))
    found = data_models.models_figures(tmp_path, xml)
    names = ("models_in_each_mb", "models_once_mb", "model_mb")
    each, once, model = (float(found[name] or 0.0) for name in names)
    assert each - once == pytest.approx(3 * model, rel=0.1)


def test_a_newcomer_types_what_the_pages_say() -> None:
    """Every line is a command with such options; but for a person's answers and the
    fit to them, its page has it."""
    paths = dict.fromkeys(("policy", "law", "robot", "log", "map"), Path("file"))
    has = newcomer.Brought(**paths)
    pages: dict[newcomer.Way, str] = {
        "policy": "own-policy",
        "robot": "own-robot",
        "log": "robot-log",
    }
    for quick in (True, False):
        sizes = newcomer.sizes_of(newcomer.Options(quick=quick))
        for way, page in pages.items():
            text = (ROOT / "docs" / "how-to" / f"{page}.md").read_text()
            for line in newcomer.LINES[way](has, sizes, Path("out")):
                assert parse([str(word) for word in line])
                name = newcomer.name_of(line).replace("_", " ")
                assert name in ("answer", "fit") or f"gaitpref {name} " in text
    rounds = loop_cfg(quick=True).rounds
    assert rounds == newcomer.sizes_of(newcomer.Options()).rounds


def test_what_a_person_gained_is_a_share_of_what_the_true_reward_gains() -> None:
    """By the references of the rows of preferences, as the stored figures have it."""
    person = pytest.importorskip("benchmarks.person")
    rows = ROOT / "docs" / "results"
    row = next(iter((rows / "preferences").glob("high_step-20-perfect-default-*")))
    known = json.loads(row.read_text())
    for name, share in (("start_return", 0.0), ("true_return", 1.0)):
        assert person.share_of_true("high_step", known[name]) == pytest.approx(share)
    for name in ("person", "person_serial"):
        told = json.loads((rows / f"{name}.json").read_text())
        found = person.share_of_true("high_step", told["return_after"])
        assert found == pytest.approx(told["share_of_true"])
        assert 0.5 < found < 1.1
    assert person.share_of_true("benchmarks.strangers:nobody_knows", 1.0) is None


def test_options(tmp_path: Path) -> None:
    """Gaits alone, a rule and what was learned, from rows that are made once."""
    figures = tmp_path / "figures.json"
    small = options.Options(
        quick=True,
        policy=(f"walk={WALK}", f"high={WALK}"),
        results=tmp_path / "rows",
        work=tmp_path / "work",
        json=figures,
    )
    options.main(small)
    result = json.loads(figures.read_text())
    rows = {path.stem for path in small.results.glob("*.json")}
    alone = {"walk-alone", "high-alone", "crouch-alone"}
    assert rows == alone | {"rule", "fixed_1s-seed0"}
    gain = result["fixed_1s_reward"] - result["rule_reward"]
    assert result["fixed_1s_over_rule"] == pytest.approx(gain)
    assert result["best_alone"].removesuffix(" alone") in ("walk", "high", "crouch")
    figures.unlink()
    before = {path: path.stat().st_mtime_ns for path in small.results.glob("*.json")}
    options.main(small)
    assert json.loads(figures.read_text()) == result
    assert before == {path: path.stat().st_mtime_ns for path in before}


def test_a_rule_by_hand_sees_what_is_near() -> None:
    """High on steps, crouch below a bar, else the first; far away is open ground."""
    ahead = torch.zeros(5, 6)
    for row, (kind, distance_m) in enumerate(
        ((0, 0.4), (2, 0.0), (1, 0.1), (2, 0.6), (0, 0.5))
    ):
        ahead[row, kind], ahead[row, 3] = 1.0, distance_m
    rule = options.rule_of(("walk", "high", "crouch"))
    assert rule(ahead).tolist() == [1, 2, 0, 0, 1]
    assert options.rule_of(("walk", "crouch"))(ahead).tolist() == [0, 1, 0, 0, 0]


def test_teams_are_summed_up_robot_by_robot() -> None:
    """Means over seeds, of what there is; a gain is over the policy before."""
    names = ("formation", "gap_error_m", "lag_m", "fell", "error_1_m_s", "error_2_m_s")
    names = (*names, "stands_1", "stands_2")

    def row(kind: str, formation: float) -> team.Row:
        numbers = dict.fromkeys(names, 0.25) | {"stands_2": -formation}
        return {"kind": kind, **numbers, "formation": formation}

    found = team.summary(
        [
            *(row("before", formation) for formation in (-1.0, -2.0)),
            *(row("shares", formation) for formation in (-0.5, -0.9)),
            *(
                {"kind": "answers", "answers": 20, "accuracy": accuracy}
                for accuracy in (0.5, None, 0.7)
            ),
            {"kind": "lazy", "named_1": True, "named_2": False, "earns_less_1": True},
            {"kind": "lazy", "less_1": 0.2},
            {"kind": "lazy", "less_1": 0.4, "less_2": 0.1},
        ]
    )
    less = [found[f"lazy_less_{robot}"] for robot in (1, 2)]
    assert less == pytest.approx([0.3, 0.1])
    assert found["shares_gain"] == pytest.approx(0.8)
    stands = [found[f"shares_stands_{robot}"] for robot in (1, 2)]
    assert stands == pytest.approx([0.25, 0.7])
    assert found["accuracy_20"] == pytest.approx(0.6)
    assert found["lazy_named"] == "1 of 2"
    assert found["lazy_earns_less"] == "1 of 1"


def test_lazy_robots_are_measured_without_a_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With no way to pay: rows of answers and of who is lazy, and no training."""
    lines: list[tuple[str | Path, ...]] = []
    monkeypatch.setattr(team, "gaitpref", lambda *args: lines.append(args))
    for name, row in (
        ("walked", {}),
        ("foreseen", {"accuracy": 0.5}),
        ("lazy_named", {"less_1": 0.2}),
    ):
        monkeypatch.setattr(team, name, lambda *_, row=row: row)
    figures = tmp_path / "figures.json"
    args = ["--seeds", "1", "--pays", "--work", str(tmp_path), "--json", str(figures)]
    team.main(tyro.cli(team.Options, args=args))
    kept = team.Rows(tmp_path / "rows.json").kept
    assert [row["kind"] for row in kept] == ["before", *4 * ["answers"], "lazy"]
    assert not [line for line in lines if line[:2] == ("team", "train")]
    assert json.loads(figures.read_text())["lazy_less_1"] == 0.2


def test_preferences(tmp_path: Path) -> None:
    """Rows are files, table and plot are made from them, and nothing runs twice."""
    work, results = tmp_path / "work", tmp_path / "results"
    figures = tmp_path / "rows.json"
    options = preferences.Options(
        tasks=("walk", "brisk_walk", "nose_up"),
        seeds=1,
        answers=(100, 150),
        raters=("perfect",),
        keep_runs=True,
        work=work,
        results=results,
        docs=tmp_path,
        quick=True,
        json=figures,
    )
    assert preferences.main(options) == 0
    rows = json.loads(figures.read_text())["rows"]
    assert {row["task"] for row in rows} == {"walk", "brisk_walk", "nose_up"}
    for row in rows:
        assert row["seeds"] == 1
        for name in ("fraction_median", "fraction_min", "minutes"):
            assert isinstance(row[name], float), name
        assert {"answers", "rater", "method", "accuracy", "ece"} <= set(row)
    page = (tmp_path / "benchmarks.md").read_text()
    assert "| nose_up, 150 answers | 1 |" in page
    assert (tmp_path / "images/preferences.svg").stat().st_size > 1000
    for path in results.glob("*.json"):
        known = json.loads(path.read_text())
        assert {"ece_by_chance", "fresh_ece_by_chance"} <= known.keys()
    # From one start with one seed, they differ in what they were trained on.
    walk, brisk = (
        load_policy(next(work.glob(f"true-{task}-*/noisy/policy.pt")))
        for task in ("walk", "brisk_walk")
    )
    obs = torch.linspace(-1, 1, 48)[None]
    assert not torch.equal(walk(obs), brisk(obs))
    # A style is compared with the better of two, the noise of one of which came down.
    noisy, calm = (
        float(
            load_policy(next(work.glob(f"true-nose_up-*/{way}/policy.pt"))).std.mean()
        )
        for way in ("noisy", "calm")
    )
    assert calm == pytest.approx(0.1, rel=0.05)
    assert noisy > 2 * calm

    # A row that is there is not run again, and one that is not, is.
    finished = {path: path.stat().st_mtime_ns for path in results.glob("*.json")}
    (gone, *kept) = finished
    gone.unlink()
    assert preferences.main(options) == 0
    assert all(path.stat().st_mtime_ns == finished[path] for path in kept)
    assert gone.exists()
    assert (tmp_path / "benchmarks.md").read_text().count("| nose_up,") == 1


def test_preferences_of_another_robot(tmp_path: Path) -> None:
    """Start, reference and loop are that robot's, at speeds that suit it, and its row
    stands beside that of the robot that ships."""
    xml, results = tmp_path / "other.xml", tmp_path / "results"
    xml.write_text(mjcf(Drawing()))
    options = preferences.Options(
        tasks=("crouch",),
        seeds=1,
        workers=1,
        keep_runs=True,
        robot=("tall", xml),
        results=results,
        work=tmp_path / "work",
        docs=tmp_path,
        quick=True,
    )
    assert preferences.main(options) == 0
    (row,) = (json.loads(path.read_text()) for path in results.glob("*.json"))
    assert (row["task"], row["robot"]) == ("crouch", "tall")
    policies = [load_policy(path) for path in (tmp_path / "work").rglob("policy.pt")]
    assert len(policies) > 4
    assert len({policy.robot().model_sha256 for policy in policies}) == 1
    assert all(p.info.env.commands.evaluated_m_s[1] > 1.1 for p in policies)
    ours = {**row, "robot": None}
    publish_rows([row, ours], tmp_path, None)
    page = (tmp_path / "benchmarks.md").read_text()
    assert "| crouch, tall, 20 answers | 1 |" in page
    assert "| crouch, 20 answers | 1 |" in page


def test_a_table_of_several_seeds(tmp_path: Path) -> None:
    """Median and worst over the seeds; a figure nobody has stays open."""
    rows = [
        {
            "task": "walk", "answers": answers, "rater": "perfect", "method": "default",
            "seed": seed, "fraction": fraction, "tracking_error_m_s": 0.1,
            "start_tracking_error_m_s": 0.3, "accuracy": 0.8 + 0.1 * seed, "ece": None,
            "minutes": 5.0 if seed else None, "return": fraction, "start_return": 0.4,
            "verdict": "better" if seed else "not known",
        }
        for answers, fractions in ((40, (0.2, 0.9, 0.5)), (100, (0.9,)))
        for seed, fraction in enumerate(fractions)
    ]  # fmt: skip
    few, many = together(rows)
    assert (few["fraction_median"], few["fraction_min"], few["seeds"]) == (0.5, 0.2, 3)
    assert (few["accuracy"], few["ece"], few["minutes"]) == (0.9, None, 5.0)
    assert many["answers"] == 100
    # Nobody called worse the one that is, and it was not called better.
    assert few["verdicts"] == "2 of 2 better, 0 of 1 worse"
    tables = f"{between(MARK, 'old')}{between(EARLIER, 'older')}"
    (tmp_path / "benchmarks.md").write_text(f"before\n{tables}after\n")
    earlier = [row | {"answers": answers} for answers in (60, 100) for row in rows[:1]]
    publish_rows(rows, tmp_path, None, earlier=earlier)
    page = (tmp_path / "benchmarks.md").read_text()
    assert page.startswith("before\n")
    assert page.endswith("\nafter\n")
    assert "old" not in page
    assert "| walk, 40 answers | 3 | 0.50 (0.20 to 0.90) |" in page
    assert [page.count(f"| walk, {answers} answers |") for answers in (60, 100)] == [
        1,
        1,
    ]


def test_what_runs_said_is_counted_beside_how_they_ended() -> None:
    """A row that stands in two places counts once; one without a verdict does not."""
    row = {
        "task": "trot", "answers": 20, "rater": "perfect", "robot": None, "seed": 0,
        "method": "default", "start_return": 0.4, "return": 1.0, "verdict": "better",
    }  # fmt: skip
    rows = [
        row, row, row | {"seed": 1, "verdict": "not known", "alarms": 2},
        row | {"seed": 2, "verdict": None},
        row | {"method": "linear", "return": 0.4},
        row | {"method": "linear", "return": 0.1, "seed": 1, "verdict": "not better"},
    ]  # fmt: skip
    told = verdict_table.markdown(verdict_table.ended(rows)).splitlines()
    assert told[2] == "| the loop as it is, ended better | 2 | 1 | 0 | 1 | 1 of 1 |"
    end = "| with a decision left out, ended equal or worse | 2 | 1 | 1 | 0 | - |"
    assert told[5] == end
    assert told[-1] == "Of 4 runs 3 were decided, 2 of these rightly."


def test_what_a_decision_is_worth_stands_in_the_method(tmp_path: Path) -> None:
    """From rows with it and without it that began with the same walk."""
    row = {
        "task": "trot", "answers": 20, "rater": "perfect", "robot": None,
        "tracking_error_m_s": 0.1, "start_tracking_error_m_s": 0.05, "accuracy": 0.8,
        "ece": None, "minutes": 5.0, "return": 1.0, "start_return": 0.4,
    }  # fmt: skip
    rows = [
        row | {"method": method, "seed": seed, "fraction": fraction + 0.1 * seed}
        for method, fraction in (("default", 0.7), ("linear", 0.4))
        for seed in range(3)
    ]
    later = [each | {"start_return": 0.5, "fraction": 0.0} for each in rows[:3]]
    (tmp_path / "method.md").write_text(between("ablations", ""))
    ablations.publish([*rows, *later], tmp_path)
    worth = (tmp_path / "method.md").read_text()
    assert "| 3 | +0.300 ± 0.000 | +0.000 m/s | open: 3 of 6 pairs |" in worth
    # Where both rows are the same run the decision was not asked.
    same = [each | {"method": "linear", "task": "pace"} for each in rows[:3]]
    pace = [each | {"task": "pace"} for each in rows[:3]]
    ablations.publish([*rows, *later, *same, *pace], tmp_path)
    worth = (tmp_path / "method.md").read_text()
    assert "| 6, 3 alike | +0.150 ± 0.067 | +0.000 m/s | stays |" in worth
    (tmp_path / "method.md").write_text("no place for it\n")
    with pytest.raises(GaitprefError, match="has no lines <!-- ablations: begin -->"):
        ablations.publish(rows, tmp_path)


def test_the_held_back_task_is_not_run_by_chance() -> None:
    """Only by its name; every cell of a plan has a file name of its own."""
    cells = plan(seeds=None)
    assert not {cell.task for cell in cells} & set(HELD_BACK)
    assert {cell.task for cell in plan(tasks=("pace",), seeds=2)} == {"pace"}
    assert len({cell.name for cell in cells}) == len(cells)
    assert [cell.seed for cell in cells] == sorted(cell.seed for cell in cells)


def test_every_method_is_one_of_the_sides_it_is_named_for() -> None:
    """A plan leaves out what changes a decision that styles lack."""
    for name, method in METHODS.items():
        of_style = name not in SCRATCH_ONLY
        assert bool(plan(tasks=("high_step",), methods=(name,), seeds=1)) == of_style
        method(FROM_SCRATCH)
        if of_style:
            method(STYLE)
            continue
        with pytest.raises(ValueError, match="is of rewards of kind linear"):
            method(STYLE)


def test_every_figure_has_its_rows() -> None:
    """A loop can be asked each; none is run where no figure is named, and rates are
    searched on seeds that no table has."""
    usual = {cell.name for cell in plan(seeds=None)}
    for name, figure in FIGURES.items():
        cells = plan(figure=name, seeds=None)
        assert {cell.method for cell in cells} == set(figure.methods)
        counts = sum(count for *_, count in figure.rows)
        assert len({cell.name for cell in cells}) == len(figure.methods) * counts
        assert not {cell.name for cell in cells} <= usual
    for scratch in (True, False):
        asked = (
            c for c in plan(figure="answers", seeds=1) if c.from_scratch == scratch
        )
        fewest = min(asked, key=lambda cell: cell.answers)
        cfg_of(fewest, None if scratch else WALK, quick=False)
    peers = plan(figure="peers", answers=(500,), seeds=None)
    assert {cell.method for cell in peers} > {"prefppo", "surf", "rime"}
    assert {cell.rater for cell in peers} == {"perfect", "mistakes20"}
    rates = [
        METHODS[name](FROM_SCRATCH).reward.settings_of(RawCfg).learning_rate
        for name in FIGURES["rates"].methods
    ]
    assert sorted(set(rates)) == pytest.approx([1e-4, 3e-4, 9e-4])
    assert min(cell.seed for cell in plan(figure="rates", seeds=None)) == 100


def test_who_has_to_get_up_begins_lying() -> None:
    """And no task reward is kept, which would teach it without any answer."""
    (cell,) = plan(tasks=("get_up",), seeds=1)
    cfg = cfg_of(cell, None, quick=False)
    assert cfg.env.getup is not None
    assert not cfg.keeps_task
    (walk, *_) = plan(tasks=("walk",), seeds=1)
    assert cfg_of(walk, None, quick=False).env.getup is None


def test_the_wishes_are_outside_the_descriptor_table() -> None:
    """Rows with equal descriptors of which a wish prefers one, whatever the weights."""
    row = torch.zeros(FEATURE_DIM)
    row[column("gravity_b")] = torch.tensor([-0.15, 0.0, -0.98])
    row[column("base_lin_vel_b")][0] = 0.5
    down = row.clone()
    down[column("gravity_b")][0] = 0.15
    assert torch.equal(describe(row), describe(down))
    assert nose_up_when_slow(row) > 0.9
    assert nose_up_when_slow(down) < 0.1
    lifted, other = torch.zeros(2, FEATURE_DIM)
    lifted[column("foot_height")], lifted[column("foot_contact")] = (
        torch.tensor([0.06, 0.0, 0.0, 0.0]),
        torch.tensor([0.0, 1.0, 1.0, 1.0]),
    )
    other[column("foot_height")] = lifted[column("foot_height")].roll(2)
    other[column("foot_contact")] = lifted[column("foot_contact")].roll(2)
    assert torch.allclose(describe(lifted), describe(other))
    assert carried_right_foot(lifted) > 0.9
    assert carried_right_foot(other) < 0.2


def test_nothing_is_lost_or_doubled_in_an_hour_in_short() -> None:
    """Eight raters answer at once; the benchmark does the same for longer."""
    figures = hour.measured(6)
    assert figures.hour_answers == 8 * 6
    assert figures.hour_lost == figures.hour_doubled == 0
    # Eight pages at work: no leak shows in so little, but a burst would.
    assert figures.hour_memory_growth_mb < 60


@pytest.mark.parametrize("part", ["batch", "env_learned", "ppo_learned"])
def test_a_step_is_measured(part: throughput.Part) -> None:
    """Physics alone, the environment, and PPO each count what they did."""
    figures = throughput.measure_part(part, 4, 0.05)
    assert figures["steps_per_s"] > 0
    # A step of the whole cannot take less of the processor than MuJoCo's five.
    assert figures["cpu_us"] > 20


def test_a_step_costs_a_small_multiple_of_its_physics() -> None:
    """A tripwire for work that creeps into the step, loose for a busy machine."""
    batch = throughput.measure_part("batch", 64, 0.5)
    env = throughput.measure_part("env", 64, 0.5)
    assert env["cpu_us"] < 4 * batch["cpu_us"]


def test_the_time_to_a_walk(tmp_path: Path) -> None:
    """A robot that has hardly learned does not walk, and a finished seed is kept."""
    figures, work = tmp_path / "walk.json", tmp_path / "work"
    options = walk.Options(
        work=work, more="--observe imu --history 2", quick=True, json=figures
    )
    walk.main(options)
    result = json.loads(figures.read_text())
    assert result["walked"] == 0
    assert result["wall_s_median"] is result["wall_s_worst"] is None
    assert result["steps_0"] == 12_288
    assert result["tracking_error_m_s_0"] > TRACKING_ERROR_M_S
    assert len(list((work / "seed-0" / "checkpoints").glob("*.pt"))) == 1
    law = load_policy(work / "seed-0" / "policy.pt").info.env.law
    assert law is not None
    assert law.obs_dim == 2 * 45
    finished = (work / "seed-0" / "policy.pt").stat().st_mtime_ns
    walk.main(options)
    assert (work / "seed-0" / "policy.pt").stat().st_mtime_ns == finished


def test_a_seed_that_never_walks_is_the_worst() -> None:
    """The median stands as long as most seeds walk."""
    seeds = [walk.Outcome(wall_s, 1, 0.1, 9.0) for wall_s in (90.0, None, 120.0)]
    figures = walk.figures_of(seeds)
    assert (figures["wall_s_median"], figures["wall_s_worst"]) == (120.0, None)
    assert figures["walked"] == 2


def test_fresh_pairs_are_answered_as_the_rater_does(tmp_path: Path) -> None:
    """Who never errs says what the criterion says; who does, the opposite at times."""
    cfg = small_cfg()
    run_loop(tmp_path / "run", cfg)
    policy = load_policy(tmp_path / "run/rounds/00/policy/policy.pt")
    context = criterion_context(policy.robot(), policy.info.env)
    criterion = load_criterion(cfg.criterion, context)
    pairs = preference_fresh.fresh_pairs(tmp_path / "run", cfg, criterion)
    meant = pairs.target[:, None]
    assert (pairs.answers == meant).all()
    erring = replace(cfg, simulated=RaterCfg(mistakes=0.3))
    pairs = preference_fresh.fresh_pairs(tmp_path / "run", erring, criterion)
    wrong = (pairs.answers != meant)[pairs.target != 0.5].float().mean()
    assert wrong == pytest.approx(0.3, abs=0.05)
    found = preference_fresh.on_fresh_pairs(tmp_path / "run", erring, criterion)
    again = preference_fresh.on_fresh_pairs(tmp_path / "run", cfg, criterion)
    assert found["fresh_accuracy"] == again["fresh_accuracy"]
    assert found["fresh_ece"] != again["fresh_ece"]
    by_chance = [each["fresh_ece_by_chance"] or 0.0 for each in (found, again)]
    assert all(0.0 < share < 0.1 for share in by_chance)
