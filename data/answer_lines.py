"""Raters, pairs and answers as lines of JSON, for archives: all of them, losslessly."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict

from data.answer_records import Answer, Pair, to_json
from data.answers import AnswerStore
from data.clips import Clip
from data.errors import AnswerError


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
    """Add what `to_lines` gave; `name` is what errors call the lines.

    Raises:
        AnswerError: a line is damaged, or contradicts what is in the store.
    """
    pairs: list[Pair] = []
    answers: list[Answer] = []
    for number, line in enumerate(lines, 1):
        try:
            values = json.loads(line)
            record = values.pop("record")
            if record == "rater":
                rater = (values["rater_id"], values["kind"], values["info"])
                store.add_rater(*rater, copied=True)
            elif record == "pair":
                a, b = Clip(**values.pop("a")), Clip(**values.pop("b"))
                pair = Pair(**values, a=a, b=b)
                if pair.pair_id != Pair.make(a, b, strategy="", round=0).pair_id:
                    raise ValueError("its id is not that of its clips")
                pairs.append(pair)
            else:
                answers.append(Answer(**values))
        except AnswerError:
            raise
        except Exception as error:
            found = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            raise AnswerError(
                f"line {number} of {name} is damaged ({found}); get it again"
            ) from error
    store.add_pairs(pairs)
    for answer in answers:
        store.add_answer(answer, copied=True)
