"""The panels of the page of one client: made once, then only filled anew."""

from __future__ import annotations

import html
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any

import viser
from viser import GuiButtonHandle, GuiEvent

from data.answers.answer_records import Answer
from data.files.limits import NOTE_CHARS
from labeling_ui.questions.judgement import Past

from .loop_status import LoopStatus
from .page_access import HISTORY_LENGTH, Showing
from .panel_html import LINKS, OPEN_ENTRY, boxed, head, past_words
from .remarks import Remarks
from .shortcuts import (
    ASPECT_KEYS,
    ASPECT_OF_LABEL,
    CONFIDENCES,
    SHORTCUTS,
    VERDICTS,
    Name,
)
from .theme import BRAND_RGB, NEUTRAL_RGB, SIDE_RGBS
from .view_habits import Habits

Post = Callable[..., None]
"""Takes the name of an event and its value; never blocks."""

PANEL_WIDTH_PX = 316
FLOATING_PX = 560
"""Width of the panel below the robots until the browser makes it as wide as them."""
CLOCK_BUTTONS: tuple[Name, ...] = (
    "play", "replay", "back", "on", "slower", "faster",
)  # fmt: skip
VIEW_BUTTONS: tuple[Name, ...] = (
    "guidelines", "view", "ghost", "curves", "camera", "theme",
)  # fmt: skip


def posts(post: Post, name: str, value: Any = None) -> Callable[[Any], Coroutine]:
    """A callback that only posts; asynchronous ones keep their order in viser."""

    async def callback(event: Any) -> None:
        del event
        post(name, value)

    return callback


def posts_value(post: Post, name: str) -> Callable[[GuiEvent], Coroutine]:
    """A callback that posts the new value, unless it was set from here."""

    async def callback(event: GuiEvent) -> None:
        if event.client is not None:
            post(name, event.target.value)

    return callback


class Controls:
    """The docked panel: question, answers, note, history."""

    def __init__(self, client: viser.ClientHandle, post: Post) -> None:
        self._gui = gui = client.gui
        self._told: tuple[str, Showing] | None = None
        self._said = Remarks()
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH_PX)
        self._head = gui.add_html("")
        self._bar = gui.add_progress_bar(0.0)
        self._answers = [
            gui.add_button(
                verdict.label,
                color=NEUTRAL_RGB if verdict.side is None else SIDE_RGBS[verdict.side],
            )
            for verdict in VERDICTS
        ]
        for verdict, button in zip(VERDICTS, self._answers, strict=True):
            button.on_click(posts(post, "verdict", verdict.verdict))
        self._why = gui.add_button_group("because of", tuple(ASPECT_OF_LABEL))
        self._why.on_click(posts_value(post, "why_label"))
        self._here = self._button("here", post)
        self._bad = self._button("bad", post)
        self._undo = self._button("undo", post)
        self._keep = self._button("keep", post)
        with gui.add_folder(f"Note (up to {NOTE_CHARS:,} characters), confidence"):
            self.note = gui.add_text("note", "", multiline=True)
            self.confidence = gui.add_dropdown("how sure", tuple(CONFIDENCES))
        self.note.on_update(posts_value(post, "note"))
        self.confidence.on_update(posts_value(post, "confidence"))
        with gui.add_folder("Last answers", expand_by_default=False):
            self._button("differed", post)
            self._history = [
                gui.add_button("", color=NEUTRAL_RGB, visible=False)
                for _ in range(HISTORY_LENGTH)
            ]
        for index, button in enumerate(self._history):
            button.on_click(posts(post, "reopen", index))
        with gui.add_folder("View and help", expand_by_default=False):
            for name in VIEW_BUTTONS:
                self._button(name, post)
            gui.add_html(LINKS)
        self._loop = gui.add_html("", visible=False)
        self._loop_bar = gui.add_progress_bar(0.0, visible=False, animated=True)
        self._habits = gui.add_html("")
        _add_hotkeys(client, post)

    def fill(self, rater_id: str, showing: Showing) -> None:
        """Show a question, or that there is none, to who is called `rater_id`."""
        self._told = (rater_id, showing)
        self._fill_head()
        progress = showing.progress
        done = progress.answered + progress.open
        self._bar.value = 100.0 * progress.answered / done if done else 0.0
        question = showing.question
        asked = question is not None
        for button in (*self._answers, self._here, self._bad):
            button.disabled = not asked
        # viser cannot disable a group.
        self._why.visible = asked
        self._undo.disabled = progress.answered == 0
        self._keep.disabled = question is None or question.corrects is None
        self._fill_history(showing.history, question and question.corrects)

    def warn(self, text: str) -> None:
        """Show a sentence until something else is shown."""
        if self._told is not None:
            rater_id, showing = self._told
            self._told = (rater_id, replace(showing, notice=text))
            self._fill_head()

    def fill_remarks(self, remarks: Remarks) -> None:
        """Show the remarks that come with a question."""
        self.note.value = remarks.note
        self.say(remarks)

    def say(self, remarks: Remarks) -> None:
        """Show all but the note, whose newest letters may be under way."""
        self.confidence.value = remarks.confidence
        self._said = remarks
        self._fill_head()

    def _fill_head(self) -> None:
        if self._told is not None:
            self._head.content = head(*self._told, self._said)

    def fill_status(self, status: LoopStatus | None) -> None:
        """Show what the loop does."""
        self._loop.visible = status is not None
        self._loop_bar.visible = status is not None and status.progress is not None
        if status is not None:
            self._loop.content = boxed(html.escape(status.text))
            self._loop_bar.value = 100.0 * (status.progress or 0.0)

    def keep_habits(self, habits: Habits) -> None:
        """Have the browser keep them."""
        self._habits.content = f'<i hidden data-gp-habits="{habits.text}"></i>'

    def _button(self, name: Name, post: Post) -> GuiButtonHandle:
        button = self._gui.add_button(SHORTCUTS[name].label, color=NEUTRAL_RGB)
        button.on_click(posts(post, name))
        return button

    def _fill_history(self, history: tuple[Past, ...], opened: Answer | None) -> None:
        for index, button in enumerate(self._history):
            button.visible = index < len(history)
            if index < len(history):
                past = history[index]
                is_open = opened is not None and (
                    past.answer.answer_id == opened.answer_id
                )
                button.label = past_words(past) + (OPEN_ENTRY if is_open else "")
                button.color = BRAND_RGB if is_open else NEUTRAL_RGB


def _add_hotkeys(client: viser.ClientHandle, post: Post) -> None:
    for key in ASPECT_KEYS:
        command = client.gui.add_command(f"Because of {key.aspect}", hotkey=key.key)
        command.on_trigger(posts(post, "why", key.aspect))
    for verdict in VERDICTS:
        command = client.gui.add_command(verdict.words, hotkey=verdict.key)
        command.on_trigger(posts(post, "hotkey_verdict", verdict.verdict))
    for shortcut in SHORTCUTS.values():
        command = client.gui.add_command(shortcut.words, hotkey=shortcut.key)
        command.on_trigger(posts(post, shortcut.name))
