"""`gaitpref explain`: which moments and which habits a learned reward likes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.datasets.named_clip import find_clip
from data.files.files import write_atomically
from gaitpref.cli.commands.looking.explain_others import explain_others
from gaitpref.cli.commands.looking.explained import (
    DATA_NAME,
    answers_told,
    clip_json,
    curve_json,
    rounded_values,
    write_page,
)
from gaitpref.cli.options import options
from gaitpref.console.progress import console, counted
from gaitpref.console.terminal import say
from gaitpref.report.crediting import (
    OfHabits,
    load_crediting,
    require_fitting,
    runs_of,
)
from gaitpref.report.pictures import save_picture
from gaitpref.report.ranked_clips import Ranked, extremes, ranked
from gaitpref.report.reward_strips import Footfalls, clip_picture, curves_picture
from rewardmodel.answers.clip_batch import read_clips
from rewardmodel.explain.attribution import explain
from rewardmodel.explain.learned_curves import learned_curves
from rewardmodel.explain.marked import decided_there, moments_of
from rewardmodel.models.model import RewardModel


def run(command: options.Explain) -> int:
    """Run the command; gives the exit code."""
    dataset = Dataset.open(command.dataset)
    reward = load_crediting(command.reward, command.method)
    require_fitting(reward, dataset)
    if not isinstance(reward, OfHabits):
        return explain_others(command, dataset, reward)
    model = reward.model
    if command.clip is not None:
        clip = find_clip(dataset, command.clip)
        chosen = [("clip", ranked(model, dataset, [clip])[0])]
    else:
        with counted("looking for the best and the worst clips") as tell:
            chosen = extremes(model, dataset, command.count, tell=tell)
    with dataset.answers_copy() as store:
        answered = store.current_answers()
    chosen += _marked(model, dataset, answered, command)
    told = []
    with counted("explaining") as tell:
        for done, (name, found) in enumerate(chosen):
            tell(done, len(chosen))
            told.append(_explained(command, model, dataset, name, found, answered))
    count = command.count if command.clip is None else 0
    answers = answers_told(reward, dataset, answered, command.out, count)
    dt_s = dataset.entry(chosen[0][1].clip.rollout).meta.control_dt_s
    if curves := learned_curves(model, control_dt_s=dt_s):
        picture = command.out / "habits.svg"
        save_picture(curves_picture(curves), picture)
        say(f"{picture}  most of all {curves[0].habit.name}")
    data = {
        "descriptors": list(model.names),
        "clips": told,
        "answers": answers,
        "curves": [curve_json(curve) for curve in curves],
    }
    write_atomically(command.out / DATA_NAME, json.dumps(data).encode())
    say(f"the figures are in {command.out / DATA_NAME}")
    write_page(command.out, f"What {command.reward} likes", told, answers)
    console.next(
        f"`gaitpref pairs --dataset {command.dataset} --reward {command.reward} "
        f"--count 20` asks where it is in doubt"
    )
    return 0


def _explained(
    command: options.Explain,
    model: RewardModel,
    dataset: Dataset,
    name: str,
    found: Ranked,
    answered: list[tuple[Pair, Answer]],
) -> dict[str, Any]:
    """The figures of a clip, whose picture is written."""
    entry = dataset.entry(found.clip.rollout)
    seen = read_clips([found.clip], dataset.clip_features)
    shown = explain(model, seen, method=command.method)
    picture, runs = command.out / f"{name}.svg", runs_of(dataset, found.clip)
    feet = Footfalls.of(seen.features[0].numpy())
    drawn = clip_picture(shown, entry, found.clip, found.reward, runs, feet)
    save_picture(drawn, picture)
    here_s = moments_of(answered, found.clip)
    there = decided_there(shown, entry.meta.control_dt_s, here_s)
    marks = marked_words(here_s, there)
    say(f"{picture}  reward {found.reward:+.2f}  {found.clip.key}{marks}")
    marked = {"marked_s": here_s, "at_the_marks": rounded_values(there)}
    return clip_json(name, found, entry, shown, runs) | marked


def _marked(
    model: RewardModel,
    dataset: Dataset,
    answered: list[tuple[Pair, Answer]],
    command: options.Explain,
) -> list[tuple[str, Ranked]]:
    """Clips in which people marked moments, as many as of the best."""
    if command.clip is not None:
        return []
    clips = {
        clip: None
        for pair, answer in answered
        if answer.here_s
        for clip in (pair.a, pair.b)
        if dataset.holds(clip.rollout)
    }
    found = ranked(model, dataset, list(clips)[: 2 * command.count]) if clips else []
    return [(f"marked-{number}", each) for number, each in enumerate(found, start=1)]


def marked_words(here_s: Sequence[float], there: Mapping[str, float]) -> str:
    """What the reward sees at the moments that people marked; nothing without any."""
    if not here_s:
        return ""
    moments = ", ".join(f"{moment:.2f} s" for moment in here_s)
    group, more = next(iter(there.items()), ("", 0.0))
    seen = f"; there the reward is {more:+.2f} for {group}" * bool(group)
    return f"  marked at {moments}{seen}"
