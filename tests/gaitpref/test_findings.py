"""Whether a reward may be believed is one sentence, and made of the figures."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from data.datasets.dataset import Dataset
from data.features import column
from gaitpref.cli.main import main
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_report import read_rounds
from gaitpref.raters.rater_cfg import RaterCfg
from gaitpref.report.findings import NO_ALARM, findings_of_run
from gaitpref.report.return_text import return_text
from gaitpref.report.trust_section import alarm_section
from policy.training.checkpoint import load_policy
from rewardmodel import FitCfg, fit_reward, load_reward
from rewardmodel.trust.alarms import Reach, alarms, prefers
from rewardmodel.trust.support import Drift
from tests.helpers.small_loop import small_cfg
from tests.rewardmodel.test_fit import answered, gait

CFG = replace(small_cfg(), simulated=RaterCfg(equal=1e9))
"""A loop with a rater to whom all is equal."""


@dataclass(frozen=True)
class Told:
    """A run, and what was said while it ran."""

    run: Path
    words: str


@pytest.fixture(scope="module")
def nothing(tmp_path_factory: pytest.TempPathFactory) -> Told:
    """The loop, as a process."""
    run = tmp_path_factory.mktemp("loop") / "run"
    code = (
        "import sys; from pathlib import Path; import torch; "
        "torch.set_num_threads(1); from gaitpref.loop.run import run_loop; "
        f"from {__name__} import CFG; run_loop(Path(sys.argv[1]), CFG)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(run)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return Told(run, " ".join((done.stdout + done.stderr).split()))


def test_a_loop_whose_answers_prefer_nothing_goes_on_and_trains_on_none(
    nothing: Told,
) -> None:
    """The reward is 0, it is said why, the policy stays, and each round asks again."""
    run, told = nothing.run, nothing.words
    assert "answers prefer a clip and are not taken back by another" in told
    assert "a reward needs 8: it is 0" in told
    assert "because the answers prefer too little; asking again" in told
    assert "because the answers prefer too little; no round is left" in told
    assert "no alarm" not in told
    policies = [load_policy(run / f"rounds/0{n}/policy/policy.pt") for n in range(3)]
    assert len({policy.sha256 for policy in policies}) == 1
    model = load_reward(run / "rounds/01/reward")
    features = torch.tensor(np.stack(_rows(run), axis=1))
    assert (model(features, torch.zeros(features.shape[:2])) == 0.0).all()
    report = json.loads((run / "rounds/01/report.json").read_text())
    assert not report["trust"]["deserves_training"]
    assert report["trust"]["alarm"].startswith("0 of ")
    page = (run / "report/index.html").read_text()
    assert "0 of " in page
    assert "No alarm" not in page


def test_a_loop_goes_on_without_episodes_that_are_gone(
    nothing: Told, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One of the first round's, about which it was answered; the next round asks about
    the others and counts what it leaves out."""
    run = Path(shutil.copytree(nothing.run, tmp_path / "run"))
    for number in (1, 2):
        shutil.rmtree(run / f"rounds/0{number}")
    dataset = Dataset.open(run / "dataset")
    with dataset.answers_copy() as store:
        asked = next(pair for pair in store.pairs() if pair.round == 0)
    dataset.path_of(dataset.entry(asked.a.rollout)).unlink()
    main(["data", "recover", "--dataset", str(dataset.root)])
    run_loop(run, CFG)
    read = capsys.readouterr()
    told = " ".join((read.out + read.err).split())
    assert "answers are about episodes that are gone and are left out" in told
    assert (run / "rounds/02/report.json").exists()


def _rows(run: Path) -> list[np.ndarray]:
    dataset = Dataset.open(run / "dataset")
    entries = [entry for entry in dataset.entries() if entry.num_steps >= 20]
    return [dataset.features(entry.sha256)[:20] for entry in entries[:4]]


