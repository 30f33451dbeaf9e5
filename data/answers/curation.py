"""What the owner of a data set decides: who teaches, and which answers are known.

Nothing of what was asked and answered changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from data.errors import AnswerError

from .answer_records import Answer, Choice, Pair, utc_text
from .rows import encode_rater
from .store import AnswerStore

Row = tuple[Pair, Answer]
_LEFT_OUT, _SAID_UTC, _BECAUSE = "left_out", "left_out_utc", "because"
_SWAPPED: dict[Choice, Choice] = {"a": "b", "b": "a"}
OWNER = "the owner"
"""Rater of withdrawals; no person can log in by a name with a space."""
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


def hear_owner_of(store: AnswerStore, rater_id: str, info: Mapping[str, Any]) -> None:
    """Leave a rater out, or take the rater in, as `info` of the rater from elsewhere
    says, if that was said after what is said in `store`."""
    ours = next((own for name, _, own in store.rater_rows() if name == rater_id), {})
    if _said(info) > _said(ours):
        said_utc, out = _said(info)
        _note(store, rater_id, out=out, said_utc=said_utc)


def _said(info: Mapping[str, Any]) -> tuple[str, bool]:
    """When the owner said last whether a rater is left out, and what.

    Earlier versions told no time, and nothing of who was taken in again.
    """
    try:
        said_utc = utc_text(str(info.get(_SAID_UTC)))
    except ValueError:
        said_utc = ""
    return said_utc, bool(info.get(_LEFT_OUT))


def leave_out(
    store: AnswerStore, rater_id: str, now: datetime, *, out: bool = True
) -> None:
    """Leave a rater's answers out of all that is learned, or take them in again.

    Args:
        store: Where the answers are.
        rater_id: Whose.
        now: The time, with an offset: where data sets are merged, the last word counts.
        out: False takes them in again.

    Raises:
        AnswerError: there is no such rater, or the data base fails.
    """
    _note(store, rater_id, out=out, said_utc=utc_text(now.isoformat()))


def _note(store: AnswerStore, rater_id: str, *, out: bool, said_utc: str) -> None:
    with store.transaction():
        known = {name: (kind, info) for name, kind, info in store.rater_rows()}
        if rater_id not in known:
            raise AnswerError(
                f"there is no rater {rater_id!r}; there are {', '.join(known)}"
                if known
                else f"there is no rater {rater_id!r}: nobody has answered yet"
            )
        kind, info = known[rater_id]
        said = {_LEFT_OUT: out} | ({_SAID_UTC: said_utc} if said_utc else {})
        store.query(
            "UPDATE rater SET info_json = :info_json, crc32 = :crc32 "
            "WHERE rater_id = :rater_id AND kind = :kind",
            encode_rater(rater_id, kind, info | said),
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


def withdrawn(store: AnswerStore) -> frozenset[str]:
    """Ids of pairs with a known answer that measured raters, and do no more."""
    rows = store.query(
        "SELECT a.pair_id FROM answer_current AS a JOIN rater AS r USING (rater_id) "
        "WHERE a.rater_id = :owner AND r.kind = 'scripted'",
        {"owner": OWNER},
    )
    return frozenset(pair_id for (pair_id,) in rows)


def withdraw_known(store: AnswerStore, pair: Pair, now: datetime) -> None:
    """Ask no more what was asked as a question whose answer is known.

    It measures nobody from then on, also by the answers it has; they are kept. Pairs
    are never changed: a withdrawal is an answer that is no preference, by a rater who
    is nobody, and goes where answers go.

    Args:
        store: Where `pair` is from.
        pair: What is withdrawn.
        now: The time, with an offset.

    Raises:
        AnswerError: no answer to it is known, or it is withdrawn already.
    """
    name = pair.pair_id[:12]
    if pair.gold is None:
        raise AnswerError(
            f"no answer to {name} is known, so there is nothing to withdraw; "
            "`gaitpref raters --dataset DIR gold` names those with one"
        )
    with store.transaction():
        if pair.pair_id in withdrawn(store):
            raise AnswerError(f"{name} is withdrawn already")
        store.add_rater(OWNER, "scripted")
        store.add_answer(
            Answer(
                # Equal in all data sets, so that merging them repeats nothing.
                answer_id=f"withdrawn-{pair.pair_id}",
                pair_id=pair.pair_id,
                rater_id=OWNER,
                choice="skip",
                shown_left="a",
                created_utc=utc_text(now.isoformat()),
            )
        )


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
