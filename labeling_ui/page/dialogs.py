"""Dialogs in front of the page; while one is open, no key answers.

A digit chooses one of the reasons that a dialog offers.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import Any

import viser

from data.answers.typed_text import too_long
from data.files.limits import NOTE_CHARS
from labeling_ui.questions.judgement import Verdict

from .controls import Post, posts
from .page_access import Differed
from .panel_html import boxed, picture_html, warning
from .shortcuts import OBJECTIONS, VERDICTS, Objection
from .theme import BRAND_RGB, NEUTRAL_RGB

SEND = "Send other reason"
"""The button that Enter in the text field presses."""


@dataclass(frozen=True)
class Dialog:
    """An open dialog."""

    close: Callable[[], None]
    """Takes it away."""
    objections: Sequence[Objection] = ()
    """What the digits choose, 1 the first."""

    def objection(self, verdict: Verdict) -> Objection | None:
        """What is chosen by the key that otherwise gives this verdict."""
        key = next(int(known.key) for known in VERDICTS if known.verdict == verdict)
        return self.objections[key - 1] if 1 <= key <= len(self.objections) else None


def guidelines_dialog(client: viser.ClientHandle, post: Post, text: str) -> Dialog:
    """What to look for."""
    modal = client.gui.add_modal("Guidelines")
    with modal:
        client.gui.add_markdown(text)
        button = client.gui.add_button("Got it [escape]", color=BRAND_RGB)
    button.on_click(posts(post, "close"))
    return Dialog(modal.close)


def differed_dialog(client: viser.ClientHandle, post: Post, told: Differed) -> Dialog:
    """What the clips of the last answer differ in."""
    modal = client.gui.add_modal("The pair before")
    with modal:
        lines = "".join(f"<li>{html.escape(line)}</li>" for line in told.differences)
        client.gui.add_html(boxed(f"{html.escape(told.says)}<ul>{lines}</ul>"))
        if told.picture:
            client.gui.add_html(picture_html(told.picture))
        button = client.gui.add_button("Go on [escape]", color=BRAND_RGB)
    button.on_click(posts(post, "close"))
    return Dialog(modal.close)


def objection_dialog(client: viser.ClientHandle, post: Post) -> Dialog:
    """Why a pair cannot be judged, or why neither of its gaits is any good."""
    modal = client.gui.add_modal("What is wrong with this pair?")

    def sends(objection: Objection) -> Callable[[Any], Coroutine[Any, Any, None]]:
        """Sends it with what was written, unless something is wrong with that."""

        async def send(event: Any) -> None:
            del event
            said = objection.because(other.value.strip())
            if not said.words:
                says = "Write the reason first."
            elif wrong := too_long(said.words):
                says = f"The reason {wrong}."
            else:
                post("objection", said)
                return
            remark.content, remark.visible = boxed(warning(says)), True

        return send

    with modal:
        for key, objection in enumerate(OBJECTIONS, start=1):
            button = client.gui.add_button(
                f"{objection.words} [{key}]", color=NEUTRAL_RGB
            )
            button.on_click(sends(objection))
        other = client.gui.add_text(f"in words, up to {NOTE_CHARS:,} characters", "")
        remark = client.gui.add_html("", visible=False)
        send = client.gui.add_button(SEND, color=BRAND_RGB)
        back = client.gui.add_button(
            "Back without an answer [escape]", color=NEUTRAL_RGB
        )
    send.on_click(sends(Objection("")))
    back.on_click(posts(post, "close"))
    return Dialog(modal.close, OBJECTIONS)
