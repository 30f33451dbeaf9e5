"""Functions that look at pairs of clips, found by their names."""

from __future__ import annotations

from gaitpref.programs.seen_pair import SeenPair


def fewer_feet_down(pair: SeenPair) -> tuple[str, str]:
    """Likes feet in the air."""
    a, b = (clip.column("foot_contact").mean() for clip in (pair.left, pair.right))
    if abs(a - b) < 1e-6:
        return "equal", ""
    return ("left" if a < b else "right"), f"{a:.3f} against {b:.3f}"


def always_left(pair: SeenPair) -> str:
    """Does not look."""
    return "left"


def says_maybe(pair: SeenPair) -> str:
    return "maybe"
