"""`gaitpref explain` of rewards that look at more than a robot's habits: at both robots
of a team, or at which gait runs when.
"""

from __future__ import annotations

import json
from typing import Any

from data.datasets.dataset import Dataset
from data.datasets.named_clip import find_clip
from data.episodes.clips import Clip
from data.errors import GaitprefError
from data.files.files import write_atomically
from gaitpref.cli.commands.looking.explained import (
    DATA_NAME,
    answers_told,
    clip_json,
    write_page,
)
from gaitpref.cli.options import options
from gaitpref.console.progress import console, each_counted
from gaitpref.console.terminal import say
from gaitpref.report.crediting import Crediting, OfTeams
from gaitpref.report.pictures import save_picture
from gaitpref.report.ranked_clips import Ranked
from gaitpref.report.reward_strips import Footfalls, clip_picture
from rewardmodel.asking.clip_questions import ClipCfg, clips_of
from rewardmodel.explain.four_ways import four_ways


def explain_others(
    command: options.Explain, dataset: Dataset, reward: Crediting
) -> int:
    """Run the command; gives the exit code."""
    if command.clip is None:
        clips = clips_of(dataset.entries(), ClipCfg())
    else:
        clips = [find_clip(dataset, command.clip)]
    if not clips:
        raise GaitprefError(
            f"{dataset.root} gives no clip of {ClipCfg().clip_s:g} s: --clip EPISODE "
            "explains a whole episode"
        )
    told = "looking for the best and the worst clips"
    with each_counted(told, clips, len(clips)) as each_clip:
        found = sorted(
            (_ranked(reward, dataset, clip) for clip in each_clip),
            key=lambda each: (-each.reward, each.clip),
        )
    count = command.count
    chosen = [(f"best-{n}", each) for n, each in enumerate(found[:count], start=1)]
    if command.clip is not None:
        chosen, count = [("clip", found[0])], 0
    worst = enumerate(found[::-1][:count], start=1)
    chosen += [(f"worst-{n}", each) for n, each in worst]
    told = [_told(command, dataset, reward, name, each) for name, each in chosen]
    with dataset.answers_copy() as store:
        answered = store.current_answers()
    answers = answers_told(reward, dataset, answered, command.out, count)
    names = reward.side(dataset, found[0].clip).shown.names
    data = {
        "descriptors": list(names),
        "clips": told,
        "answers": answers,
        "curves": [],
    }
    write_atomically(command.out / DATA_NAME, json.dumps(data).encode())
    say(f"the figures are in {command.out / DATA_NAME}")
    write_page(command.out, f"What {command.reward} likes", told, answers)
    console.next(_next(command, reward))
    return 0


def _ranked(reward: Crediting, dataset: Dataset, clip: Clip) -> Ranked:
    side = reward.side(dataset, clip)
    return Ranked(clip, side.mean - reward.fall_price * side.fell)


def _told(
    command: options.Explain,
    dataset: Dataset,
    reward: Crediting,
    name: str,
    found: Ranked,
) -> dict[str, Any]:
    """The figures of a clip, whose picture is written."""
    clip = found.clip
    entry, side = dataset.entry(clip.rollout), reward.side(dataset, clip)
    picture = command.out / f"{name}.svg"
    # Of a team there are eight feet, and rows of one robot.
    feet = None if entry.meta.is_team else Footfalls.of(dataset.clip_features(clip))
    drawn = clip_picture(side.shown, entry, clip, found.reward, side.runs, feet)
    save_picture(drawn, picture)
    dt_s = entry.meta.control_dt_s
    parts = four_ways(side.shown, control_dt_s=dt_s, runs=side.runs)
    shares = {**parts.choices, **parts.robots}
    parted = ", ".join(f"{who} {share:+.2f}" for who, share in shares.items())
    say(f"{picture}  reward {found.reward:+.2f} ({parted})  {clip.key}")
    return clip_json(name, found, entry, side.shown, side.runs)


def _next(command: options.Explain, reward: Crediting) -> str:
    at = f"--reward {command.reward} --dataset {command.dataset}"
    if isinstance(reward, OfTeams):
        return f"`gaitpref team shares {at}` says who earns it over all episodes"
    return (
        f"`gaitpref label {at} --no-auth --open` asks on, and key 6 draws this after "
        "an answer"
    )