@pytest.fixture
def finished(nothing: Told, tmp_path: Path) -> Path:
    """A copy of the run with other figures, all of which are fine."""
    run = Path(shutil.copytree(nothing.run, tmp_path / "run"))
    accuracy = {"share": 0.9, "interval": [0.8, 0.95], "answers": 60}
    drift = {"share_far": 0.2, "quantile": 0.6, "share_overpaid": 0.1}
    policy = {
        "drift": drift | {"extrapolated": 0.1, "pieces": 100},
        "spread": 1.0,
        "spread_judged": 1.0,
    }
    fine = {
        "power_w": 65.0,
        "tracking_error_m_s": 0.05,
        "falls_per_minute": 0.0,
        "return_mean": 3.0,
        "return_ci95": 0.1,
    }
    for path, report in zip(_reports(run), read_rounds(run), strict=True):
        trust = {"alarm": None, "alarms": [], "deserves_training": True}
        trust |= {"accuracy": accuracy} if "fit" in report else {"policy": policy}
        report |= {"trust": trust, "training": {"policy/reference_kl": 20.0}}
        report["evaluation"] |= fine
        path.write_text(json.dumps(report))
    return run


def _reports(run: Path) -> list[Path]:
    return sorted(run.glob("rounds/*/report.json"))


def _change(
    run: Path, number: int, place: tuple[str, ...], key: str, value: Any
) -> None:
    """Put one other figure into the report of a round."""
    path = _reports(run)[number]
    report = json.loads(path.read_text())
    part = report
    for name in place:
        part = part[name]
    part[key] = value
    path.write_text(json.dumps(report))


def _said(run: Path) -> str:
    """What the page of the run says of trust."""
    return re.sub("<[^>]*>", " ", alarm_section(read_rounds(run), "task"))


def test_where_all_figures_are_fine_the_page_says_so(finished: Path) -> None:
    assert _said(finished).strip() == f"N{NO_ALARM[1:]}."


def test_the_page_of_a_run_that_went_far_says_so(finished: Path) -> None:
    """Beside its table: all motion far, a drift of 238 nats, thrice the power."""
    _change(finished, 2, ("trust", "policy", "drift"), "share_far", 1.0)
    _change(finished, 2, ("training",), "policy/reference_kl", 237.8)
    _change(finished, 2, ("evaluation",), "power_w", 220.0)
    assert main(["report", "--run", str(finished)]) == 0
    page = (finished / "report/index.html").read_text()
    assert "237.8 nats" in page
    assert "<p>Look before you trust it: 100% of its motion is far from every" in page
    assert "it drifted 238 nats a step from the policy before" in page
    assert "power rose from 65 to 220 W, 3.4 times the first policy&#x27;s" in page
    assert "no alarm" not in page.lower()


@pytest.mark.parametrize(
    ("place", "key", "value", "told"),
    [
        (("trust", "policy", "drift"), "share_far", 1.0, "100% of its motion is far"),
        (("trust", "policy", "drift"), "share_overpaid", 0.95, "95% is paid more"),
        (("trust", "policy"), "drift", None, "no episode is long enough to tell"),
        (("training",), "policy/reference_kl", 237.8, "drifted 238 nats a step"),
        (("evaluation",), "power_w", 220.0, "power rose from 65 to 220 W, 3.4 times"),
        (("evaluation",), "tracking_error_m_s", 0.2, "error rose from 0.05 to 0.20"),
        (("evaluation",), "falls_per_minute", 3.0, "falls rose from 0.0 to 3.0"),
        (("evaluation",), "return_mean", 1.0, "fell from 3.00 ± 0.10 to 1.00 ± 0.10"),
        ((), "approval", {"approved": False, "for_new": 1, "for_old": 4}, "preferred"),
    ],
)
def test_no_figure_that_speaks_against_it_stands_beside_no_alarm(
    finished: Path, place: tuple[str, ...], key: str, value: object, told: str
) -> None:
    """Each for itself; the page says which, and how much."""

    _change(finished, 2, place, key, value)
    said = _said(finished)
    assert "Look before you trust it" in said
    assert told in said
    assert "no alarm" not in said.lower()


