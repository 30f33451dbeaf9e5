"""The shell of the labeling page: its title, its keys, and what its script is told."""

from __future__ import annotations

from labeling_ui.page.dialogs import SEND
from labeling_ui.page.panel_html import OPEN_ENTRY
from labeling_ui.page.shortcuts import (
    ASPECT_KEYS,
    CONFIDENCE_OF,
    SHORTCUTS,
    VERDICTS,
    Name,
)

from .key_map import KeyGroup
from .page_shell import Shell


def _rows(*names: Name) -> tuple[tuple[str, str], ...]:
    found = (SHORTCUTS[name] for name in names)
    return tuple((shortcut.key, shortcut.words) for shortcut in found)


_GROUPS = (
    KeyGroup(
        "Answer",
        tuple((verdict.key, verdict.words) for verdict in VERDICTS)
        + _rows("bad", "undo", "keep", "differed"),
    ),
    KeyGroup(
        "Say more, before the answer",
        tuple((key.key, f"Because of {key.aspect}") for key in ASPECT_KEYS)
        + _rows("here", "unsure", "fairly", "sure")
        + (("escape", "Leave the note, go on by key"),),
    ),
    KeyGroup(
        "Look",
        _rows("play", "replay", "back", "on", "slower", "faster")
        + _rows("view", "ghost", "camera", "curves", "theme"),
    ),
    KeyGroup(
        "Find the way",
        (
            *_rows("guidelines"),
            ("?", "These keys"),
            ("tab", "The next button or field"),
            ("enter space", "Press what has the focus"),
            ("escape", "Close what is in front"),
        ),
    ),
)
_STRIP = (
    ("1 2", "A better"),
    ("3", "equal"),
    ("4 5", "B better"),
    ("0", "can't tell"),
    ("F", "bad clip"),
    ("Z", "undo"),
    ("space", "pause"),
    ("R", "replay"),
    ("V", "ghost"),
    ("?", "all keys"),
)
_TAPS: tuple[Name, ...] = ("play", "replay")

LABEL_SHELL = Shell(
    title="Which one walks better?",
    scene="Two robots that walk side by side: A to the left, blue, and B to the right, "
    "orange",
    keys=_GROUPS,
    strip=_STRIP,
    taps=tuple((SHORTCUTS[name].key, SHORTCUTS[name].words) for name in _TAPS),
    words={
        "answers": {v.key: v.label for v in VERDICTS}
        | {SHORTCUTS[n].key: SHORTCUTS[n].label for n in ("bad", "undo", "keep")},
        "send": SEND,
        "openEntry": OPEN_ENTRY,
        "wide": [SHORTCUTS["curves"].label],
        "sure": "how sure",
        "sureKeys": {
            words: SHORTCUTS[name].key for name, words in CONFIDENCE_OF.items()
        },
        "whyKeys": {key.aspect: key.key for key in ASPECT_KEYS},
    },
)
"""Around the page on which people answer."""
