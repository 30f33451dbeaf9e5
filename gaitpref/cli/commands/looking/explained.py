"""What `gaitpref explain` tells of clips and answers: pictures, and figures of JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset, EpisodeEntry
from data.episodes.command_words import words_of_command
from data.files.files import write_atomically
from gaitpref.cli.commands.looking.explained_page import explained_page
from gaitpref.console.terminal import say
from gaitpref.report.answer_credit import newest_credited
from gaitpref.report.credit_picture import credit_picture
from gaitpref.report.crediting import Crediting
from gaitpref.report.pictures import save_picture
from gaitpref.report.ranked_clips import Ranked
from rewardmodel.explain.attribution import Explanation
from rewardmodel.explain.four_ways import Run, four_ways
from rewardmodel.explain.learned_curves import Curve

DATA_NAME, PAGE_NAME = "explanation.json", "index.html"


def answers_told(
    reward: Crediting,
    dataset: Dataset,
    answered: Sequence[tuple[Pair, Answer]],
    out: Path,
    count: int,
) -> list[dict[str, Any]]:
    """The figures of the newest answers, whose pictures are written to `out`."""
    told = []
    found = newest_credited(reward, dataset, answered, count)
    for number, each in enumerate(found, start=1):
        picture = out / f"answer-{number}.svg"
        save_picture(
            credit_picture(each.credit, dt_s=each.dt_s, title=each.title), picture
        )
        say(f"{picture}  {each.title}: A leads by {each.credit.lead:+.2f}")
        told.append(
            {
                "pair_id": each.pair.pair_id,
                "rater": each.answer.rater_id,
                "left": each.answer.shown_left,
                "choice": each.answer.choice,
                "lead": round(each.credit.lead, 4),
                "moments": [_rounded(part) for part in each.credit.moments],
                **{
                    f"by_{name}": rounded_values(row)
                    for name, row in each.credit.rows.items()
                },
            }
        )
    return told


def clip_json(
    name: str,
    found: Ranked,
    entry: EpisodeEntry,
    shown: Explanation,
    runs: Sequence[Run] = (),
) -> dict[str, Any]:
    """A clip's figures as plain values, rounded to what can be seen."""
    return {
        "name": name,
        "clip": found.clip.key,
        "reward_of_clip": round(found.reward, 4),
        "command": list(entry.meta.command),
        "control_dt_s": entry.meta.control_dt_s,
        "method": shown.method,
        "reward": _rounded(shown.reward),
        "spread": _rounded(shown.spread),
        "average": round(shown.average, 4),
        "groups": list(shown.groups),
        "shares": _rounded(shown.shares),
        "by_descriptor": (
            _rounded(shown.descriptors)
            if np.isfinite(shown.descriptors).all()
            else None
        ),
        "ways": {
            way: rounded_values(shares)
            for way, shares in four_ways(
                shown, control_dt_s=entry.meta.control_dt_s, runs=runs
            ).ways.items()
        },
    }


def write_page(
    out: Path,
    title: str,
    clips: Sequence[Mapping[str, Any]],
    answers: Sequence[Mapping[str, Any]],
) -> None:
    """Write a page of the pictures in `out` that these figures are of."""
    pictures = [
        (
            out / f"{clip['name']}.svg",
            f"{clip['name'].replace('-', ' ')}: reward {clip['reward_of_clip']:+.2f}, "
            f"asked for {words_of_command(clip['command'])}",
            f"--clip {clip['clip']}",
        )
        for clip in clips
    ]
    pictures += [
        (
            out / f"answer-{number}.svg",
            f"an answer of {answer['rater']}: A leads by {answer['lead']:+.2f}",
            f"--pair {answer['pair_id']}",
        )
        for number, answer in enumerate(answers, start=1)
    ]
    if (habits := out / "habits.svg").exists():
        pictures.append((habits, "the habits that matter most", ""))
    page = out / PAGE_NAME
    write_atomically(page, explained_page(title, pictures).encode())
    say(f"all of it on one page: {page}")


def curve_json(curve: Curve) -> dict[str, Any]:
    """A habit's curve as plain values."""
    return {
        "name": curve.habit.name,
        "unit": curve.habit.unit,
        "values": _rounded(curve.values),
        "reward": _rounded(curve.reward),
        "spread": _rounded(curve.spread),
    }


def _rounded(values: np.ndarray) -> list[Any]:
    return np.round(values.astype(float), 4).tolist()


def rounded_values(values: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in values.items()}
