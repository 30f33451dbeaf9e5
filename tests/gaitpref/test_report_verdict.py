"""What answers that were kept for it say of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from gaitpref.method.acceptance import LEAST_LAST, SURE, Compared, Duel
from gaitpref.method.context import RoundContext
from gaitpref.method.method import FROM_SCRATCH, STYLE
from gaitpref.report.verdict import Verdict


@pytest.mark.parametrize(("for_new", "for_old"), [(0, 0), (4, 0), (1, 3), (9, 2)])
def test_a_duel_is_what_a_uniform_share_comes_to(for_new: int, for_old: int) -> None:
    """By drawing shares, and keeping those by which the answers come about."""
    generator = torch.Generator().manual_seed(0)
    share = torch.rand(2_000_000, generator=generator, dtype=torch.float64)
    weight = share**for_new * (1 - share) ** for_old
    duel = Duel(for_new=for_new, for_old=for_old)
    above = float(weight[share > 0.5].sum() / weight.sum())
    assert duel.probably == pytest.approx(above, abs=0.003)
    low, high = duel.interval
    for end, outside in ((low, share < low), (high, share > high)):
        assert 0 <= end <= 1
        assert float(weight[outside].sum() / weight.sum()) == pytest.approx(
            0.05, abs=0.002
        )


def test_the_least_answers_that_make_it_sure_do() -> None:
    assert Duel(for_new=0, for_old=0).least_more(SURE) == LEAST_LAST
    duel = Duel(for_new=3, for_old=1)
    more = duel.least_more(SURE)
    assert Duel(for_new=3 + more, for_old=1).sure(SURE)
    assert not Duel(for_new=2 + more, for_old=1).sure(SURE)
    assert Duel(for_new=0, for_old=5).least_more(SURE) == 0


@pytest.mark.parametrize(
    ("labels", "noisy", "kept"),
    [(8, False, 6), (30, False, 6), (36, False, 7), (100, False, 8), (100, True, 14)],
)
def test_a_share_of_the_answers_is_kept(labels: int, noisy: bool, kept: int) -> None:
    context = RoundContext(number=3, rounds=3, labels=labels, noisy=noisy)
    assert Compared(first=1).last_labels(context) == kept


def test_before_the_last_only_policies_from_scratch_are_judged() -> None:
    """Where answers err, and from the second on."""
    for number, noisy, judged in ((1, True, False), (2, True, True), (2, False, False)):
        context = RoundContext(number=number, rounds=4, labels=100, noisy=noisy)
        assert FROM_SCRATCH.accept
        assert STYLE.accept
        assert FROM_SCRATCH.accept.judges(context) == judged
        assert not STYLE.accept.judges(context)


@pytest.mark.parametrize(("for_new", "goes_on"), [(0, False), (1, False), (2, True)])
def test_two_more_for_the_old_one_bring_it_back(for_new: int, goes_on: bool) -> None:
    assert Compared(first=1).goes_on(Duel(for_new=for_new, for_old=3)) == goes_on


SURELY, HARDLY, LOST = (Duel(for_new=n, for_old=4 - n) for n in (4, 3, 0))


@pytest.mark.parametrize(
    ("stays", "first", "before", "word", "told"),
    [
        (3, SURELY, SURELY, "better", "4 of 4 answers prefer its clips"),
        (3, HARDLY, SURELY, "not known", "3 of 4"),
        (3, None, None, "not known", "nobody was asked"),
        (3, Duel(for_new=0, for_old=0), None, "not known", "no answer prefers"),
        (1, SURELY, None, "better", "nothing was trained after round 1"),
        (0, LOST, None, "not better", "which stays: 0 of 4"),
        (0, Duel(for_new=1, for_old=2), None, "not known", "which stays: 1 of 3"),
        (0, None, None, "not better", "no other policy was kept"),
        (2, SURELY, LOST, "better", "the policy of round 2"),
    ],
)
def test_the_verdict_is_one_sentence(
    stays: int, first: Duel | None, before: Duel | None, word: str, told: str
) -> None:
    """Read back as it was written; with what to do."""
    verdict = Verdict(stays=stays, rounds=3, beside_first=first, beside_before=before)
    assert verdict.word == word
    assert told in verdict.sentence
    assert Verdict.from_json(verdict.as_json()) == verdict
    advice = verdict.advice(Path("runs/mine"))
    assert "runs/mine" in advice
    assert ("--labels" in advice) == (word != "better")
    assert ("gaitpref arena" in advice) == (word == "not known")
    stands = replace(verdict, stands=True)
    assert (stands.word, Verdict.from_json(stands.as_json())) == ("not better", stands)
    nowhere = replace(verdict, nowhere="0.02 m/s where told 0.65")
    assert (nowhere.word, Verdict.from_json(nowhere.as_json())) == (word, nowhere)
    assert nowhere.sentence.endswith("goes nowhere: 0.02 m/s where told 0.65")
    assert "--base" not in nowhere.advice(Path("runs/mine"))
    lost = stays == 0 and first is not None
    assert ("rounds/03/candidate/policy.pt" in advice) == lost
