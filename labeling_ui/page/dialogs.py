"""Dialogs in front of the page; while one is open, no key answers."""

from __future__ import annotations

from typing import Protocol

import viser

from data.answers.typed_text import too_long
from data.files.limits import NOTE_CHARS

from .controls import Post, boxed, posts, warning
from .shortcuts import BAD_REASONS


class Dialog(Protocol):
    """An open dialog."""

    def close(self) -> None:
        """Take it away."""
        ...


def guidelines_dialog(client: viser.ClientHandle, post: Post, text: str) -> Dialog:
    """What to look for."""
    modal = client.gui.add_modal("Guidelines")
    with modal:
        client.gui.add_markdown(text)
        button = client.gui.add_button("Got it [escape]")
    button.on_click(posts(post, "close"))
    return modal


def bad_clip_dialog(client: viser.ClientHandle, post: Post) -> Dialog:
    """Why a clip cannot be judged."""
    modal = client.gui.add_modal("What is wrong with this pair?")
    with modal:
        for reason in BAD_REASONS:
            button = client.gui.add_button(reason, color="gray")
            button.on_click(posts(post, "bad_reason", reason))
        other = client.gui.add_text(f"other, up to {NOTE_CHARS:,} characters", "")
        remark = client.gui.add_html("", visible=False)
        send = client.gui.add_button("Send other reason")
        back = client.gui.add_button("Back without an answer [escape]", color="gray")

    @send.on_click
    async def _(event: viser.GuiEvent) -> None:
        del event
        reason = other.value.strip()
        if wrong := too_long(reason):
            remark.content, remark.visible = (
                boxed(warning(f"The reason {wrong}.")),
                True,
            )
        elif reason:
            post("bad_reason", reason)

    back.on_click(posts(post, "close"))
    return modal
