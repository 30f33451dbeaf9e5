"""The data card of a data set, in Markdown; what only its publisher knows is open."""

from __future__ import annotations

from dataclasses import dataclass, fields

from data.files.shown import shown

from .overview import Overview

OPEN = "TO BE FILLED IN BY THE PUBLISHER"


@dataclass(frozen=True, kw_only=True)
class CardFacts:
    """What a data set cannot know of itself."""

    title: str = OPEN
    author: str = OPEN
    """Who publishes it, and how to reach them."""
    licence_rollouts: str = OPEN
    """Licence of the episodes; CC-BY-4.0 and CC0-1.0 are usual."""
    licence_answers: str = OPEN
    """Licence of the answers; the raters must have agreed to it."""
    licence_robot: str = OPEN
    """Licence of the robot model that every episode carries."""
    consent: str = OPEN
    """What the raters were told and agreed to."""

    @property
    def open_fields(self) -> tuple[str, ...]:
        """What still has to be filled in."""
        return tuple(f.name for f in fields(self) if getattr(self, f.name) == OPEN)


def card(seen: Overview, facts: CardFacts) -> str:
    """The card's text."""
    raters = len({count.rater for count in seen.answers})
    answers = sum(count.answers for count in seen.answers)
    return f"""---
license: other
license_name: "{facts.licence_rollouts}"
tags: [robotics, quadruped, preferences]
---

# {facts.title}

Gaits of a quadruped as MCAP episodes, and which of two clips a rater found better.

| | |
|---|---|
| published by | {facts.author} |
| licence of the episodes | {facts.licence_rollouts} |
| licence of the answers | {facts.licence_answers} |
| licence of the robot model | {facts.licence_robot} |
| consent of the raters | {facts.consent} |

## What is in it

| | |
|---|---|
| episodes | {seen.episodes:,} |
| steps | {seen.steps:,} |
| hours of robot time | {seen.hours:.2f} |
| ended by a fall | {seen.falls:,} |
| aborted | {seen.aborted:,} |
| bytes | {seen.bytes:,} |
| robots | {_listed(seen.robots)} |
| tasks | {_listed(seen.tasks)} |
| policies | {len(seen.policies):,} |
| pairs | {seen.pairs:,} |
| answers | {answers:,} by {raters} raters |

Commands, as forward m/s, left m/s, yaw rad/s:

{_bullets(seen.commands)}

Answers:

| rater | round | answers | of them preferences |
|---|---|---|---|
{_answers(seen)}

## How to read it

`gaitpref data info --dataset DIR` counts what is in it, and `gaitpref data verify
--dataset DIR` compares every byte with what was written. `manifest.json` lists the
episodes, each an MCAP file under `rollouts/` named by its SHA-256. `preferences.sqlite`
holds pairs and answers; `gaitpref data labels` prints them as JSON lines, CSV, Parquet.
A clip is named by its episode's hash, its first control step and its number of steps.
`target` is the probability that clip a is better; it is empty for "can't tell" and for
clips that were called bad.

## What to mind

Raters are pseudonyms. Preferences are those of the raters above under the question
`better_overall`, not a measure of quality. Split by episode, never by pair: clips of
one episode resemble one another.
"""


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{_cell(name)} ({count:,})" for name, count in counts.items())


def _bullets(counts: dict[str, int]) -> str:
    lines = [f"- {name}: {count:,} episodes" for name, count in counts.items()]
    return "\n".join(lines) or "- none"


def _answers(seen: Overview) -> str:
    return "\n".join(
        f"| {_cell(c.rater)} | {c.round} | {c.answers:,} | {c.preferences:,} |"
        for c in seen.answers
    )


def _cell(text: str) -> str:
    """Text that cannot leave its cell."""
    return shown(" ".join(text.split())).replace("|", "\\|").replace("<", "&lt;")