def test_answers_too_few_for_an_alarm_are_no_all_clear_on_the_page(
    finished: Path,
) -> None:
    """Of the fit before the last training, whose answers these are."""
    few = {"share": 0.5, "interval": [0.2, 0.8], "answers": 12}
    _change(finished, 1, ("trust",), "accuracy", few)
    said = _said(finished)
    assert "Too few answers to tell: 12 held-out answers prefer a clip, 40" in said
    assert "no alarm" not in said.lower()


def test_a_rater_who_does_not_look_is_told_on_the_page(finished: Path) -> None:
    """Also where nobody was asked after the last training, and in older reports of
    which some figures are missing."""
    guessing = (
        "ann answers as if at random, in 95% of the cases, or wants something else "
        "than most (`gaitpref raters --dataset DIR groups` tells)"
    )
    _change(finished, 1, ("trust",), "raters", [guessing])
    _change(finished, 2, ("trust", "policy"), "drift", {"share_far": 1.0})
    said = _said(finished)
    before, command, after = guessing.split("`")
    assert f"Look before you trust it: {before} {command} {after}" in said
    assert "100% of its motion is far" in said


def test_an_alarm_is_not_said_twice(finished: Path) -> None:
    """The figure it names is not listed again among those to look at."""
    drift = Drift(1.0, 1.0, 0.0, 1.5, 10)
    (reason, _) = alarms(None, Reach(drift=drift, spread=9.0, spread_judged=1.0))
    _change(finished, 2, ("trust", "policy"), "drift", vars(drift))
    _change(finished, 2, ("trust",), "alarms", [reason])
    said = _said(finished)
    assert said.count("100% of its motion is far") == 1
    assert "no alarm" not in said.lower()


def test_what_was_judged_since_and_is_liked_is_no_false_alarm() -> None:
    """A policy that went where nobody had judged, to be asked about, and was."""
    far = Reach(drift=Drift(1.0, 1.0, 0.0, 1.5, 10), spread=9.0, spread_judged=1.0)
    assert alarms(None, far)
    assert alarms(None, far, confirmed=True) == ()


def test_what_was_judged_since_and_is_not_liked_is_not_confirmed() -> None:
    """The reward that learned to dislike torque prefers what strains less than the
    judged clips, and not what exploits a reward by straining."""
    pairs = answered(100, seed=0)
    model, _ = fit_reward(pairs, FitCfg(), seed=0, measured=False)
    rng = np.random.default_rng(5)
    rows = torch.tensor(np.stack([gait(rng, 48) for _ in range(8)], axis=1))
    lengths = torch.full((8,), 48)
    for times, liked in ((0.2, True), (4.0, False)):
        changed = rows.clone()
        changed[..., column("joint_torque")] *= times
        assert prefers(model, changed, lengths, pairs) == liked


def test_people_are_not_told_of_a_criterion_they_do_not_follow(finished: Path) -> None:
    _change(finished, 2, ("evaluation",), "return_mean", 1.0)
    rounds = read_rounds(finished)
    assert findings_of_run(rounds, criterion="task").against
    assert findings_of_run(rounds, criterion=None).sentence == NO_ALARM


@pytest.mark.parametrize(
    ("mean", "ci95", "told"),
    [
        (5.5812, 0.0312, "5.58 ± 0.03"),
        (-0.00417, 0.00032, "-0.0042 ± 0.0003"),
        (118.2, 4.04, "118.20 ± 4.04"),
        (0.0, 0.0, "0.00 ± 0.00"),
    ],
)
def test_small_scores_are_told_to_the_digits_of_their_interval(
    mean: float, ci95: float, told: str
) -> None:
    assert return_text(mean, ci95) == told
