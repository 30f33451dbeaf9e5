"""What the panel says, as HTML; pure functions.

The script in the browser finds its way by the attributes: `data-gp-ready` says that the
page is there, `data-gp-question` which question it shows, `data-gp-why` what decides,
`data-gp-here` which moments are marked, `data-gp-spoken` what to read aloud,
`data-gp-habits` how the rater likes to look.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from datetime import datetime

from data.episodes.command_words import words_of_command
from data.episodes.episode_records import TEAM_TASK
from labeling_ui.questions.judgement import Past
from labeling_ui.scene.clip_motion import Command

from .page_access import Showing
from .remarks import Marks, Remarks
from .shortcuts import WORDS

_HEAD_PX = 128
"""Room for six lines, two of them the command: what follows stands still."""
OPEN_ENTRY = " · open"
"""Ends the words of an answer in the history that is open again."""


def head(rater_id: str, showing: Showing, said: Remarks) -> str:
    """The top of the panel: who, what is asked, under which command."""
    progress, why = showing.progress, said.why
    count = f"{progress.answered} answered, {progress.open} open"
    question, lines = showing.question, []
    if question is None:
        lines.append("<b>No open pairs.</b>")
        lines.append(
            f"Thank you{_for_answers(progress.answered)}. Leave this page open: it "
            "goes on by itself when there are more."
        )
    else:
        motion = None if showing.motions is None else showing.motions[0]
        lies = motion is not None and motion.task == "getup"
        team = motion is not None and motion.task == TEAM_TASK
        who = "team" if team else "one"
        lines.append(f"<b>Which {who} {'gets up' if lies else 'walks'} better?</b>")
        if team:
            lines.append("Two robots each: judge both together. Feet: robot 1's.")
        if motion is not None and not lies:
            lines.append(command_words(motion.commands))
    if question is not None and question.pair.meanwhile is not None:
        lines.append("<i>Extra, while the robot learns: earlier clips.</i>")
    if question is not None and question.earlier is not None:
        before = WORDS[question.earlier].lower()
        lines.append(f"<i>Reopened: you said “{before}”.</i>")
    if why is not None or said.here_s:
        lines.append(f"{_said_words(said)}: now answer.")
    if showing.notice:
        lines.append(warning(showing.notice))
    marks = Marks(question_id=showing.question_id, here_s=said.here_s)
    top = (
        '<div style="display:flex;justify-content:space-between;opacity:.75;'
        f'font-size:12px"><span>{html.escape(rater_id)}</span><span>{count}</span></div>'
    )
    return (
        f'<div data-gp-ready data-gp-question="{showing.question_id or ""}" '
        f'data-gp-why="{why or ""}" data-gp-here="{marks.text}" '
        f'data-gp-spoken="{html.escape(spoken(showing, said))}" '
        f'style="height:{_HEAD_PX}px;overflow:auto">'
        + boxed(top + "".join(f"<div>{line}</div>" for line in lines))
        + "</div>"
    )


def _said_words(said: Remarks) -> str:
    """What decides, as far as it was said."""
    words = [] if said.why is None else [f"because of <b>{said.why}</b>"]
    if said.here_s:
        moments = ", ".join(f"{moment:.2f} s" for moment in said.here_s)
        words.append(f"marked <b>{moments}</b>")
    text = ", ".join(words)
    return text[:1].upper() + text[1:]


def spoken(showing: Showing, said: Remarks) -> str:
    """What a screen reader is told when the panel changes."""
    progress, question = showing.progress, showing.question
    says = [f"{progress.answered} answers stored, {progress.open} pairs to go."]
    if question is None:
        says.append("Nothing is asked now.")
    elif showing.motions is not None and showing.motions[0].task != "getup":
        commands = showing.motions[0].commands
        says.append(f"Asked: {', then '.join(map(words_of_command, commands))}.")
    if question is not None and question.earlier is not None:
        says.append(f"Open again; your answer was {WORDS[question.earlier]}.")
    if said.why is not None:
        says.append(f"What decides: {said.why}.")
    if said.here_s:
        says.append(f"{len(said.here_s)} moments marked.")
    return " ".join([*says, showing.notice]).strip()


def _for_answers(count: int) -> str:
    return {0: "", 1: " for an answer"}.get(count, f" for {count} answers")


def command_words(commands: Sequence[Command]) -> str:
    """What both robots were told to do, one after the other."""
    words = ", then ".join(words_of_command(command) for command in commands)
    return f"asked for: <b>{words}</b>"


def past_words(past: Past) -> str:
    """An answer in the history."""
    # The server's own time: who serves and who answers are mostly in one place.
    at = datetime.fromisoformat(past.answer.created_utc).astimezone().strftime("%H:%M")
    role = {"repeat": " · again"}.get(past.answer.role, "")
    return f"{at} · {WORDS[past.verdict]}{role}"


def warning(text: str) -> str:
    """A sentence in the colour of what a rater should not overlook."""
    return f'<span style="color:var(--gp-warn)">{html.escape(text)}</span>'


def boxed(inner: str) -> str:
    """HTML of the panel with some room around it."""
    return (
        '<div style="padding:2px 12px 6px;font-size:14px;line-height:1.45">'
        f"{inner}</div>"
    )


LINKS = boxed(
    '<button type="button" class="gp-link" data-gp-keys>Keys [?]</button> · '
    '<a href="figures" target="_blank">My figures</a> · '
    '<a href="guidelines" target="_blank">Guidelines in a window</a>'
)


def picture_html(svg: str) -> str:
    """A picture of what moved a reward, on white in either theme."""
    data = base64.b64encode(svg.encode()).decode()
    return boxed(
        '<img alt="What of this pair moved the reward, by moment and by habit" '
        'style="width:100%;background:#fff" '
        f'src="data:image/svg+xml;base64,{data}">'
    )
