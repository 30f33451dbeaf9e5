"""Dialogs in front of the page; while one is open, no key answers.

A digit chooses one of the reasons that a dialog offers.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import viser

from data.answers.typed_text import too_long
from data.files.limits import NOTE_CHARS
from labeling_ui.questions.judgement import Verdict

from .controls import Post, posts
from .page_access import Differed
from .panel_html import boxed, warning
from .shortcuts import BAD_REASONS, VERDICTS
from .theme import BRAND_RGB, NEUTRAL_RGB

SEND = "Send other reason"
"""The button that Enter in the text field presses."""


@dataclass(frozen=True)
class Dialog:
    """An open dialog."""

    close: Callable[[], None]
    """Takes it away."""
    reasons: Sequence[str] = ()
    """What the digits choose, 1 the first."""

    def reason(self, verdict: Verdict) -> str | None:
        """The reason chosen by the key that otherwise gives this verdict."""
        key = next(int(known.key) for known in VERDICTS if known.verdict == verdict)
        return self.reasons[key - 1] if 1 <= key <= len(self.reasons) else None


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
        button = client.gui.add_button("Go on [escape]", color=BRAND_RGB)
    button.on_click(posts(post, "close"))
    return Dialog(modal.close)


def bad_clip_dialog(client: viser.ClientHandle, post: Post) -> Dialog:
    """Why a clip cannot be judged."""
    modal = client.gui.add_modal("What is wrong with this pair?")
    with modal:
        for key, reason in enumerate(BAD_REASONS, start=1):
            button = client.gui.add_button(f"{reason} [{key}]", color=NEUTRAL_RGB)
            button.on_click(posts(post, "bad_reason", reason))
        other = client.gui.add_text(f"other, up to {NOTE_CHARS:,} characters", "")
        remark = client.gui.add_html("", visible=False)
        send = client.gui.add_button(SEND, color=BRAND_RGB)
        back = client.gui.add_button(
            "Back without an answer [escape]", color=NEUTRAL_RGB
        )

    @send.on_click
    async def _(event: viser.GuiEvent) -> None:
        del event
        reason = other.value.strip()
        wrong = too_long(reason)
        if reason and not wrong:
            post("bad_reason", reason)
            return
        says = f"The reason {wrong}." if reason else "Write the reason first."
        remark.content, remark.visible = boxed(warning(says)), True

    back.on_click(posts(post, "close"))
    return Dialog(modal.close, BAD_REASONS)
