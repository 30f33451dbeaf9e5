"""What the page of a run says of trust, and the clips its reward likes and dislikes."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from rewardmodel.answers.clip_batch import read_clips
from rewardmodel.explain.attribution import explain
from rewardmodel.explain.learned_curves import Curve, learned_curves
from rewardmodel.models.storage import load_reward

from .film_section import film_of_clip
from .findings import NO_ALARM, findings_of_run
from .pictures import svg_of
from .ranked_clips import extremes
from .reward_strips import Footfalls, clip_picture, curves_picture
from .verdict import Verdict

COUNT = 2
"""Best, and worst clips on the page."""


def alarm_section(rounds: list[dict[str, Any]], criterion: str | None) -> str:
    """Every alarm of every round, and what the figures say of the newest.

    Args:
        rounds: What each reported.
        criterion: What the rater looks for, where that is known.
    """
    raised = [
        f"<li>Round {of_round['round']}: {html.escape(reason)}.</li>"
        for of_round in rounds
        for reason in of_round.get("trust", {}).get("alarms", ())
    ]
    besides = findings_of_run(rounds, criterion=criterion).besides
    if raised:
        besides = tuple(told for told in besides if told != NO_ALARM)
    told = "".join(f"<p>{_marked(_capitalised(said))}.</p>" for said in besides)
    if not raised:
        return told
    return f'<div class="alarm"><b>Alarm</b><ul>{"".join(raised)}</ul></div>{told}'


def _marked(text: str) -> str:
    """Words as HTML, commands between backticks as code."""
    return re.sub("`([^`]*)`", r"<code>\1</code>", html.escape(text))


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]


def groups_section(rounds: list[dict[str, Any]]) -> str:
    """Who agrees with whom, and about what; of a single rater, a change of wish."""
    if not (lines := rounds[-1].get("groups")):
        return ""
    told = (
        "&emsp;" * (len(line) - len(line.lstrip())) + _marked(line.lstrip())
        for line in lines
    )
    return f"<p>{'<br>'.join(told)}</p>"


def decided_section(rounds: list[dict[str, Any]]) -> str:
    """Whether the run takes its answers to err, and why; nothing before a reward."""
    return "".join(
        f"<p>{html.escape(_capitalised(of_round['decided']['told']))}. This was "
        f"decided once, after round {of_round['round']}, for the whole run.</p>"
        for of_round in rounds
        if of_round.get("decided")
    )


def approval_section(rounds: list[dict[str, Any]]) -> str:
    """What the answers said of new policies; nothing where they were not asked."""
    told = []
    for of_round in rounds:
        if found := of_round.get("approval"):
            judged = found["for_new"] + found["for_old"]
            dropped = "" if found["approved"] else ", so training went on from that"
            told.append(
                f"<li>Round {of_round['round']}: preferred to the policy before in "
                f"{found['for_new']} of {judged} answers{dropped}.</li>"
            )
    if not told:
        return ""
    return f"<p>New policies were judged by answers:</p><ul>{''.join(told)}</ul>"


def verdict_section(run: Path, rounds: list[dict[str, Any]]) -> str:
    """Whether the run ended better than it began, and what to do next; nothing where it
    has not ended."""
    if not (found := rounds[-1].get("verdict")):
        return ""
    verdict = Verdict.from_json(found)
    return (
        f"<p><strong>The run: {html.escape(verdict.sentence)}.</strong> "
        f"Next: {_marked(verdict.advice(run))}.</p>"
    )


def standstill_section(rounds: list[dict[str, Any]]) -> str:
    """In which rounds a robot that went nowhere was got going."""
    left = [of_round["round"] for of_round in rounds if of_round.get("standstill")]
    if not left:
        return ""
    numbers = ", ".join(map(str, left))
    return (
        f"<p>Before round {numbers} the robot went nowhere. So it was trained on what "
        f"those members of the reward think who like that least, to show what else "
        f"there is; that policy was not judged beside the other.</p>"
    )


def trust_cells(of_round: dict[str, Any]) -> tuple[str, str, str]:
    """Calibration error, accuracy on the round's own clips, and share of far motion."""
    trust = of_round.get("trust", {})
    newest, policy = trust.get("newest"), trust.get("policy")
    calibrated = trust.get("calibrated")
    far = policy and policy["drift"] and policy["drift"]["share_far"]
    return (
        f"{calibrated['ece']:.2f}" if calibrated else "-",
        f"{newest['share']:.2f} of {newest['answers']}" if newest else "-",
        "-" if far is None else f"{far:.0%}",
    )


def _meaning(curve: Curve) -> str:
    return f"<li>{curve.habit.name}: {html.escape(curve.habit.meaning)}.</li>"


def clips_section(
    run: Path,
    rounds: list[dict[str, Any]],
    *,
    films: bool = False,
    drawn: Callable[[], None] = lambda: None,
) -> str:
    """The newest reward's best and worst clips of the round it was fitted in, with
    `films` as pictures that move; `drawn` is called after each."""
    numbers = [r["round"] for r in rounds if r.get("fit")]
    if not numbers:
        return ""
    newest = max(numbers)
    try:
        model = load_reward(run / "rounds" / f"{newest:02d}" / "reward")
        dataset = Dataset.open(run / "dataset")
        entries = [e for e in dataset.entries() if e.meta.round == newest]
        found = extremes(model, dataset, COUNT, entries=entries)
        dt_s = dataset.entry(found[0][1].clip.rollout).meta.control_dt_s
    except GaitprefError as error:
        return f"<p>No clips are shown: {html.escape(str(error))}</p>"
    figures = []
    for name, shown in found:
        seen = read_clips([shown.clip], dataset.clip_features)
        feet = Footfalls.of(seen.features[0].numpy())
        picture = clip_picture(
            explain(model, seen, method="auto"),
            dataset.entry(shown.clip.rollout),
            shown.clip,
            shown.reward,
            feet=feet,
        )
        title = name.replace("-", " ")
        told = f"{title}: reward {shown.reward:+.2f}"
        alt = told if feet is None else f"{told}; {feet.words}"
        figures.append(
            f"<figure>{film_of_clip(dataset, shown.clip) if films else ''}"
            f"{svg_of(picture.axes[0], alt)}<figcaption>{title}</figcaption></figure>"
        )
        drawn()
    learned = ""
    if curves := learned_curves(model, control_dt_s=dt_s):
        learned = (
            "<p>What each habit adds to the reward of a step, over its usual values, "
            "with the spread of the ensemble; those that matter most.</p>"
            f"<figure>{svg_of(curves_picture(curves).axes[0])}</figure>"
            f"<ul>{''.join(map(_meaning, curves))}</ul>"
        )
    return (
        f"<h2>What the reward of round {newest} likes</h2>{learned}"
        f"<p>Reward of each step with the spread of the ensemble, and what each group "
        f"of habits adds to the reward of an average step; the dotted line is that "
        f"average. Below, a bar is a foot that stands.</p>"
        f'<div class="curves">{"".join(figures)}</div>'
    )
