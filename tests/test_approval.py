"""Where answers err, the last policy is judged beside the one before it."""

from __future__ import annotations

import io
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from data.dataset import Dataset
from gaitpref.loop import run_configured
from gaitpref.loop_cfg import LoopCfg
from gaitpref.method.acceptance import Compared, Verdict
from gaitpref.method.context import RoundContext
from gaitpref.rater_cfg import RaterCfg
from gaitpref.rounds import Round, seed_of
from gaitpref.side_by_side import STRATEGY, verdict_of
from gaitpref.stages import began_with
from gaitpref.watch import SURELY_BETTER
from policy.checkpoint import holding_home, load_policy, read_plain
from policy.evaluate import evaluate
from rewardmodel.noise_level import ERROR_SHARES
from rewardmodel.storage import load_reward

from .small_loop import small_cfg

KEPT = 7
ODDS_TO_STAY = Compared(first=1).odds_to_stay


def erring_cfg() -> LoopCfg:
    """Answers enough to see that a fifth of them is wrong."""
    return replace(small_cfg(seed=1), labels=70, simulated=RaterCfg(mistakes=0.2))


def judging(cfg: LoopCfg, accept: Compared) -> LoopCfg:
    return replace(cfg, method=replace(cfg.method, accept=accept))


class _Killed(Exception):
    pass


def _killed_at_the_end(cfg: LoopCfg, round: Round, *others: object) -> None:
    if round.number == cfg.rounds:
        raise _Killed


