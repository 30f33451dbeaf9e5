"""What a round has asked itself, and what was asked before it began, told apart.

A pair that was asked while the loop did something else says so in its `info`, with the
round that it was asked for, the number of answers there were, and the label set of the
reward which chose it: `{"meanwhile": {"for_round": 2, "answers": 24, "answers_sha256":
"..."}}`. The pair's own round is that of the newest clips.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from data.answers.answer_records import Pair
from data.answers.store import AnswerStore
from rewardmodel.answers.program_agreement import PROGRAM
from rewardmodel.models.model import RewardModel


def for_round(
    pair: Pair, number: int, *, answers: int, reward: RewardModel | None
) -> Pair:
    """`pair`, asked before the round `number` begins, where there were so many
    `answers`, and chosen by the doubt of `reward`, or by none."""
    asked: dict[str, int | str] = {"for_round": number, "answers": answers}
    if reward is not None:
        asked["answers_sha256"] = reward.provenance.answers_sha256
    return replace(pair, info=pair.info | {"meanwhile": asked})


def asked_and_left(
    store: AnswerStore, round: int, *, by_people: bool = False
) -> tuple[int, int]:
    """Pairs a round asked itself, and those nobody answered; a known answer is not
    waited for.

    Args:
        store: The run's answers.
        round: Its number.
        by_people: What only a program answered, nobody did.
    """
    but_by = PROGRAM if by_people else None
    asked, left = store.pairs(round=round), store.unanswered(round=round, but_by=but_by)
    return len(own_of(asked)), len(own_of(left))


def own_of(pairs: Iterable[Pair]) -> list[Pair]:
    """Those that a round asked itself, without those whose answer is known."""
    return [pair for pair in pairs if pair.gold is None and pair.meanwhile is None]


def open_before(store: AnswerStore) -> int:
    """Pairs that were asked before a round began, and nobody answered."""
    return sum(pair.meanwhile is not None for pair in store.unanswered())


def answered_before(store: AnswerStore, number: int) -> int:
    """Pairs that were asked for the round `number` before it began, and answered."""
    asked = {p.pair_id for p in store.pairs() if p.meanwhile == number}
    return len(asked & {pair.pair_id for pair, _ in store.current_answers()})
