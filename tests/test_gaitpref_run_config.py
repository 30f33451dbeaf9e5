"""How many answers each round of a loop asks for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from data.errors import GaitprefError
from gaitpref.cli import parse
from gaitpref.loop_cfg import LoopCfg, RunError
from gaitpref.options import Erring, Loop
from gaitpref.presets import resolve
from gaitpref.rater_cfg import RaterCfg

RUN = Path("run")


def asked(cfg: LoopCfg) -> list[int]:
    return [cfg.labels_of(round) for round in range(cfg.rounds)]


@pytest.mark.parametrize(
    ("rounds", "labels", "expected"),
    [
        (None, None, [48, 11, 17, 24]),
        (None, 40, [28, 4, 4, 4]),
        (None, 20, [8, 4, 4, 4]),
        (1, None, [100]),
    ],
)
def test_from_scratch_the_first_round_asks_for_half_and_not_for_too_few(
    rounds: int | None, labels: int | None, expected: list[int]
) -> None:
    cfg = resolve(Loop(run=RUN, base="none", rounds=rounds, labels=labels))
    assert asked(cfg) == expected


@pytest.mark.parametrize("labels", [20, 40, 100])
def test_what_the_first_round_asks_more_the_others_ask_less(labels: int) -> None:
    cfg = resolve(Loop(run=RUN, base="none", labels=labels))
    most = cfg.most_first_labels
    assert cfg.labels_of(0) <= most <= max(0.75 * labels, 8)
    others = [cfg.labels_of(round, first=most) for round in range(1, cfg.rounds)]
    assert most + sum(others) == labels
    assert min(others) >= 4


@pytest.mark.parametrize(
    ("base", "labels", "first", "kept", "others"),
    [
        ("none", 100, 75, 7, [5, 6, 7]),
        ("none", 100, 48, 7, [10, 15, 20]),
        ("none", 40, 28, 0, [4, 4, 4]),
        ("task", 60, 28, 7, [15, 10]),
    ],
)
def test_answers_kept_for_the_last_policy_are_not_asked_before(
    base: str, labels: int, first: int, kept: int, others: list[int]
) -> None:
    """As many as the other rounds can spare."""
    cfg = resolve(Loop(run=RUN, base=base, labels=labels, preset="quick"))
    assert cfg.most_kept(7, first=first) == kept
    found = [
        cfg.labels_of(round, first=first, kept=kept) for round in range(1, cfg.rounds)
    ]
    assert found == others
    assert first + sum(found) + kept == labels


def test_a_style_may_ask_on_at_first_where_its_answers_contradict_each_other() -> None:
    style, scratch = resolve(Loop(run=RUN)), resolve(Loop(run=RUN, base="none"))
    assert style.labels_of(0) < style.most_first_labels < style.labels
    assert style.first_agreement < scratch.first_agreement
    first = style.most_first_labels
    asked_later = [style.labels_of(n, first=first) for n in range(1, style.rounds)]
    assert first + sum(asked_later) == style.labels


@pytest.mark.parametrize(
    ("rounds", "labels"), [(3, 60), (5, 60), (7, 71), (2, 13), (5, 24), (5, 26)]
)
def test_shares_shrink_and_leave_nothing_over(rounds: int, labels: int) -> None:
    each = asked(resolve(Loop(run=RUN, rounds=rounds, labels=labels)))
    assert sum(each) == labels
    assert each[0] == max(each)
    assert each[0] >= 8
    assert min(each) >= 4


def test_too_few_answers_are_refused_with_what_would_do() -> None:
    with pytest.raises(RunError, match="give at least 24, or fewer --rounds"):
        resolve(Loop(run=RUN, rounds=5, labels=23))
    with pytest.raises(RunError, match="first_share"):
        replace(resolve(Loop(run=RUN)), first_share=1.0)
    with pytest.raises(RunError, match=r"most_first_share must lie in \(0, 1\), got 0"):
        replace(resolve(Loop(run=RUN)), most_first_share=0.0)


def test_what_robots_are_told_weighs_most_only_from_scratch() -> None:
    assert resolve(Loop(run=RUN, base="none")).fit.linear.told_most
    assert not resolve(Loop(run=RUN, base="task")).fit.linear.told_most


def test_a_quiet_walk_is_expected_only_once_there_is_one() -> None:
    """From scratch, by the rewards of the last two retrainings; never of a style."""
    scratch = resolve(Loop(run=Path("r"), base="none", preset="quick"))
    found = [scratch.fit_of(round).linear.quiet_logit for round in range(4)]
    assert found == [0.0, 0.0, 0.2, 0.2]
    hurried = [scratch.fit_of(round).linear.hurry for round in range(4)]
    assert hurried == [0.0, 0.0, 1.0, 1.0]
    short = replace(scratch, rounds=1)
    assert short.fit_of(0) == short.fit
    style = resolve(Loop(run=Path("r"), base="task"))
    assert all(style.fit_of(round) == style.fit for round in range(style.rounds))


def test_a_simulated_rater_errs_as_the_command_line_says() -> None:
    """Both from scratch and on a walk; by default it never does."""
    for base in ("none", "task"):
        asked = ["loop", "--run", "run", "--base", base]
        plain, erring = parse(asked), parse([*asked, "--mistakes", "0.2", "--beta=3"])
        assert isinstance(plain, Loop)
        assert isinstance(erring, Loop)
        assert resolve(plain).simulated == RaterCfg()
        assert resolve(erring).simulated == RaterCfg(beta=3.0, mistakes=0.2)


def test_errors_nobody_can_make_and_those_of_people_are_refused() -> None:
    with pytest.raises(GaitprefError, match=r"--skip must lie in \[0, 1\], got 2"):
        resolve(Loop(run=RUN, erring=Erring(skip=2.0)))
    with pytest.raises(RunError, match="leave them out with --rater human"):
        resolve(Loop(run=RUN, rater="human", erring=Erring(equal=0.1)))
