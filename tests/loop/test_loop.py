"""The loop: equal seeds, equal files; killed anywhere, the same files."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from gaitpref.cli.options.options import Loop
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.loop.loop_cfg import RunError
from gaitpref.loop.run import run_loop
from gaitpref.method.context import RoundContext
from policy.env.env_cfg import getup_env
from policy.training.checkpoint import load_policy
from tests.helpers.curves_of_reports import drawn
from tests.helpers.small_loop import small_cfg
from tests.helpers.small_sweep import made_by

STAGES = {
    "training": lambda run: (run / "rounds/01/policy.partial").exists(),
    "recording": lambda run: any((run / "dataset/rollouts").rglob("*.mcap")),
    "choosing pairs": lambda run: (run / "rounds/00/episodes.json").exists(),
    "answering": lambda run: _answers(run) >= 3,
    "fitting": lambda run: _answers(run) >= 12,
    "reporting": lambda run: (run / "rounds/00/reward").exists(),
    "last training": lambda run: (run / "rounds/02/policy.partial/resume.pt").exists(),
}


def _answers(run: Path) -> int:
    path = run / "dataset/preferences.sqlite"
    if not path.exists():
        return 0
    with AnswerStore.open(path) as store:
        return store.count()


def _judgements(run: Path) -> list[tuple[str, str, str]]:
    with Dataset.open(run / "dataset").answers() as store:
        return [(p.pair_id, a.choice, a.shown_left) for p, a in store.current_answers()]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small loop that nobody disturbed."""
    run = tmp_path_factory.mktemp("loop") / "run"
    with drawn():
        run_loop(run, small_cfg())
    return run


def test_every_stage_leaves_its_files(undisturbed: Path) -> None:
    """Two rounds: three policies, two rewards, 24 answers, a report."""
    policies = list(undisturbed.glob("rounds/*/policy/policy.pt"))
    assert len(policies) == 3
    assert all(load_policy(policy).info.ppo.mirror for policy in policies[1:])
    assert len(list(undisturbed.glob("rounds/*/reward/reward.safetensors"))) == 2
    assert len(_judgements(undisturbed)) == 24
    report = json.loads((undisturbed / "rounds/01/report.json").read_text())
    told = report["training"]
    shares = [value for name, value in told.items() if name.startswith("share/")]
    assert sum(shares) == pytest.approx(1.0)
    assert told["reward/spread"] > 0.0
    page = (undisturbed / "report/index.html").read_text()
    assert "score&#x27;s share" in page or "score's share" in page
    assert "<svg" in page
    assert "http://" not in re.sub(
        r"http://(www.w3.org|purl.org|creativecommons.org)", "", page
    )


def test_what_it_decided_on_the_way_is_told(
    undisturbed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By `gaitpref method --run`: of answers, trainings, and the end."""
    assert main(["method", "--run", str(undisturbed)]) == 0
    decided = capsys.readouterr().out.partition("on the way:\n")[2]
    told = json.loads((undisturbed / "rounds/00/decided.json").read_text())["told"]
    assert f"round 0: {told}" in decided
    for number in (1, 2):
        policy = load_policy(undisturbed / f"rounds/0{number}/policy/policy.pt")
        line = f"round {number}: steps counted in the mirror too"
        assert f"{line}, and its noise ended at a deviation of" in decided
        assert f"{float(policy.std.mean()):.2f}" in decided
    last = [p for p, *_ in _judgements(undisturbed)]
    with Dataset.open(undisturbed / "dataset").answers() as store:
        kept = [pair for pair in store.pairs(round=2) if pair.pair_id in last]
    found = re.search(r"round 2: (\d+) answers were kept to judge its policy", decided)
    assert found
    assert 4 <= len(kept) <= int(found[1]) <= 8
    verdict = json.loads((undisturbed / "rounds/02/verdict.json").read_text())
    assert f"the run: {verdict['sentence']}" in decided


def test_another_seed_gives_other_weights(undisturbed: Path, tmp_path: Path) -> None:
    """The seed reaches everything: nothing is equal by accident."""
    other = tmp_path / "run"
    run_loop(other, replace(small_cfg(seed=1), rounds=1))
    assert not set(made_by(other).values()) & set(made_by(undisturbed).values())


def test_killed_in_every_stage_it_ends_the_same(
    undisturbed: Path, tmp_path: Path
) -> None:
    """SIGKILL in each stage and the same command again: same files, no answer lost."""
    run = tmp_path / "run"
    command = [sys.executable, "-m", "tests.helpers.small_loop", str(run)]
    for stage, reached in STAGES.items():
        process = subprocess.Popen(command)
        deadline_s = time.monotonic() + 60
        while not reached(run) and process.poll() is None:
            assert time.monotonic() < deadline_s, f"{stage} was never reached"
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert subprocess.run(command, check=False).returncode == 0
    assert made_by(run) == made_by(undisturbed)
    assert _judgements(run) == _judgements(undisturbed)


def test_a_loop_about_getting_up(tmp_path: Path, undisturbed: Path) -> None:
    """Every episode begins lying, and a policy that walks is no start for it."""
    walks = undisturbed / "rounds/02/policy/policy.pt"
    options = Loop(run=tmp_path / "run", base=str(walks), getup=True)
    with pytest.raises(RunError, match="never trained lying"):
        resolve(options)
    cfg = replace(small_cfg(), rounds=1, labels=12)
    run_loop(tmp_path / "run", replace(cfg, env=getup_env(cfg.env)))
    entries = Dataset.open(tmp_path / "run/dataset").entries()
    assert {entry.meta.task for entry in entries} == {"getup"}
    policy = load_policy(tmp_path / "run/rounds/01/policy/policy.pt")
    assert policy.info.env.getup is not None


@pytest.mark.slow
def test_a_round_stops_asking_where_answers_are_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a batch and not in the middle of one; going on again asks nothing more."""
    for name, never_missed in (("SETTLED", -1.0), ("FORESEEN", -1.0)):
        monkeypatch.setattr(f"rewardmodel.fitting.stopping.{name}", never_missed)
    monkeypatch.setattr("rewardmodel.fitting.stopping.MIN_HELD_OUT", 1)
    cfg = replace(small_cfg(), stop_asking=True, labels=30)
    cfg = replace(cfg, method=replace(cfg.method, accept=None))
    batch = cfg.method.questions.batch
    first = RoundContext(number=0, rounds=cfg.rounds, labels=cfg.labels)
    assert cfg.method.budget.labels_of(first) > batch
    for _ in range(2):
        run_loop(tmp_path / "run", cfg)
        with Dataset.open(tmp_path / "run/dataset").answers() as store:
            asked = [len(store.pairs(round=number)) for number in range(2)]
            assert asked[0] == batch
            assert store.count() == sum(asked) < cfg.labels
        # As a process leaves it that is killed when all is answered and not yet fitted.
        for unfinished in ("rounds/01/reward", "rounds/02"):
            shutil.rmtree(tmp_path / "run" / unfinished)
