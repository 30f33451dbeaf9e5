"""How many answers each round of a loop asks for."""

from __future__ import annotations

from pathlib import Path

import pytest

from data.errors import GaitprefError
from gaitpref.cli.main import parse
from gaitpref.cli.options.options import Erring, Loop
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.loop.loop_cfg import LoopCfg, RunError
from gaitpref.method.context import RoundContext
from gaitpref.raters.rater_cfg import RaterCfg
from gaitpref.training.by_method import recorded_by

RUN = Path("run")


def labels_of(cfg: LoopCfg, number: int, *, kept: int = 0) -> int:
    context = RoundContext(number=number, rounds=cfg.rounds, labels=cfg.labels)
    return cfg.method.budget.labels_of(context, kept=kept)


def asked(cfg: LoopCfg) -> list[int]:
    return [labels_of(cfg, round) for round in range(cfg.rounds)]


@pytest.mark.parametrize(
    ("rounds", "labels", "expected"),
    [
        (None, None, [40, 12, 20, 28]),
        (None, 40, [16, 6, 8, 10]),
        (None, 20, [8, 4, 4, 4]),
        (1, None, [100]),
    ],
)
def test_from_scratch_the_first_round_asks_for_two_fifths_and_not_for_too_few(
    rounds: int | None, labels: int | None, expected: list[int]
) -> None:
    cfg = resolve(Loop(run=RUN, base="none", rounds=rounds, labels=labels))
    assert asked(cfg) == expected


@pytest.mark.parametrize(
    ("base", "labels", "first", "kept", "others"),
    [
        ("none", 100, 37, 7, [12, 18, 26]),
        ("none", 40, 14, 4, [6, 7, 9]),
        ("task", 60, 34, 7, [19]),
    ],
)
def test_answers_kept_for_the_last_policy_are_not_asked_before(
    base: str, labels: int, first: int, kept: int, others: list[int]
) -> None:
    """As many as the other rounds can spare."""
    cfg = resolve(Loop(run=RUN, base=base, labels=labels, preset="quick"))
    context = RoundContext(number=0, rounds=cfg.rounds, labels=labels)
    assert cfg.method.budget.most_kept(context, kept) == kept
    found = [labels_of(cfg, round, kept=kept) for round in range(cfg.rounds)]
    assert found == [first, *others]
    assert sum(found) + kept == labels


@pytest.mark.parametrize(
    ("rounds", "labels"), [(3, 60), (5, 60), (7, 71), (2, 13), (5, 24), (5, 26)]
)
def test_the_first_round_asks_most_and_nothing_is_left_over(
    rounds: int, labels: int
) -> None:
    each = asked(resolve(Loop(run=RUN, rounds=rounds, labels=labels)))
    assert sum(each) == labels
    assert each[0] == max(each)
    assert each[0] >= 8
    assert min(each) >= 2


def test_too_few_answers_are_refused_with_what_would_do() -> None:
    with pytest.raises(RunError, match="give at least 16, or fewer --rounds"):
        resolve(Loop(run=RUN, rounds=5, labels=15))
    with pytest.raises(RunError, match="--rounds must be at least 1, got 0"):
        resolve(Loop(run=RUN, rounds=0))


def test_what_robots_are_told_weighs_most_only_from_scratch() -> None:
    scratch, style = (resolve(Loop(run=RUN, base=base)) for base in ("none", "task"))
    assert scratch.method.reward.linear.told_most
    assert not style.method.reward.linear.told_most


def test_robots_that_tumble_are_shown_with_noise_and_rhythms() -> None:
    """How many episodes and how long is the run's; of what, the method's."""
    for base, noisy, rhythms in (("none", 1.0, 0.3), ("task", 0.5, 0.0)):
        cfg = resolve(Loop(run=RUN, base=base, clip_s=2.0))
        found = recorded_by(cfg.method.clips, cfg.record)
        assert (found.noisy_share, found.babble_share) == (noisy, rhythms)
        assert found.variation.share == 0.5
        assert found.episodes == cfg.record.episodes
        assert found.episode_s == cfg.record.episode_s >= 6.0


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
