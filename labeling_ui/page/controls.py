"""The panels of the page of one client: made once, then only filled anew."""

from __future__ import annotations

import html
from collections.abc import Callable, Coroutine, Sequence
from datetime import datetime
from typing import Any

import viser
from viser import GuiButtonHandle, GuiEvent

from data.answers.answer_records import Aspect
from data.files.limits import NOTE_CHARS
from labeling_ui.questions.judgement import Past, Verdict
from labeling_ui.scene.clip_motion import Command
from labeling_ui.scene.scene import side_colour

from .loop_status import LoopStatus
from .page_access import HISTORY_LENGTH, Showing
from .shortcuts import (
    ASPECT_KEYS,
    ASPECT_OF_LABEL,
    CONFIDENCES,
    SHORTCUTS,
    VERDICTS,
    WORDS,
    Name,
)

Post = Callable[..., None]
"""Takes the name of an event and its value; never blocks."""

PANEL_WIDTH_PX = 316
_FLOATING_PX = (560, 900)


def floating_width_px(client: viser.ClientHandle) -> int:
    """Width of the panel below the robots, so that it ends before the docked one."""
    low, high = _FLOATING_PX
    return min(max(client.camera.image_width - PANEL_WIDTH_PX - 64, low), high)


CLOCK_BUTTONS: tuple[Name, ...] = (
    "play", "replay", "back", "on", "slower", "faster",
)  # fmt: skip
_NEUTRAL = "gray"


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
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH_PX)
        self._head = gui.add_html("")
        self._bar = gui.add_progress_bar(0.0)
        self._answers = [
            gui.add_button(
                verdict.label,
                color=_NEUTRAL if verdict.side is None else side_colour(verdict.side),
            )
            for verdict in VERDICTS
        ]
        for verdict, button in zip(VERDICTS, self._answers, strict=True):
            button.on_click(posts(post, "verdict", verdict.verdict))
        self._why = gui.add_button_group("because of", tuple(ASPECT_OF_LABEL))
        self._why.on_click(posts_value(post, "why_label"))
        self._why_said = gui.add_html("", visible=False)
        self._bad = self._button("bad", post)
        self._undo = self._button("undo", post)
        self._keep = self._button("keep", post)
        with gui.add_folder(f"Note (up to {NOTE_CHARS:,} characters), confidence"):
            self.note = gui.add_text("note", "", multiline=True)
            self.confidence = gui.add_dropdown("you are", tuple(CONFIDENCES))
        self.note.on_update(posts_value(post, "note"))
        with gui.add_folder("Last answers", expand_by_default=False):
            self._history = [
                gui.add_button("", color=_NEUTRAL, visible=False)
                for _ in range(HISTORY_LENGTH)
            ]
        for index, button in enumerate(self._history):
            button.on_click(posts(post, "reopen", index))
        with gui.add_folder("View and help", expand_by_default=False):
            for name in ("guidelines", "view", "camera", "theme"):
                self._button(name, post)
            self._links = gui.add_html(_LINKS)
        self._loop = gui.add_html("", visible=False)
        self._loop_bar = gui.add_progress_bar(0.0, visible=False, animated=True)
        _add_hotkeys(client, post)

    def fill(self, rater_id: str, showing: Showing) -> None:
        """Show a question, or that there is none."""
        self._head.content = head(rater_id, showing)
        progress = showing.progress
        done = progress.answered + progress.open
        self._bar.value = 100.0 * progress.answered / done if done else 0.0
        question = showing.question
        asked = question is not None
        for button in (*self._answers, self._bad):
            button.disabled = not asked
        # viser cannot disable a group.
        self._why.visible = asked
        self._undo.disabled = progress.answered == 0
        self._keep.visible = question is not None and question.corrects is not None
        self._fill_history(showing.history)

    def warn(self, text: str) -> None:
        """Show a sentence until something else is shown."""
        self._head.content += boxed(warning(text))

    def say_why(self, why: Aspect | None) -> None:
        """Show what of the gait is said to decide the answer."""
        self._why_said.visible = why is not None
        self._why_said.content = boxed(f"Because of <b>{why}</b>: now answer.")

    def clear_remarks(self) -> None:
        """Start the next pair without note and confidence."""
        self.note.value = ""
        self.confidence.value = next(iter(CONFIDENCES))

    def fill_status(self, status: LoopStatus | None) -> None:
        """Show what the loop does."""
        self._loop.visible = status is not None
        self._loop_bar.visible = status is not None and status.progress is not None
        if status is not None:
            self._loop.content = boxed(html.escape(status.text))
            self._loop_bar.value = 100.0 * (status.progress or 0.0)

    def _button(self, name: Name, post: Post) -> GuiButtonHandle:
        button = self._gui.add_button(SHORTCUTS[name].label, color=_NEUTRAL)
        button.on_click(posts(post, name))
        return button

    def _fill_history(self, history: tuple[Past, ...]) -> None:
        for index, button in enumerate(self._history):
            button.visible = index < len(history)
            if index < len(history):
                button.label = past_words(history[index])


