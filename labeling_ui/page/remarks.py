"""What a rater says of an answer besides the answer."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

from data.answers.answer_records import HERE, MOST_HERE, Answer, Aspect

from .shortcuts import CONFIDENCES

_SAME_MOMENT_S = 0.1
"""A mark so near to another is meant to take it back."""
_MARK = re.compile(r"\d{1,2}\.\d\d", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Remarks:
    """Note, confidence and what decides, as the page holds them for one question."""

    note: str = ""
    confidence: str = next(iter(CONFIDENCES))
    """One of CONFIDENCES, in words."""
    why: Aspect | None = None
    here_s: tuple[float, ...] = ()
    """Moments of the clips that were marked."""

    @property
    def sure(self) -> float | None:
        """The confidence as it is stored, in [0, 1]."""
        return CONFIDENCES[self.confidence]

    def marked(self, time_s: float) -> Remarks:
        """With a mark at a moment of the clips, or without the one that is there."""
        near = [m for m in self.here_s if abs(m - time_s) < _SAME_MOMENT_S]
        if near:
            here_s = tuple(m for m in self.here_s if m not in near)
        else:
            here_s = tuple(sorted((*self.here_s, round(time_s, 2))))[:MOST_HERE]
        return replace(self, here_s=here_s)

    @property
    def client(self) -> dict[str, Any]:
        """What of it is stored with how the clips were shown."""
        return {HERE: list(self.here_s)} if self.here_s else {}


@dataclass(frozen=True, kw_only=True)
class Marks:
    """Moments that were marked of the clips of a question that is open."""

    question_id: str | None = None
    here_s: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """What `marks_of` reads; letters that may stand in a cookie. "" of none."""
        words = [f"{moment:.2f}" for moment in self.here_s]
        return "_".join([self.question_id or "", *words]) if words else ""


def marks_of(text: str) -> Marks:
    """The marks in a text that a browser sent; what is none of them is passed over."""
    question_id, *words = text.split("_")
    here_s = sorted({float(word) for word in words if _MARK.fullmatch(word)})
    return Marks(question_id=question_id, here_s=tuple(here_s[:MOST_HERE]))


def remarks_of(answer: Answer | None) -> Remarks:
    """What was said with an answer that is open again; nothing for a new question."""
    if answer is None:
        return Remarks()
    return Remarks(
        note=answer.note,
        confidence=_words_of(answer.confidence),
        why=answer.why or None,
        here_s=answer.here_s,
    )


def _words_of(confidence: float | None) -> str:
    """The words nearest to a confidence in [0, 1]."""
    if confidence is None:
        return next(iter(CONFIDENCES))
    stated = {words: sure for words, sure in CONFIDENCES.items() if sure is not None}
    return min(stated, key=lambda words: abs(stated[words] - confidence))
