"""Answers in the form they are published in: one flat row each.

What could tell who a rater is, beyond the pseudonym, stays at home: free facts about
raters and their browsers are left out.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable
from io import StringIO
from typing import Any

from data.answers.answer_records import QUESTION
from data.files.shown import shown

from .dataset import Dataset

_FORMULA = re.compile(r"((?:^|;)[\s\"]*)(?=[=+\-@\uff1d\uff0b\uff0d\uff20])")
LABEL_TYPES: dict[str, type] = {
    "answer_id": str,
    "question": str,
    "pair_id": str,
    "rater": str,
    "rater_kind": str,
    "role": str,
    "choice": str,
    "p_a": float,
    "target": float,
    "a_rollout": str,
    "a_start": int,
    "a_steps": int,
    "b_rollout": str,
    "b_start": int,
    "b_steps": int,
    "shown_left": str,
    "shown_ms": int,
    "watched_ms": int,
    "response_ms": int,
    "confidence": float,
    "note": str,
    "reason": str,
    "why": str,
    "supersedes": str,
    "superseded_by": str,
    "created_utc": str,
    "round": int,
    "strategy": str,
}
"""Columns of a published answer and what they hold, or nothing."""


def labels(dataset: Dataset) -> list[dict[str, Any]]:
    """Every answer, corrected ones too, sorted by id; None where nothing was said.

    Raises:
        AnswerError: the answers cannot be used.
    """
    with dataset.answers_copy() as store:
        kinds = {rater_id: kind for rater_id, kind, _ in store.rater_rows()}
        answered = store.all_answers()
    later = {a.supersedes: a.answer_id for _, a in answered if a.supersedes}
    rows: list[dict[str, Any]] = []
    for pair, answer in answered:
        row: dict[str, Any] = {
            "question": QUESTION,
            "rater": answer.rater_id,
            "rater_kind": kinds[answer.rater_id],
            "target": answer.target,
            "superseded_by": later.get(answer.answer_id),
            "round": pair.round,
            "strategy": pair.strategy,
        }
        for side, clip in (("a", pair.a), ("b", pair.b)):
            row[f"{side}_rollout"] = clip.rollout
            row[f"{side}_start"], row[f"{side}_steps"] = clip.start, clip.steps
        rows.append(
            {n: row[n] if n in row else getattr(answer, n) for n in LABEL_TYPES}
        )
    return sorted(rows, key=lambda row: row["answer_id"])


def to_jsonl(rows: Iterable[dict[str, Any]]) -> str:
    """A JSON object a line; what cannot be seen is escaped, and read back as it was."""
    return "".join(_line(row) + "\n" for row in rows)


def to_csv(rows: Iterable[dict[str, Any]]) -> str:
    """A table with a header for people and spreadsheets; what is None is empty.

    What cannot be seen is spelled out, and an apostrophe keeps a spreadsheet from
    taking what somebody wrote for a formula. JSON lines hold texts to the letter.
    """
    text = StringIO()
    writer = csv.DictWriter(text, list(LABEL_TYPES), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: _cell(value) for name, value in row.items()})
    return text.getvalue()


def _line(row: dict[str, Any]) -> str:
    text = json.dumps(row, ensure_ascii=False)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


def _cell(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    # Where lists are separated by semicolons, a cell may begin behind one.
    return _FORMULA.sub(r"\1'", shown(value))
