"""What a rater says of an answer besides the answer."""

from __future__ import annotations

from dataclasses import dataclass

from data.answers.answer_records import Answer, Aspect

from .shortcuts import CONFIDENCES


@dataclass(frozen=True, kw_only=True)
class Remarks:
    """Note, confidence and what decides, as the page holds them for one question."""

    note: str = ""
    confidence: str = next(iter(CONFIDENCES))
    """One of CONFIDENCES, in words."""
    why: Aspect | None = None

    @property
    def sure(self) -> float | None:
        """The confidence as it is stored, in [0, 1]."""
        return CONFIDENCES[self.confidence]


def remarks_of(answer: Answer | None) -> Remarks:
    """What was said with an answer that is open again; nothing for a new question."""
    if answer is None:
        return Remarks()
    return Remarks(
        note=answer.note,
        confidence=_words_of(answer.confidence),
        why=answer.why or None,
    )


def _words_of(confidence: float | None) -> str:
    """The words nearest to a confidence in [0, 1]."""
    if confidence is None:
        return next(iter(CONFIDENCES))
    stated = {words: sure for words, sure in CONFIDENCES.items() if sure is not None}
    return min(stated, key=lambda words: abs(stated[words] - confidence))
