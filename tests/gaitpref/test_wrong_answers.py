"""`studies.wrong_answers`: its fits are those of a loop, and its table counts them."""

from dataclasses import replace

import torch

from gaitpref.loop.presets import loop_cfg
from rewardmodel.answers.answered_pairs import AnsweredPairs
from studies.wrong_answers import fits, table_of
from tests.rewardmodel.test_fit import answered


def _in_two_rounds(pairs: AnsweredPairs) -> AnsweredPairs:
    return replace(pairs, rounds=(0,) * 60 + (1,) * 30)


def test_random_answers_raise_the_alarm_and_right_ones_do_not() -> None:
    cfg = loop_cfg(base="none", rounds=2)
    pairs = _in_two_rounds(answered(90, seed=1))
    random = torch.rand(90, generator=torch.Generator().manual_seed(0)) < 0.5
    turned = replace(pairs, target=(pairs.target.bool() ^ random).float())
    told = [
        *fits(pairs, cfg, "run", wrong=0.0, draw=0),
        *fits(turned, cfg, "run", wrong=0.5, draw=0),
    ]
    assert [each.answers for each in told] == [60, 90, 60, 90]
    assert [each.alarm for each in told] == [False, False, True, True]
    table = table_of(told)
    rows = list(zip(*(list(column.cells) for column in table.columns), strict=True))
    assert rows == [
        ("0.00", "0.00 of 1", "0.00 of 1", "0.00 of 1"),
        ("0.50", "1.00 of 1", "1.00 of 1", "1.00 of 1"),
    ]
