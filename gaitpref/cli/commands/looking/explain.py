"""`gaitpref explain`: which moments and which habits a learned reward likes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset, EpisodeEntry
from data.episodes.clips import Clip
from data.errors import GaitprefError
from data.files.files import write_atomically
from gaitpref.cli.options import options
from gaitpref.console.progress import console, counted, working
from gaitpref.console.terminal import say
from gaitpref.report.answer_credit import newest_credited
from gaitpref.report.credit_picture import credit_picture
from gaitpref.report.pictures import save_picture
from gaitpref.report.ranked_clips import Ranked, extremes, ranked
from gaitpref.report.reward_strips import clip_picture, curves_picture
from rewardmodel.answers.clip_batch import read_clips
from rewardmodel.asking.clip_questions import ClipCfg, clips_of
from rewardmodel.explain.attribution import Explanation, explain
from rewardmodel.explain.four_ways import four_ways
from rewardmodel.explain.learned_curves import Curve, learned_curves
from rewardmodel.explain.marked import decided_there, moments_of
from rewardmodel.models.model import RewardModel
from rewardmodel.models.storage import load_reward
from rewardmodel.team.team_explained import explain_team
from rewardmodel.team.team_fit import rows_in
from rewardmodel.team.team_storage import TEAM_FACTS, load_team

DATA_NAME = "explanation.json"


def run(command: options.Explain) -> int:
    """Run the command; gives the exit code."""
    if (command.reward / TEAM_FACTS).exists():
        return _of_teams(command)
    model = load_reward(command.reward)
    dataset = Dataset.open(command.dataset)
    if command.clip is not None:
        clip = find_clip(dataset, command.clip)
        chosen = [("clip", ranked(model, dataset, [clip])[0])]
    else:
        with working("looking for the best and the worst clips"):
            chosen = extremes(model, dataset, command.count)
    with dataset.answers_copy() as store:
        answered = store.current_answers()
    chosen += _marked(model, dataset, answered, command)
    told = []
    with counted("explaining") as tell:
        for done, (name, found) in enumerate(chosen):
            tell(done, len(chosen))
            told.append(_explained(command, model, dataset, name, found, answered))
    answers = _credits(model, dataset, answered, command)
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
    console.next(
        f"`gaitpref pairs --dataset {command.dataset} --reward {command.reward} "
        f"--count 20` asks where it is in doubt"
    )
    return 0


def _of_teams(command: options.Explain) -> int:
    """Explain clips of teams."""
    model, dataset = load_team(command.reward), Dataset.open(command.dataset)
    rows = rows_in([dataset])
    if command.clip is None:
        clips = clips_of(dataset.entries(), ClipCfg())
    else:
        clips = [find_clip(dataset, command.clip)]
    if not clips:
        raise GaitprefError(f"{dataset.root} gives no clip of a team")

    def seen(clip: Clip) -> Explanation:
        return explain_team(model, torch.tensor(rows(clip.rollout)[clip.rows]))

    with working("looking for the best and the worst clips"):
        found = sorted(
            ((float(seen(clip).reward.mean()), clip) for clip in clips),
            key=lambda item: (-item[0], item[1]),
        )
    count = command.count
    chosen = [(f"best-{n}", each) for n, each in enumerate(found[:count], start=1)]
    if command.clip is not None:
        chosen = [("clip", found[0])]
    else:
        worst = enumerate(found[::-1][:count], start=1)
        chosen += [(f"worst-{n}", each) for n, each in worst]
    told = []
    for name, (reward, clip) in chosen:
        entry, shown = dataset.entry(clip.rollout), seen(clip)
        picture = command.out / f"{name}.svg"
        save_picture(clip_picture(shown, entry, clip, reward), picture)
        parts = four_ways(shown, control_dt_s=entry.meta.control_dt_s)
        both = ", ".join(f"{who} {share:+.2f}" for who, share in parts.robots.items())
        say(f"{picture}  reward {reward:+.2f} ({both})  {clip.key}")
        told.append(clip_json(name, Ranked(clip, reward), entry, shown))
    data = {"descriptors": list(model.names), "clips": told, "curves": []}
    write_atomically(command.out / DATA_NAME, json.dumps(data).encode())
    say(f"the figures are in {command.out / DATA_NAME}")
    console.next(
        f"`gaitpref team shares --reward {command.reward} --dataset "
        f"{command.dataset}` says who earns it over all episodes"
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
    picture = command.out / f"{name}.svg"
    save_picture(clip_picture(shown, entry, found.clip, found.reward), picture)
    here_s = moments_of(answered, found.clip)
    there = decided_there(shown, entry.meta.control_dt_s, here_s)
    marks = marked_words(here_s, there)
    say(f"{picture}  reward {found.reward:+.2f}  {found.clip.key}{marks}")
    marked = {"marked_s": here_s, "at_the_marks": _rounded_values(there)}
    return clip_json(name, found, entry, shown) | marked


def _credits(
    model: RewardModel,
    dataset: Dataset,
    answered: list[tuple[Pair, Answer]],
    command: options.Explain,
) -> list[dict[str, Any]]:
    """The figures of the newest answers, whose pictures are written."""
    if command.clip is not None:
        return []
    found = newest_credited(
        model, dataset, answered, command.count, method=command.method
    )
    told = []
    for number, each in enumerate(found, start=1):
        picture = command.out / f"answer-{number}.svg"
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
                    f"by_{name}": _rounded_values(row)
                    for name, row in each.credit.rows.items()
                },
            }
        )
    return told


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


def _rounded_values(values: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in values.items()}


def find_clip(dataset: Dataset, name: str) -> Clip:
    """The clip called EPISODE:START+STEPS, or a whole episode by its hash's beginning.

    Raises:
        GaitprefError: there is no such clip, or more than one episode.
    """
    sha256, colon, place = name.partition(":")
    entries = [e for e in dataset.entries() if e.sha256.startswith(sha256)]
    if len(entries) != 1:
        raise GaitprefError(
            f"{dataset.root} holds {len(entries)} episodes whose hash begins with "
            f"{sha256!r}; `--clip` takes EPISODE:START+STEPS, or an episode"
        )
    entry = entries[0]
    if not colon:
        return Clip(entry.sha256, 0, entry.num_steps)
    try:
        start, steps = (int(number) for number in place.split("+"))
        clip = Clip(entry.sha256, start, steps)
    except ValueError:
        raise GaitprefError(f"--clip {name!r} is not EPISODE:START+STEPS") from None
    dataset.clip_features(clip)
    return clip


def clip_json(
    name: str, found: Ranked, entry: EpisodeEntry, shown: Explanation
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
            way: _rounded_values(shares)
            for way, shares in four_ways(
                shown, control_dt_s=entry.meta.control_dt_s
            ).ways.items()
        },
    }


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
