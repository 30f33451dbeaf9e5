"""Raters, pairs and answers as lines of JSON, for archives: all of them, losslessly."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict

from data.errors import AnswerError

from .answer_records import Answer, Pair, to_json
from .curation import hear_owner_of
from .fields import Rater, answer_of, pair_of, rater_of
from .store import AnswerStore


def to_lines(store: AnswerStore) -> Iterator[str]:
    """Every rater, then every pair, then every answer, in the order they came."""
    for rater_id, kind, info in store.rater_rows():
        record = {"record": "rater", "rater_id": rater_id, "kind": kind, "info": info}
        yield to_json("rater", record)
    for pair in store.pairs():
        yield to_json("pair", {"record": "pair"} | asdict(pair))
    for _, answer in store.all_answers():
        yield to_json("answer", {"record": "answer"} | asdict(answer))


def from_lines(store: AnswerStore, lines: Iterable[str], name: str) -> None:
    """Add what `to_lines` gave, all of it or nothing.

    Every line is looked at before the first is added.

    Args:
        store: Where to.
        lines: What `to_lines` gave.
        name: What errors call the lines.

    Raises:
        AnswerError: a line is damaged, or contradicts what is in the store.
    """
    raters: list[Rater] = []
    pairs: list[Pair] = []
    answers: list[Answer] = []
    known: dict[str, set[str]] = {"rater": set(), "pair": set(), "answer": set()}
    for number, line in enumerate(lines, 1):
        try:
            values = json.loads(line)
            match values.pop("record"):
                case "rater":
                    raters.append(rater_of(values))
                    known["rater"].add(raters[-1][0])
                case "pair":
                    pairs.append(pair_of(values))
                    known["pair"].add(pairs[-1].pair_id)
                case "answer":
                    answer = answer_of(values)
                    _require_told(answer, known)
                    answers.append(answer)
                    known["answer"].add(answer.answer_id)
                case other:
                    raise ValueError(f"a record of the kind {str(other)[:40]!r}")
        except Exception as error:
            found = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            raise AnswerError(
                f"line {number} of {name} is damaged ({found}); get it again"
            ) from error
    with store.transaction():
        for rater_id, kind, info in raters:
            store.add_rater(rater_id, kind, info, copied=True)
            hear_owner_of(store, rater_id, info)
        store.add_pairs(pairs)
        for answer in answers:
            store.add_answer(answer, copied=True)


def _require_told(answer: Answer, known: Mapping[str, set[str]]) -> None:
    """Make sure that the lines before have told whom and what an answer is about.

    Raises:
        ValueError: they have not.
    """
    for kind, name in (
        ("rater", answer.rater_id),
        ("pair", answer.pair_id),
        ("answer", answer.supersedes),
    ):
        if name is not None and name not in known[kind]:
            raise ValueError(f"no line before tells of the {kind} {name[:64]!r}")
    if answer.answer_id in known["answer"]:
        raise ValueError(f"the answer {answer.answer_id[:64]!r} was told before")
