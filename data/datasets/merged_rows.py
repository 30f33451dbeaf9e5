"""Takes the raters, pairs and answers of one store into another.

What both have is there once. Two people of one name are kept apart: a human of the
source whose id is another's in the target is renamed, unless an answer that both have
shows them to be the same.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

from data.answers.answer_records import Answer, Pair, RaterKind
from data.answers.curation import hear_owner_of
from data.answers.fields import Rater, require_sound
from data.answers.store import AnswerStore


@dataclass(frozen=True)
class Rows:
    """All that a store holds, in the order it came."""

    raters: list[Rater]
    pairs: list[Pair]
    answered: list[tuple[Pair, Answer]]


@dataclass(frozen=True)
class Added:
    """What was new in the store that was written to."""

    pairs: int
    answers: int
    left_out: int
    """Answers that were not wanted, or about episodes that were not."""
    renamed: Mapping[str, str]
    """Raters who got another id, because theirs belongs to somebody else."""


def rows_of(store: AnswerStore, name: str) -> Rows:
    """What `store`, which errors call `name`, holds.

    Raises:
        AnswerError: a field of it is of another kind than it can be.
    """
    rows = Rows(store.rater_rows(), store.pairs(), store.all_answers())
    answers = (answer for _, answer in rows.answered)
    require_sound(name, rows.raters, rows.pairs, answers)
    return rows


def add_rows(
    store: AnswerStore,
    rows: Rows,
    hashes: Collection[str],
    *,
    wanted: Callable[[Pair, Answer], bool] = lambda pair, answer: True,
    keep_open_pairs: bool = True,
) -> Added:
    """Add what is new in `rows` to `store`.

    Args:
        store: Where to.
        rows: What.
        hashes: Episodes; pairs and answers about others stay behind.
        wanted: Which answers; a correction goes with what it corrects.
        keep_open_pairs: Also add pairs nobody answered.

    Raises:
        AnswerError: an answer contradicts what is there, or the data base fails.
    """
    answered, known = rows.answered, frozenset(hashes)
    here = {p.pair_id for p in rows.pairs if {p.a.rollout, p.b.rollout} <= known}
    chosen = [(p, a) for p, a in answered if p.pair_id in here and wanted(p, a)]
    chosen = _with_corrected(chosen, answered)
    used = {pair.pair_id for pair, _ in chosen} | (here if keep_open_pairs else set())
    # All of it or nothing, and the disk is waited for once.
    with store.transaction():
        names = _names(store, rows.raters, answered)
        num_pairs = store.add_pairs(pair for pair in rows.pairs if pair.pair_id in used)
        raters_used = {answer.rater_id for _, answer in chosen}
        for rater_id, kind, info in rows.raters:
            if rater_id in raters_used:
                store.add_rater(names[rater_id], kind, info, copied=True)
                hear_owner_of(store, names[rater_id], info)
        num_answers = sum(
            _add(store, replace(answer, rater_id=names[answer.rater_id]))
            for _, answer in chosen
        )
    return Added(
        pairs=num_pairs,
        answers=num_answers,
        left_out=len(answered) - len(chosen),
        renamed={k: v for k, v in names.items() if k != v and k in raters_used},
    )


def _with_corrected(
    chosen: list[tuple[Pair, Answer]], answered: list[tuple[Pair, Answer]]
) -> list[tuple[Pair, Answer]]:
    """Add what the chosen answers correct, in the order of all answers."""
    earlier = {answer.answer_id: answer.supersedes for _, answer in answered}
    wanted: set[str] = set()
    for _, answer in chosen:
        current: str | None = answer.answer_id
        while current is not None and current not in wanted:
            wanted.add(current)
            current = earlier[current]
    return [(p, a) for p, a in answered if a.answer_id in wanted]


def _names(
    store: AnswerStore,
    raters: list[tuple[str, RaterKind, dict]],
    answered: list[tuple[Pair, Answer]],
) -> dict[str, str]:
    """What each rater of the source is called in the target."""
    rater_of = {answer.answer_id: answer.rater_id for _, answer in store.all_answers()}
    names = {
        answer.rater_id: rater_of[answer.answer_id]
        for _, answer in answered
        if answer.answer_id in rater_of
    }
    taken = store.raters()
    for rater_id, kind, _ in raters:
        name = rater_id
        number = 2
        # A scripted rater is a function: equal names are equal raters.
        while rater_id not in names and name in taken:
            if kind != "human" and taken[name] == kind:
                break
            name, number = f"{rater_id}~{number}", number + 1
        names.setdefault(rater_id, name)
        taken[names[rater_id]] = kind
    return names


def _add(store: AnswerStore, answer: Answer) -> bool:
    """Add an answer unless it is known; a scripted rater repeats itself later."""
    known = store.find_answer(answer.answer_id)
    if known is not None and replace(known, created_utc=answer.created_utc) == answer:
        return False
    return store.add_answer(answer, copied=True)