@pytest.fixture(scope="module")
def before_approval(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small loop, killed when its last policy was trained and not yet judged."""
    run = tmp_path_factory.mktemp("loop") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gaitpref.loop.show_stage", _killed_at_the_end)
        with pytest.raises(_Killed):
            run_configured(run, erring_cfg())
    return run


def wild(path: Path) -> bytes:
    """The policy of a file, its actions many times as large."""
    payload = read_plain(path)
    actor = payload["actor_state_dict"]
    actor[[name for name in actor if name.startswith("mlp.")][-2]] *= 50.0
    file = io.BytesIO()
    torch.save(payload, file)
    return file.getvalue()


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
    expected = with_one_that_stands(run, stands)
    counts = set[int]()
    for _ in range(2):
        run_configured(run, erring_cfg())
        assert (run / "rounds/02/policy/policy.pt").read_bytes() == expected
        # One that falls at once leaves few clips to show.
        counts.add(asked(run)[2])
        assert 0 < max(counts) <= KEPT
        report = json.loads((run / "rounds/02/report.json").read_text())
        found = report["approval"]
        liked = report["trust"]["confirmed"]
        assert liked or stands == "old" or found["odds"] < SURELY_BETTER
        assert found["approved"] == (stands == "new")
        assert found["for_new"] + found["for_old"] in counts
        page = (run / "report/index.html").read_text()
        assert "New policies were judged" in page
        assert ("so the one before was kept" in page) == (stands == "old")
        assert "nothing says that" not in page or stands == "new"
        # As a process leaves it that is killed when all is answered.
        for unfinished in ("approval.json", "report.json"):
            (run / "rounds/02" / unfinished).unlink()
        trained = run / "rounds/02/policy"
        if stands == "new":
            trained.rename(run / "rounds/02/candidate")
        else:
            shutil.rmtree(trained)
    assert len(counts) == 1


@pytest.mark.parametrize("stands", ["old", "new"])
def test_a_style_is_judged_at_its_end_though_no_answer_errs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stands: str
) -> None:
    """Nobody is asked after the longest training; rounds before it ask as ever."""
    cfg = judging(replace(small_cfg(), labels=40), Compared(first=1, last_labels=5))
    run = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr("gaitpref.loop.show_stage", _killed_at_the_end)
        with pytest.raises(_Killed):
            run_configured(run, cfg)
    assert not json.loads((run / "rounds/00/decided.json").read_text())["noisy"]
    assert (sum(asked(run)), asked(run)[2]) == (35, 0)
    expected = with_one_that_stands(run, stands)
    run_configured(run, cfg)
    assert (run / "rounds/02/policy/policy.pt").read_bytes() == expected
    with Dataset.open(run / "dataset").answers() as store:
        pairs = store.pairs()
    judged = {pair.round for pair in pairs if pair.strategy == STRATEGY}
    assert judged == {2}


def test_a_policy_that_no_clip_shows_is_not_approved(
    before_approval: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where every simulation of it diverges: the one before stays."""
    monkeypatch.setattr("gaitpref.approval.pairs_of_both", lambda *_, **__: [])
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    run_configured(run, erring_cfg())
    before, last = (run / f"rounds/0{n}/policy/policy.pt" for n in (1, 2))
    assert last.read_bytes() == before.read_bytes()


def test_each_pair_shows_both_policies_under_one_command(
    before_approval: Path, tmp_path: Path
) -> None:
    """Whichever of them is preferred."""
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    new, old = (
        load_policy(run / f"rounds/{place}/policy.pt").sha256
        for place in ("02/candidate", "01/policy")
    )
    assert new != old
    run_configured(run, erring_cfg())
    dataset = Dataset.open(run / "dataset")
    with dataset.answers() as store:
        pairs = store.pairs(round=2)
    commands = []
    for pair in pairs:
        metas = [dataset.entry(clip.rollout).meta for clip in (pair.a, pair.b)]
        assert pair.strategy == STRATEGY
        assert {meta.policy_sha256 for meta in metas} == {new, old}
        assert metas[0].command == metas[1].command
        assert metas[0].env_index == metas[1].env_index
        assert not any(meta.stochastic for meta in metas)
        commands.append(metas[0].command)
    # All five commands before any of them comes again.
    assert len(set(commands[:5])) == 5


@pytest.mark.parametrize(
    ("for_new", "for_old", "error_share", "odds", "approved"),
    [
        (4, 3, 0.4, 4.0, True),
        (5, 2, 0.7, (13 / 7) ** 3, True),
        (3, 3, 0.4, 1.0, True),
        (3, 4, 0.5, 1 / 3, True),
        (3, 4, 0.4, 1 / 4, False),
        (1, 6, 0.2, 9.0**-5, False),
    ],
)
def test_the_odds_are_those_of_erring_answers(
    for_new: int, for_old: int, error_share: float, odds: float, approved: bool
) -> None:
    """Each answer is wrong in half of the cases in which it is random, and new policies
    are better ten times as often as not."""
    found = Verdict(
        for_new=for_new, for_old=for_old, error_share=error_share, needed=ODDS_TO_STAY
    )
    assert found.odds == pytest.approx(odds)
    assert found.approved == approved


@pytest.mark.parametrize(
    ("number", "noisy", "labels", "judges", "needed"),
    [
        (1, False, 5, False, 0.1),
        (1, True, 7, False, 0.1),
        (2, False, 5, False, 0.1),
        (2, True, 7, True, 0.1),
        (3, False, 5, True, 0.1),
        (3, True, 7, True, 0.3),
    ],
)
def test_the_last_is_judged_and_where_answers_err_those_before(
    number: int, noisy: bool, labels: int, judges: bool, needed: float
) -> None:
    """The last more strictly where they err: nothing trains away what is wrong."""
    compared = Compared(first=2, last_labels=5)
    context = RoundContext(number=number, rounds=3, labels=60, noisy=noisy)
    assert compared.labels(context) == labels
    assert compared.judges(context) == judges
    assert compared.odds_needed(context) == pytest.approx(needed)


def test_a_last_round_before_the_first_that_is_judged_is_not() -> None:
    context = RoundContext(number=1, rounds=1, labels=60, noisy=True)
    assert not Compared(first=2).judges(context)
    assert Compared(first=1).judges(context)


@pytest.mark.parametrize(("for_new", "approved"), [(3, True), (2, False)])
def test_odds_as_large_as_needed_do(for_new: int, approved: bool) -> None:
    """Of answers random in half of the cases, each makes it three times as likely."""
    verdict = Verdict(for_new=for_new, for_old=0, error_share=0.5, needed=27.0 - 1e-9)
    assert verdict.odds == pytest.approx(3.0**for_new)
    assert verdict.approved == approved


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_answers_that_never_err_or_always_do_are_no_odds(share: float) -> None:
    with pytest.raises(ValueError, match=r"error_share must lie in \(0, 1\)"):
        Verdict(for_new=1, for_old=0, error_share=share, needed=ODDS_TO_STAY)


def test_however_sure_a_fit_is_one_answer_is_no_proof(
    before_approval: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reward that found no error at all still gives finite odds."""
    run = tmp_path / "run"
    shutil.copytree(before_approval, run)
    with_one_that_stands(run, "new")
    run_configured(run, erring_cfg())
    sure = load_reward(run / "rounds/01/reward")
    found = replace(sure.provenance, cfg=replace(sure.provenance.cfg, error_share=0.0))
    sure.provenance = found
    monkeypatch.setattr("gaitpref.side_by_side.load_reward", lambda _: sure)
    round = Round(run, 2)
    dataset = Dataset.open(run / "dataset")
    verdict = verdict_of(round, dataset, round.policy, needed=ODDS_TO_STAY)
    assert verdict is not None
    assert verdict.error_share == ERROR_SHARES[0] > 0.0


@pytest.mark.slow
def test_training_goes_on_from_the_policy_that_was_preferred(
    tmp_path: Path,
) -> None:
    """Where answers speak against the second retraining, the third begins where the
    second did, and is judged beside that."""
    run = tmp_path / "run"
    cfg = replace(erring_cfg(), rounds=3, labels=90, seed=1)
    cfg = judging(cfg, Compared(first=2, odds_to_go_on=math.inf))
    cfg = replace(cfg, method=replace(cfg.method, unstick=None))
    run_configured(run, cfg)
    first, second = (load_policy(run / f"rounds/0{n}/policy/policy.pt") for n in (1, 2))
    judged = [run / "rounds/03/policy", run / "rounds/03/candidate"]
    third = load_policy(next(p for p in reversed(judged) if p.exists()) / "policy.pt")
    assert second.info.steps > first.info.steps
    own = third.info.steps - first.info.steps
    assert own == second.info.steps - first.info.steps + 1536
    dataset = Dataset.open(run / "dataset")
    compared = []
    with dataset.answers() as store:
        assert store.count() == 90
        for round in (2, 3):
            shown = {
                dataset.entry(clip.rollout).meta.policy_sha256
                for pair in store.pairs(round=round)
                if pair.strategy == STRATEGY
                for clip in (pair.a, pair.b)
            }
            compared.append(shown)
    assert compared == [{first.sha256, second.sha256}, {first.sha256, third.sha256}]
    assert not json.loads((run / "rounds/02/approval.json").read_text())["approved"]
    # Whether the third training raised the reward is measured from where it began.
    reward = load_reward(run / "rounds/02/reward")
    began = evaluate(first, reward, episodes=8, seed=seed_of(cfg, 0, 6)).return_mean
    assert began_with(cfg, Round(run, 3)) == pytest.approx(began, abs=1e-4)
    report = json.loads((run / "rounds/02/report.json").read_text())
    assert began != pytest.approx(report["learned_return_next"], abs=1e-4)
