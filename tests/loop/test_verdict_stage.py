"""Where answers err, the last policy is judged beside the one before it."""

from __future__ import annotations

import html
import io
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from data.answers.strategy_names import APPROVAL
from data.datasets.dataset import Dataset
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.report_stage import began_with
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_dir import Round, seed_of
from gaitpref.method.acceptance import Compared, Duel
from gaitpref.raters.rater_cfg import RaterCfg
from gaitpref.report.verdict import Verdict
from policy.rollouts.evaluate import evaluate
from policy.training.checkpoint import holding_home, load_policy, read_plain
from rewardmodel.models.storage import load_reward
from tests.helpers.small_loop import small_cfg, stopped

KEPT = 7


def erring_cfg() -> LoopCfg:
    """Answers enough to see that a fifth of them is wrong, and a first policy that was
    trained on episodes long enough to be worse than one that stands."""
    cfg = small_cfg(seed=3)
    long = replace(cfg.env, episode_s=10.0)
    return replace(cfg, env=long, labels=70, simulated=RaterCfg(mistakes=0.2))


def judging(cfg: LoopCfg, accept: Compared) -> LoopCfg:
    return replace(cfg, method=replace(cfg.method, accept=accept))


@pytest.fixture(scope="module")
def before_approval(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small loop, killed when its last policy was trained and not yet judged."""
    run = tmp_path_factory.mktemp("loop") / "run"
    stopped("show_stage", erring_cfg().rounds, run, erring_cfg())
    return run


def wild(path: Path) -> bytes:
    """The policy of a file, its actions many times as large."""
    payload = read_plain(path)
    actor = payload["actor_state_dict"]
    actor[[name for name in actor if name.startswith("mlp.")][-2]] *= 50.0
    return saved(payload)


def saved(payload: dict[str, Any]) -> bytes:
    """The file of a policy that was changed."""
    file = io.BytesIO()
    torch.save(payload, file)
    return file.getvalue()


def leaning(file: Path) -> bytes:
    """The policy of a robot that was trained to stand, a thousandth beside home."""
    payload = read_plain(file)
    *_, bias = (n for n in payload["actor_state_dict"] if n.startswith("mlp."))
    payload["actor_state_dict"][bias].fill_(1e-3)
    return saved(payload)


def with_one_that_stands(run: Path, stands: str) -> bytes:
    """Put a robot that stands still in place of the old or the new last policy, and one
    that throws its legs about in place of the other; the former's file."""
    files = {
        "old": run / "rounds/01/policy/policy.pt",
        "new": run / "rounds/02/candidate/policy.pt",
    }
    for which, file in files.items():
        file.write_bytes(holding_home(file) if which == stands else wild(file))
    return files[stands].read_bytes()


def asked(run: Path) -> list[int]:
    with Dataset.open(run / "dataset").answers() as store:
        return [len(store.pairs(round=number)) for number in range(3)]


def test_answers_are_kept_for_it(before_approval: Path) -> None:
    """Nothing is lost, and nothing is called the round's policy yet."""
    first, second, last = asked(before_approval)
    assert (first + second, last) == (70 - KEPT, 0)
    assert (before_approval / "rounds/02/candidate/policy.pt").exists()
    assert not (before_approval / "rounds/02/policy").exists()


@pytest.mark.parametrize("stands", ["old", "new"])
def test_the_better_of_the_two_stays(
    before_approval: Path, tmp_path: Path, stands: str
) -> None:
    """A robot that stands still is better than one that throws its legs about; a killed
    loop asks nothing twice."""
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    with_one_that_stands(run, stands)
    file = run / {"old": "rounds/01/policy", "new": "rounds/02/candidate"}[stands]
    expected = leaning(file / "policy.pt")
    (file / "policy.pt").write_bytes(expected)
    counts = set[int]()
    for _ in range(2):
        run_loop(run, erring_cfg())
        assert (run / "rounds/02/policy/policy.pt").read_bytes() == expected
        counts.add(asked(run)[2])
        assert 0 < max(counts) <= KEPT
        report = json.loads((run / "rounds/02/report.json").read_text())
        found = report["verdict"]
        assert found["stays"] == {"old": 1, "new": 2}[stands]
        before = Duel(**found["beside_before"])
        assert (before.for_new >= before.for_old) == (stands == "new")
        page = (run / "report/index.html").read_text()
        assert html.escape(found["sentence"]) in page
        assert re.search(
            r"the robot goes nowhere: 0\.0\d m/s where told 0\.[4-9]", found["sentence"]
        )
        assert ("preferred that to the last" in page) == (stands == "old")
        # As a process leaves it that is killed when all is answered.
        for unfinished in ("verdict.json", "report.json"):
            (run / "rounds/02" / unfinished).unlink()
        trained = run / "rounds/02/policy"
        if stands == "new":
            trained.rename(run / "rounds/02/candidate")
        else:
            shutil.rmtree(trained)
    assert len(counts) == 1


def test_a_robot_that_only_stands_is_no_better(
    before_approval: Path, tmp_path: Path
) -> None:
    """Though more answers prefer that to falling: nothing that was trained is."""
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    with_one_that_stands(run, "old")
    run_loop(run, erring_cfg())
    found = json.loads((run / "rounds/02/report.json").read_text())["verdict"]
    assert (found["stays"], found["word"]) == (1, "not better")
    assert "the robot stands still" in found["sentence"]
    # Wherever the run is by then.
    assert (
        "look at the clips that the reward likes best in RUN/report" in found["advice"]
    )


class _Away:
    """A collector of answers that nobody gives."""

    def __init__(self, **told: object) -> None:
        pass

    def answered(self, count: int, *, last: bool) -> bool:
        return False


def test_where_nobody_answers_no_more_is_asked_than_was_kept(
    before_approval: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the patience of each duel is over."""
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    monkeypatch.setattr("gaitpref.loop.verdict_stage.Collector", _Away)
    run_loop(run, erring_cfg())
    # Two that would make it 0.85 probable beside the one before, four beside the first.
    assert asked(run)[2] == 2 + 4
    found = json.loads((run / "rounds/02/report.json").read_text())["verdict"]
    assert (found["word"], found["stays"]) == ("not known", 2)


@pytest.mark.parametrize(
    ("for_new", "for_old", "stays", "word"),
    [(1, 3, 1, "not known"), (0, 4, 0, "not better"), (3, 1, 2, "not known")],
)
def test_the_first_stays_only_where_it_is_surely_preferred(
    before_approval: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    for_new: int,
    for_old: int,
    stays: int,
    word: str,
) -> None:
    """The policy before is put back by a majority, a whole run is not undone by it."""
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    said = Duel(for_new=for_new, for_old=for_old)
    monkeypatch.setattr("gaitpref.loop.verdict_stage.Collector", _Away)
    monkeypatch.setattr("gaitpref.loop.verdict_stage.duel_of", lambda *_: said)
    run_loop(run, erring_cfg())
    found = json.loads((run / "rounds/02/report.json").read_text())["verdict"]
    assert (found["stays"], found["word"]) == (stays, word)


def test_a_loop_killed_with_its_verdict_keeps_it(
    before_approval: Path, tmp_path: Path
) -> None:
    """The policy is put in its place after the verdict was written down."""
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    with_one_that_stands(run, "old")
    said = Verdict(stays=0, rounds=2, beside_first=Duel(for_new=0, for_old=4))
    (run / "rounds/02/verdict.json").write_text(json.dumps(said.as_json()))
    run_loop(run, erring_cfg())
    last, first = (run / f"rounds/0{n}/policy/policy.pt" for n in (2, 0))
    assert last.read_bytes() == first.read_bytes()
    assert asked(run)[2] == 0
    report = json.loads((run / "rounds/02/report.json").read_text())
    assert report["verdict"]["word"] == "not better"


def test_a_style_is_judged_at_its_end_and_not_before(tmp_path: Path) -> None:
    """Though no answer errs: nobody is asked after the longest training. Where the
    policy it began from is the first, there is one duel."""
    cfg = replace(small_cfg(), labels=40, rounds=1)
    run = tmp_path / "run"
    stopped("show_stage", 1, run, cfg)
    (run / "rounds/01/candidate/policy.pt").write_bytes(
        wild(run / "rounds/01/candidate/policy.pt")
    )
    run_loop(run, cfg)
    found = json.loads((run / "rounds/01/report.json").read_text())["verdict"]
    assert found["beside_before"] is None
    assert (found["stays"], found["word"]) == (0, "not better")
    with Dataset.open(run / "dataset").answers() as store:
        pairs = store.pairs()
    judged = [pair.round for pair in pairs if pair.strategy == APPROVAL]
    assert judged == [1] * 4


def test_a_policy_that_no_clip_shows_does_not_stay(
    before_approval: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where every simulation of it diverges."""
    monkeypatch.setattr("gaitpref.loop.verdict_stage.shown_by", lambda *_: False)
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    run_loop(run, erring_cfg())
    first, last = (run / f"rounds/0{n}/policy/policy.pt" for n in (0, 2))
    assert last.read_bytes() == first.read_bytes()


def test_each_pair_shows_both_policies_under_one_command(
    before_approval: Path, tmp_path: Path
) -> None:
    """Whichever of them is preferred."""
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    new, old, first = (
        load_policy(run / f"rounds/{place}/policy.pt").sha256
        for place in ("02/candidate", "01/policy", "00/policy")
    )
    run_loop(run, erring_cfg())
    dataset = Dataset.open(run / "dataset")
    with dataset.answers() as store:
        pairs = store.pairs(round=2)
    commands: dict[frozenset[str], list[tuple[float, ...]]] = {}
    for pair in pairs:
        metas = [dataset.entry(clip.rollout).meta for clip in (pair.a, pair.b)]
        assert pair.strategy == APPROVAL
        shown = frozenset(str(meta.policy_sha256) for meta in metas)
        assert shown in ({new, old}, {new, first}, {old, first})
        assert metas[0].command == metas[1].command
        assert metas[0].env_index == metas[1].env_index
        assert not any(meta.stochastic for meta in metas)
        commands.setdefault(shown, []).append(metas[0].command)
    assert len(commands) == 2
    # All five commands before any of them comes again.
    for of_duel in commands.values():
        assert len(set(of_duel[:5])) == len(of_duel[:5])


@pytest.mark.slow
def test_training_goes_on_from_the_policy_that_was_preferred(
    tmp_path: Path,
) -> None:
    """Where answers speak against the second retraining, the third begins where the
    second did, and is judged beside that."""
    run = tmp_path / "run"
    cfg = replace(erring_cfg(), rounds=3, labels=110, seed=1)
    cfg = judging(cfg, Compared(first=2, noisy_margin=-100))
    cfg = replace(cfg, method=replace(cfg.method, unstick=None))
    run_loop(run, cfg)
    first, second = (load_policy(run / f"rounds/0{n}/policy/policy.pt") for n in (1, 2))
    judged = [run / "rounds/03/policy", run / "rounds/03/candidate"]
    third = load_policy(next(p for p in reversed(judged) if p.exists()) / "policy.pt")
    assert second.info.steps > first.info.steps
    own = third.info.steps - first.info.steps
    assert own == second.info.steps - first.info.steps + 1536
    dataset = Dataset.open(run / "dataset")
    compared = []
    with dataset.answers() as store:
        assert store.count() <= 110
        for round in (2, 3):
            shown = {
                dataset.entry(clip.rollout).meta.policy_sha256
                for pair in store.pairs(round=round)
                if pair.strategy == APPROVAL
                for clip in (pair.a, pair.b)
            }
            compared.append(shown)
    zeroth = load_policy(run / "rounds/00/policy/policy.pt").sha256
    assert compared[0] == {first.sha256, second.sha256}
    assert second.sha256 not in compared[1]
    assert {first.sha256, third.sha256, zeroth} == compared[1]
    assert not json.loads((run / "rounds/02/approval.json").read_text())["approved"]
    # Whether the third training raised the reward is measured from where it began.
    reward = load_reward(run / "rounds/02/reward")
    began = evaluate(first, reward, episodes=8, seed=seed_of(cfg, 0, 6)).return_mean
    assert began_with(cfg, Round(run, 3)) == pytest.approx(began, abs=1e-4)
    report = json.loads((run / "rounds/02/report.json").read_text())
    assert began != pytest.approx(report["learned_return_next"], abs=1e-4)
