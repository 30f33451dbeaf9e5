"""A rater that is a vision model: it sees film strips and footfalls, in both orders."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from data.answers.typed_text import plain_text

from .chat import completion
from .program_cfg import ProgramCfg, ProgramError, ReachCfg
from .seen_pair import SWAPPED, ProgramRater, SeenClip, SeenPair, Verdict, Word
from .strips import png_of

USUAL_WISH = "walks better: steadily, without stumbling, as it was told to"
MOST_ODD = 5
"""Replies in a row that are no answer, after which it is not asked on."""
_ANSWER_TOKENS = 300
_NAMES: dict[str, Word] = {
    "a": "left",
    "b": "right",
    "equal": "equal",
    "unsure": "skip",
}
_OBJECT = re.compile(r"\{[^{}]*\}", re.DOTALL)
_REASON_CHARS = 300
_TOLD = (
    "You compare two clips of a four-legged robot, A and B. Of each you see a film "
    "strip of eight pictures in the order of time, and below which foot is down when: "
    "a row for each leg (FR, FL, RR, RL), dark while the foot is on the ground; a red "
    "bar at the end is a fall, and a fall is worse than any way of walking. "
    "Both robots were told: {command}. Which one {wish}? "
    'Answer with one JSON object and nothing else: {{"better": "A", "B", "equal" or '
    '"unsure", "why": "at most fifteen words"}}'
)


def vision_rater(cfg: ProgramCfg, reach: ReachCfg) -> ProgramRater:
    """The model that `cfg` names as a rater.

    Each pair is put in both orders. Where the two do not agree, what was said is about
    the order, and the pair is a tie.

    Args:
        cfg: Address, model, what is looked for.
        reach: How it is reached.

    Raises:
        ProgramError: it may not be asked there; later, that it cannot be reached or
            does not answer the question.
    """
    url = cfg.url
    if url is None:
        raise ValueError(f"{cfg.name} is no model")
    reach.require_reachable(url)
    odd = 0

    def rate(pair: SeenPair) -> Verdict:
        nonlocal odd
        replies = [
            completion(url, question(cfg, shown), reach)
            for shown in (pair, pair.swapped)
        ]
        found = [answer_in(reply.text) for reply in replies]
        for reply, said in zip(replies, found, strict=True):
            odd = odd + 1 if said is None else 0
            if odd >= MOST_ODD:
                raise ProgramError(
                    f"{cfg.model} at {url} gave {odd} replies in a row that are no "
                    f"answer, the last one {plain_text(reply.text)[:120]!r}: take a "
                    "model that sees pictures and does what it is told; what was "
                    "answered before is kept"
                )
        facts = {
            "questions": len(replies),
            "tokens_in": sum(reply.tokens_in for reply in replies),
            "tokens_out": sum(reply.tokens_out for reply in replies),
            "seconds": round(sum(reply.seconds for reply in replies), 3),
        }
        one, other = found
        if one is None or other is None:
            odd_one = replies[0 if one is None else 1].text
            told = f"no answer: {plain_text(odd_one)[:_REASON_CHARS]}"
            return Verdict(word="skip", reason=told, facts=facts)
        (first, why), (second, why_swapped) = one, other
        back = SWAPPED.get(second, second)
        facts["in_order"], facts["swapped"] = first, back
        word = agreed(first, back)
        if first == back:
            return Verdict(word=word, reason=why, facts=facts)
        told = f"in one order {first} ({why}), in the other {back} ({why_swapped})"
        return Verdict(word=word, reason=told, facts=facts)

    return rate


def agreed(first: Word, second: Word) -> Word:
    """What two answers about one pair, as seen in the first order, come to."""
    if first == second:
        return first
    return "skip" if "skip" in (first, second) else "equal"


def question(cfg: ProgramCfg, pair: SeenPair) -> dict[str, Any]:
    """The body of a chat completion about one pair."""
    told = _TOLD.format(
        command=command_words(pair.command), wish=cfg.wish or USUAL_WISH
    )
    content: list[dict[str, Any]] = [{"type": "text", "text": told}]
    for name, clip in (("A", pair.left), ("B", pair.right)):
        content += _shown(name, clip)
    return {
        "model": cfg.model,
        "messages": [{"role": "user", "content": content}],
        "temperature": 0,
        "max_tokens": _ANSWER_TOKENS,
    }


def _shown(name: str, clip: SeenClip) -> Iterator[dict[str, Any]]:
    yield {"type": "text", "text": f"Clip {name}, film strip:"}
    yield _picture(clip.film_strip)
    yield {"type": "text", "text": f"Clip {name}, feet on the ground:"}
    yield _picture(clip.footfalls)


def _picture(pixels: np.ndarray) -> dict[str, Any]:
    data = base64.b64encode(png_of(pixels)).decode()
    return {"type": "image_url", "image_url": {"url": f"data:image/png;base64,{data}"}}


def command_words(command: tuple[float, float, float]) -> str:
    """What the robots were told to do."""
    forward, left, yaw = command
    return f"forward {forward:.2f} m/s, left {left:.2f} m/s, turning {yaw:.2f} rad/s"


def answer_in(text: str) -> tuple[Word, str] | None:
    """The answer that a reply holds, and why; None where it holds none, or several."""
    found: list[tuple[Word, str]] = []
    for match in _OBJECT.finditer(text):
        try:
            values = json.loads(match[0])
        except (ValueError, RecursionError):
            continue
        word = _NAMES.get(str(values.get("better", "")).strip().lower())
        if word is not None:
            why = plain_text(str(values.get("why", "")))[:_REASON_CHARS]
            found.append((word, why))
    if not found:
        alone = _NAMES.get(text.strip().strip(".\"'").lower())
        return None if alone is None else (alone, "")
    return found[0] if len({word for word, _ in found}) == 1 else None