def head(rater_id: str, showing: Showing) -> str:
    """The top of the panel: who, what is asked, under which command."""
    progress = showing.progress
    count = f"{progress.answered} answered, {progress.open} open"
    question, lines = showing.question, []
    if question is None:
        lines.append("<b>No open pairs.</b>")
        lines.append(
            "Leave this page open: it goes on by itself when there are more. "
            "<code>gaitpref pairs --dataset DIR --count 50</code> asks for some."
        )
    else:
        motion = None if showing.motions is None else showing.motions[0]
        lies = motion is not None and motion.task == "getup"
        lines.append(f"<b>Which one {'gets up' if lies else 'walks'} better?</b>")
        if motion is not None and not lies:
            lines.append(command_words(motion.commands))
    if question is not None and question.earlier is not None:
        said = WORDS[question.earlier].lower()
        lines.append(f"<i>Reopened: you said “{said}”. Answer again, or keep it.</i>")
    if showing.notice:
        lines.append(warning(showing.notice))
    top = (
        f'<div style="display:flex;justify-content:space-between;opacity:.65;'
        f'font-size:12px"><span>{html.escape(rater_id)}</span><span>{count}</span></div>'
    )
    return boxed(top + "".join(f"<div>{line}</div>" for line in lines))


def command_words(commands: Sequence[Command]) -> str:
    """What both robots were told to do, one after the other."""
    words = ", then ".join(_one_command(command) for command in commands)
    return f"asked for: <b>{words}</b>"


def _one_command(command: Command) -> str:
    forward, left, yaw = command
    words = [f"{'forward' if forward >= 0 else 'backward'} {abs(forward):.2f} m/s"]
    if abs(left) >= 0.005:
        words.append(f"{'left' if left > 0 else 'right'} {abs(left):.2f} m/s")
    if abs(yaw) >= 0.005:
        words.append(f"turning {'left' if yaw > 0 else 'right'} {abs(yaw):.2f} rad/s")
    return ", ".join(words)


def past_words(past: Past) -> str:
    """An answer in the history."""
    # The server's own time: who serves and who answers are mostly in one place.
    at = datetime.fromisoformat(past.answer.created_utc).astimezone().strftime("%H:%M")
    role = {"repeat": " · again"}.get(past.answer.role, "")
    return f"{at} · {verdict_words(past.verdict)}{role}"


def verdict_words(verdict: Verdict) -> str:
    """An answer in words."""
    return WORDS[verdict]


def warning(text: str) -> str:
    """A sentence in the colour of what a rater should not overlook."""
    return f'<span style="color:#e8590c">{html.escape(text)}</span>'


def boxed(inner: str) -> str:
    """HTML of the panel with some room around it."""
    return (
        '<div style="padding:2px 12px 6px;font-size:14px;line-height:1.45">'
        f"{inner}</div>"
    )


_LINKS = boxed(
    '<a href="figures" target="_blank">My figures</a> · '
    '<a href="guidelines" target="_blank">Guidelines in a window</a>'
)


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
