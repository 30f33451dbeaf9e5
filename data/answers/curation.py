"""What the owner of a data set decides: who teaches, and which answers are known.

Nothing of what was asked and answered changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from data.errors import AnswerError

from .answer_records import Answer, Choice, Pair
from .rows import encode_rater
from .store import AnswerStore

Row = tuple[Pair, Answer]
_LEFT_OUT, _BECAUSE = "left_out", "because"
_SWAPPED: dict[Choice, Choice] = {"a": "b", "b": "a"}
BY_OWNER = "the owner says so"
"""Why an answer is known that no fall decides."""


def left_out(store: AnswerStore) -> frozenset[str]:
    """Raters whose answers are kept, and teach nothing."""
    return frozenset(
        rater_id for rater_id, _, info in store.rater_rows() if info.get(_LEFT_OUT)
    )


def answers_heard(store: AnswerStore, round: int | None = None) -> list[Row]:
    """Current answers, of one round or of all, without those of raters left out."""
    unwanted = left_out(store)
    answers = store.current_answers(round)
    return [row for row in answers if row[1].rater_id not in unwanted]


def leave_out_too(store: AnswerStore, rater_id: str, info: Mapping[str, Any]) -> None:
    """Leave a rater out who is left out where `info` of the rater is from."""
    if info.get(_LEFT_OUT) and rater_id not in left_out(store):
        leave_out(store, rater_id)


def leave_out(store: AnswerStore, rater_id: str, *, out: bool = True) -> None:
    """Leave a rater's answers out of all that is learned, or take them in again.

    Raises:
        AnswerError: there is no such rater, or the data base fails.
    """
    with store.transaction():
        known = {name: (kind, info) for name, kind, info in store.rater_rows()}
        if rater_id not in known:
            raise AnswerError(
                f"there is no rater {rater_id!r}; there are {', '.join(known)}"
                if known
                else f"there is no rater {rater_id!r}: nobody has answered yet"
            )
        kind, info = known[rater_id]
        info = {name: value for name, value in info.items() if name != _LEFT_OUT}
        row = encode_rater(rater_id, kind, info | ({_LEFT_OUT: True} if out else {}))
        store.query(
            "UPDATE rater SET info_json = :info_json, crc32 = :crc32 "
            "WHERE rater_id = :rater_id AND kind = :kind",
            row,
        )


def ask_known(store: AnswerStore, pair: Pair, known: Choice) -> Pair:
    """Add a question whose answer is known: the clips of `pair`, swapped; gives it.

    Its answers measure who gives them, and teach nothing. `pair` stays as it is.

    Args:
        store: Where `pair` is from.
        pair: Two clips that were compared, or are to be.
        known: Which of them is better, as everybody sees who looks.

    Raises:
        AnswerError: they are asked about in both orders already, or the answer to
            `pair` is known.
        ValueError: `known` is no preference.
    """
    if pair.gold is not None:
        raise AnswerError(
            f"the answer to {pair.pair_id[:12]} is known already; choose another pair"
        )
    info = {"gold": _SWAPPED.get(known, known), _BECAUSE: BY_OWNER}
    swapped = Pair.make(pair.b, pair.a, strategy="gold", round=pair.round, info=info)
    if not store.add_pairs([swapped]):
        raise AnswerError(
            f"the clips of {pair.pair_id[:12]} are asked about in both orders already; "
            "choose another pair"
        )
    return swapped


def known_because(pair: Pair) -> str:
    """Why the answer to a pair is known; empty where nobody said."""
    because = pair.info.get(_BECAUSE)
    return because if isinstance(because, str) else ""


def find_pair(store: AnswerStore, name: str) -> Pair:
    """The pair whose id begins with `name`.

    Raises:
        AnswerError: there is none, or more than one.
    """
    pairs = store.pairs()
    found = [pair for pair in pairs if pair.pair_id.startswith(name)]
    if len(found) != 1:
        raise AnswerError(
            f"{len(found)} of {len(pairs)} pairs begin with {name!r}; `gaitpref data "
            "labels --dataset DIR` names those that were answered"
        )
    return found[0]
