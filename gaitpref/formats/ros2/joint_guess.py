"""Which joints a bag means that calls them otherwise than its map."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

from data.features import JOINTS
from policy.imported.meaning.joint_names import likely_joint

_MOST = 40
"""Names that are told."""
_CHARS = 60


def told_of_names(there: Iterable[str], wanted: Sequence[str]) -> str:
    """What the joints of a bag are called, and what the map should say, in words.

    Args:
        there: Names in the bag.
        wanted: [12] names in the map.
    """
    names = sorted({name[:_CHARS] for name in there})
    lacking = [name for name in wanted if name not in names]
    told = ", ".join(names[:_MOST]) + (", ..." if len(names) > _MOST else "")
    return (
        f"its joints are {told}; names in [joints] of the map wants "
        f"{', '.join(lacking) or 'all twelve in one message'}{_guess(names)}"
    )


def _guess(names: Sequence[str]) -> str:
    """The line of the map that most likely fits, or which joints nothing fits."""
    likely = {name: likely_joint(name, JOINTS) for name in names}
    fits = {joint: [n for n in names if likely[n] == joint] for joint in JOINTS}
    found = {joint: own[0] for joint, own in fits.items() if len(own) == 1}
    if len(found) == len(JOINTS):
        line = json.dumps([found[joint] for joint in JOINTS], ensure_ascii=False)
        return f"; a guess by their names, to be looked at: names = {line}"
    if found:
        told = ", ".join(f"{own} -> {joint}" for joint, own in found.items())
        return f"; a guess by their names: {told}; the others fit no joint alone"
    return ""
