"""What was guessed, tried the other way: where the figures differ, they say so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from data.errors import GaitprefError
from policy.law.origin import Measured

from .bring import Understood, embodied
from .meaning.draft import BY_TYPE, LEFT_FIRST, RIGHT_FIRST, Draft
from .trial import measure

_ASKED = ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
_WALK_S = 5.0
_ORDERS = {
    "FL FR RL RR, leg by leg": LEFT_FIRST,
    "FR FL RR RL, leg by leg": RIGHT_FIRST,
    "all hips, thighs, calves": BY_TYPE,
}


def tried(known: Understood, robot_xml: Path | None) -> Iterator[str]:
    """What a policy does with each other value of what was guessed, a line each."""
    for told, draft in _others(known):
        try:
            law, robot, cfg = embodied(replace(known, draft=draft), robot_xml)
        except GaitprefError as error:
            yield f"{told}: {error}"
            continue
        network = known.found.network(tuple(int(j) for j in law.to_canonical))
        rows = measure(
            lambda obs, noise=None, network=network: network(obs),
            robot,
            cfg,
            asked=_ASKED,
            walk_s=_WALK_S,
        )
        yield f"{told}: {_in_words(rows)}"


def _others(known: Understood) -> Iterator[tuple[str, Draft]]:
    draft = known.draft
    if "joints" in draft.guessed:
        for told, order in _ORDERS.items():
            if order != draft.joints:
                yield f"joints {told}", replace(known.in_order(order), joints=order)
    if "by_term" in draft.guessed or "newest_first" in draft.guessed:
        for by_term, newest in product((True, False), repeat=2):
            changes: dict[str, Any] = {"by_term": by_term, "newest_first": newest}
            if (draft.by_term, draft.newest_first) != (by_term, newest):
                frames = "term by term" if by_term else "frame by frame"
                first = "newest" if newest else "oldest"
                yield f"history {frames}, {first} first", replace(draft, **changes)


def _in_words(rows: tuple[Measured, ...]) -> str:
    stands, walks = rows
    if stands.fell_at_s is not None:
        return f"falls at {stands.fell_at_s:.1f} s standing"
    if walks.fell_at_s is not None:
        return f"falls at {walks.fell_at_s:.1f} s at 0.5 m/s"
    return f"walks {walks.forward_m_s:.2f} of 0.5 m/s"
