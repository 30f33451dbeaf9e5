"""How programs compare with people, what they cost, and whether they may teach."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from data.answers.answer_records import Answer
from data.answers.curation import answers_heard
from data.answers.rater_habits import Sides, sides_of
from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from rewardmodel.answers.program_agreement import (
    PROGRAM,
    RULE,
    Agreement,
    agreements,
)
from rewardmodel.models.fit_report import wilson_interval

from .program_answers import FACTS
from .program_cfg import ProgramCfg, ProgramError


@dataclass(frozen=True, kw_only=True)
class Costs:
    """What the answers of a program took."""

    questions: int
    tokens_in: int
    tokens_out: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A program beside the people who answered the same pairs."""

    agreement: Agreement
    answers: int
    ties: int
    skipped: int
    sides: Sides | None
    """None where it prefers nothing."""
    asked_twice: int
    """Pairs put in both orders, and answered in both."""
    turned: int
    """Of these, how often the order changed the answer."""
    costs: Costs


def compared(store: AnswerStore) -> tuple[Compared, ...]:
    """Every program of a store that answered."""
    rows, kinds = answers_heard(store), store.raters()
    found = agreements(rows, kinds)
    return tuple(
        _compared(found[name], [a for _, a in rows if a.rater_id == name])
        for name in found
        if any(answer.rater_id == name for _, answer in rows)
    )


def require_teaching(cfg: ProgramCfg) -> None:
    """Do nothing where answers of a program may teach.

    Raises:
        ProgramError: nobody said so, and it does not agree with people.
    """
    if cfg.unchecked:
        return
    if cfg.checked_on is None:
        raise ProgramError(
            f"{cfg.rater_id} was never compared with people: `gaitpref answer` has it "
            "answer pairs that people answered, `gaitpref raters compare` shows how "
            "they agree, and --checked-on DATASET lets it in; --unchecked takes its "
            "word"
        )
    with Dataset.open(Path(cfg.checked_on)).answers_copy() as store:
        found = agreements(answers_heard(store), store.raters())
    none = Agreement(rater_id=cfg.rater_id, agreed=0, of=0)
    agreement = found.get(cfg.rater_id, none)
    if not agreement.teaches:
        raise ProgramError(
            f"{cfg.rater_id} {agreement} of {cfg.checked_on}, {RULE} to teach: let "
            "people and it answer more of the same pairs there, or take its word with "
            "--unchecked"
        )


def told_of_programs(store: AnswerStore) -> tuple[dict[str, Any], list[str]]:
    """What there is to say of them, as plain values and in lines."""
    every = compared(store)
    values = {"programs": [_plain(each) for each in every]}
    lines = [line for each in every for line in _lines(each)]
    return values, lines or [
        "no program answered yet; `gaitpref answer --rater package.module:function`, "
        "or --rater openai:http://127.0.0.1:PORT/v1, has one answer"
    ]


def _compared(agreement: Agreement, answers: Sequence[Answer]) -> Compared:
    choices = Counter(answer.choice for answer in answers)
    orders = [
        (facts["in_order"], facts["swapped"])
        for facts in map(_facts, answers)
        if "in_order" in facts and "swapped" in facts
    ]
    return Compared(
        agreement=agreement,
        answers=len(answers),
        ties=choices["equal"],
        skipped=choices["skip"],
        sides=next(iter(sides_of(answers)), None),
        asked_twice=len(orders),
        turned=sum(first != second for first, second in orders),
        costs=Costs(
            questions=int(_sum(answers, "questions")),
            tokens_in=int(_sum(answers, "tokens_in")),
            tokens_out=int(_sum(answers, "tokens_out")),
            seconds=round(_sum(answers, "seconds"), 1),
        ),
    )


def _facts(answer: Answer) -> dict[str, Any]:
    facts = answer.client.get(FACTS)
    return facts if isinstance(facts, dict) else {}


def _sum(answers: Sequence[Answer], name: str) -> float:
    values = (_facts(answer).get(name) for answer in answers)
    # Whoever wrote the data set may have written anything there.
    return sum(v for v in values if isinstance(v, int | float) and 0 <= v < 1e12)


def _lines(each: Compared) -> Iterator[str]:
    agreement, costs = each.agreement, each.costs
    yield f"{agreement.rater_id}: {each.answers} answers"
    interval = ""
    if agreement.of:
        low, high = wilson_interval(agreement.agreed, agreement.of)
        interval = f", 95 % interval {low:.0%} to {high:.0%}"
    yield f"  agreement with people: it {agreement}{interval}"
    yield f"  equal {each.ties}, cannot tell {each.skipped}"
    if each.sides is not None:
        yield (
            f"  position: prefers the left clip in {each.sides.left} of "
            f"{each.sides.preferences} answers, where half would be fair"
            + ("; the side decides, and not the gait" if each.sides.one_sided else "")
        )
    if each.asked_twice:
        yield (
            f"  order: {each.turned} of {each.asked_twice} pairs were answered "
            "otherwise with the clips swapped, and count as equal or as cannot tell"
        )
    tokens = f", {costs.tokens_in:,} tokens in and {costs.tokens_out:,} out"
    yield (
        f"  cost: {costs.questions:,} questions, {costs.seconds:,.1f} s"
        + tokens * bool(costs.tokens_in or costs.tokens_out)
        + f"; {costs.seconds / max(1, each.answers):.2f} s an answer"
    )
    if agreement.teaches:
        yield f"  its answers teach ({RULE})"
    else:
        yield f"  its answers do not teach ({RULE}); --unchecked of `fit` takes them"


def _plain(each: Compared) -> dict[str, Any]:
    values = asdict(each)
    values["kind"] = PROGRAM
    values["agreement"]["share"] = each.agreement.share
    values["agreement"]["teaches"] = each.agreement.teaches
    return values
