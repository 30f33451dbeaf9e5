"""How a rater likes to look, kept by the browser in a cookie.

The page says it in an attribute, the script in the browser keeps that, and the next
opening of the page brings it: after a lost line, a reload, or a restart of the server.
"""

from __future__ import annotations

from dataclasses import dataclass

from labeling_ui.scene.scene import View

from .playback import SPEEDS


@dataclass(frozen=True, kw_only=True)
class Habits:
    """Theme, view, speed, and what is shown besides."""

    dark: bool = False
    view: View = "treadmill"
    speed: float = 1.0
    """One of SPEEDS."""
    ghost: bool = False
    curves: bool = False

    @property
    def text(self) -> str:
        """What `habits_of` reads; letters that may stand in a cookie."""
        words = [self.view, _word(self.speed)]
        words += [
            word
            for word, on in (
                ("dark", self.dark),
                ("ghost", self.ghost),
                ("curves", self.curves),
            )
            if on
        ]
        return "-".join(words)


def habits_of(text: str) -> Habits:
    """The habits in a text that a browser sent; what is none of them is passed over."""
    words = set(text.split("-"))
    return Habits(
        dark="dark" in words,
        view="lanes" if "lanes" in words else "treadmill",
        speed=next((speed for speed in SPEEDS if _word(speed) in words), 1.0),
        ghost="ghost" in words,
        curves="curves" in words,
    )


def _word(speed: float) -> str:
    return f"{speed:g}x"
