"""Which joint is which: by its name, as models, trainers and drivers spell it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from data.features import JOINTS
from policy.law.law import LawError

_LEGS = {
    "FR": ("fr", "rf", "frontright", "rightfront"),
    "FL": ("fl", "lf", "frontleft", "leftfront"),
    "RR": ("rr", "rh", "hr", "br", "rearright", "rightrear", "hindright", "righthind"),
    "RL": ("rl", "lh", "hl", "bl", "rearleft", "leftrear", "hindleft", "lefthind"),
}
_PARTS = {
    "hip": ("hip", "haa", "abad", "abduction", "hipx", "hx"),
    "thigh": ("thigh", "hfe", "hipy", "hy", "upper", "flexion"),
    "calf": ("calf", "kfe", "knee", "kn", "shank", "lower"),
}


def canonical_joints(names: Sequence[str], of_robot: Sequence[str]) -> tuple[str, ...]:
    """`names` of a source by the names of `JOINTS`.

    Args:
        names: As the source spells them.
        of_robot: [12] as the model of the robot spells them, in the order of `JOINTS`.

    Raises:
        LawError: one fits no joint, or two fit one; the message lists both sides.
    """
    found = [likely_joint(name, of_robot) for name in names]
    if len(names) == 12 and sorted(map(str, found)) == sorted(JOINTS):
        return tuple(map(str, found))
    told = ", ".join(
        f"{name[:40]} -> {joint or '?'}"
        for name, joint in zip(names, found, strict=True)
    )
    raise LawError(
        f"the joints must be the 12 of the robot ({', '.join(of_robot)}), "
        f"got {told}; write `joints` in their order into a TOML (--explain prints one)"
    )


def likely_joint(name: str, of_robot: Sequence[str]) -> str | None:
    """Which of `JOINTS` a source's `name` most likely means; None: none is likelier.

    Args:
        name: As the source spells it.
        of_robot: [12] as the model of the robot spells them, in the order of `JOINTS`.
    """
    for known in (of_robot, JOINTS):
        plain = [_plain(each) for each in known]
        if plain.count(_plain(name)) == 1:
            return JOINTS[plain.index(_plain(name))]
    words = [word for word in re.split(r"[^a-z]+", name.lower()) if word]
    leg = _which(words, _LEGS)
    part = _which(words, _PARTS)
    return f"{leg}_{part}" if leg and part else None


def _plain(name: str) -> str:
    """`name` without what only spells it: case, namespace, the word joint."""
    last = name.rpartition("/")[2].lower()
    return re.sub(r"[_\-. ]+", "", re.sub(r"_?joint$", "", last))


def _which(words: Sequence[str], kinds: dict[str, tuple[str, ...]]) -> str | None:
    joined = {first + second for first, second in pairwise(words)}
    fits = [
        kind
        for kind, spellings in kinds.items()
        if set(spellings) & ({*words} | joined)
    ]
    return fits[0] if len(fits) == 1 else None
