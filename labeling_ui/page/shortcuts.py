"""What a visitor can do, with which key, and how it is called."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from data.answers.answer_records import Aspect
from labeling_ui.questions.judgement import Verdict

Key = Literal[
    "0", "1", "2", "3", "4", "5", "6", "7", "8", "9", "Z", "F", "H", "R", "J", "K", "L",
    "U", "I", "T", "V", "C", "P", "M", "O", "B", "Y", "N", "G", "X", "space", "escape",
]  # fmt: skip
"""Keys viser knows; W A S D Q E and the arrows move the camera."""

Name = Literal[
    "bad", "undo", "keep", "guidelines", "close", "play", "replay", "back", "on",
    "slower", "faster", "view", "ghost", "camera", "theme", "curves", "unsure",
    "fairly", "sure", "differed", "here",
]  # fmt: skip


@dataclass(frozen=True)
class VerdictKey:
    """A key that answers."""

    key: Key
    verdict: Verdict
    words: str
    """How it is called on the page."""
    side: int | None = None
    """Whose colour its button has."""

    @property
    def label(self) -> str:
        """The words on the button."""
        return f"{self.words} [{self.key}]"


VERDICTS = (
    VerdictKey("1", "left_much", "A much better", 0),
    VerdictKey("2", "left", "A better", 0),
    VerdictKey("3", "equal", "Equally good"),
    VerdictKey("4", "right", "B better", 1),
    VerdictKey("5", "right_much", "B much better", 1),
    VerdictKey("0", "skip", "Can't tell"),
)
WORDS: dict[Verdict, str] = {
    **{verdict.verdict: verdict.words for verdict in VERDICTS},
    "bad": "Bad clip",
}


@dataclass(frozen=True)
class AspectKey:
    """A key that says what of the gait decides the answer."""

    key: Key
    aspect: Aspect

    @property
    def label(self) -> str:
        """The word on the button."""
        return f"{self.aspect} [{self.key}]"


ASPECT_KEYS = (
    AspectKey("O", "posture"),
    AspectKey("B", "feet"),
    AspectKey("Y", "rhythm"),
    AspectKey("N", "steadiness"),
    AspectKey("G", "effort"),
)
ASPECT_OF_LABEL: dict[str, Aspect] = {key.label: key.aspect for key in ASPECT_KEYS}


@dataclass(frozen=True)
class Shortcut:
    """A key that does something else."""

    key: Key
    name: Name
    words: str

    @property
    def label(self) -> str:
        """The words on a button, or in the palette."""
        return f"{self.words} [{self.key}]"


SHORTCUTS: dict[Name, Shortcut] = {
    shortcut.name: shortcut
    for shortcut in (
        Shortcut("F", "bad", "Bad clip"),
        Shortcut("Z", "undo", "Undo"),
        Shortcut("K", "keep", "Keep the earlier answer"),
        Shortcut("6", "differed", "What differed before"),
        Shortcut("H", "guidelines", "Guidelines"),
        Shortcut("escape", "close", "Close the dialog"),
        Shortcut("space", "play", "Play or pause"),
        Shortcut("R", "replay", "Replay"),
        Shortcut("J", "back", "Step back"),
        Shortcut("L", "on", "Step on"),
        Shortcut("U", "slower", "Slower"),
        Shortcut("I", "faster", "Faster"),
        Shortcut("T", "view", "Other view"),
        Shortcut("V", "ghost", "Ghost of the other clip"),
        Shortcut("C", "camera", "Reset the camera"),
        Shortcut("M", "theme", "Light or dark"),
        Shortcut("P", "curves", "Plots"),
        Shortcut("7", "unsure", "Unsure"),
        Shortcut("8", "fairly", "Fairly sure"),
        Shortcut("9", "sure", "Sure"),
        Shortcut("X", "here", "Mark this moment"),
    )
}

CONFIDENCES: dict[str, float | None] = {
    "not stated": None,
    "unsure [7]": 0.25,
    "fairly sure [8]": 0.6,
    "sure [9]": 0.95,
}
"""What the rater may say of an answer, and the number that is stored."""
CONFIDENCE_OF: dict[Name, str] = {
    "unsure": "unsure [7]",
    "fairly": "fairly sure [8]",
    "sure": "sure [9]",
}


@dataclass(frozen=True)
class Objection:
    """What somebody has against a pair, and which answer that is."""

    words: str
    verdict: Verdict = "bad"
    """`bad` teaches nothing; two bad gaits are equally good ones."""

    def because(self, text: str) -> Objection:
        """The same in words of one's own."""
        said = [part for part in (self.words, text) if part]
        return replace(self, words=": ".join(said))


OBJECTIONS = (
    Objection("The simulation glitched"),
    Objection("Too short to judge"),
    Objection("The robot does something else than the command"),
    Objection("Both clips show the same motion"),
    Objection("Both walk badly, neither better", "equal"),
)
