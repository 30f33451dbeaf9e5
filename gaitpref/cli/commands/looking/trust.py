"""`gaitpref trust`: whether a learned reward deserves to be believed."""

from __future__ import annotations

import json

from data.datasets.gone import told_gone
from gaitpref.cli.options import options
from gaitpref.cli.shared.dataset_argument import open_dataset
from gaitpref.console.progress import console, counted
from gaitpref.console.terminal import say
from gaitpref.raters.rater_groups import answers_for
from gaitpref.report.calibration_plot import reliability_plot
from gaitpref.report.findings import about_raters, findings_of_trust
from gaitpref.report.fit_summary import what_remains
from gaitpref.report.pictures import save_picture
from gaitpref.report.trust_json import alarm_json, as_json
from policy.rollouts.evaluate import rollout_features
from policy.training.checkpoint import load_policy
from rewardmodel.answers.answered_pairs import AnsweredPairs, load_pairs
from rewardmodel.models.storage import load_reward
from rewardmodel.trust.alarms import Reach, alarms, reach, spelled
from rewardmodel.trust.held_out_report import Foreseen, foresee

EPISODES = 16
"""Episodes of the policy, over the grid of commands."""


def run(command: options.Trust) -> int:
    """Run the command; gives the exit code, 0 with an alarm too."""
    model = load_reward(command.reward)
    with counted("reading answers, clips") as tell:
        judged = load_pairs([open_dataset(command)], unchecked=True, tell=tell)
    if command.whom:
        judged = answers_for(judged, command.whom)
    told = f"foreseeing {len(judged)} answers without their episodes, models"
    with counted(told) as tell:
        foreseen = foresee(model, judged, seed=command.seed, tell=tell)
    reached = None
    if command.policy is not None:
        policy = load_policy(command.policy)
        with counted("what the policy does, steps") as tell:
            rows, lengths = rollout_features(
                policy,
                policy.robot(),
                policy.info.env,
                episodes=EPISODES,
                seed=command.seed,
                tell=tell,
            )
        reached = reach(model, judged, rows, lengths)
    reasons = alarms(foreseen, reached, sides=judged.sides)
    if command.picture is not None:
        save_picture(reliability_plot(foreseen), command.picture)
    same = model.provenance.answers_sha256 == judged.answers_sha256
    report = model.provenance.report
    values = {
        **as_json(foreseen, reached),
        "raters": about_raters(report, judged.sides),
        **alarm_json(reasons),
    }
    findings = findings_of_trust(values)
    if command.json:
        of_fit = {
            "answers_are_those_fitted": same,
            "enough": report.enough,
            "agreement": report.agreement,
            "open_share": report.open_share,
            "answers_gone": judged.num_gone,
        }
        print(json.dumps({**of_fit, **values, "sentence": findings.sentence}))
        return 0
    for line in _lines(command, judged, foreseen, reached, same):
        say(line)
    if remains := what_remains(report):
        say(f"left to ask     at its fit: {remains}")
    for reason in reasons:
        say(f"ALARM: {reason}")
    for besides in findings.besides:
        say(besides)
    given = f"--reward {command.reward} --dataset {command.dataset}"
    console.next(
        f"`gaitpref explain {given} --out WHY` shows what it likes"
        if reasons
        else f"`gaitpref train --method style {given} --init POLICY --out NEW` trains "
        f"on it"
    )
    return 0


def _lines(
    command: options.Trust,
    judged: AnsweredPairs,
    foreseen: Foreseen,
    reached: Reach | None,
    same: bool,
) -> list[str]:
    gone = told_gone(judged.num_gone, judged.num_collected, command.dataset)
    lines = [
        f"answers         {len(judged)} in {command.dataset}"
        + ("" if same else ", others than the reward was fitted to"),
        *([f"gone            {gone}"] if gone else []),
        f"held out        {foreseen.answers} answers, {foreseen.ties} of them ties"
        + (
            f"; {foreseen.left_out} of who hardly looks are left out"
            if foreseen.left_out
            else ""
        ),
        f"accuracy        {foreseen.accuracy or '-'}",
        f"at random       {foreseen.at_random or '-'}",
        f"by opinion      {foreseen.opinion or '-'}",
        f"newest round    {foreseen.newest or '-'}",
    ]
    if foreseen.by_chance is not None:
        lines.append(
            f"by chance       the answers are random with probability "
            f"{foreseen.by_chance:.2f}"
        )
    lines += [f"  command {k:<15}{v}" for k, v in foreseen.by_command.items()]
    lines += [f"  round   {k:<15}{v}" for k, v in foreseen.by_round.items()]
    before, after = foreseen.uncalibrated, foreseen.calibrated
    if before is not None and after is not None:
        lines += [
            f"calibration     error {after.ece:.3f} at temperature "
            f"{foreseen.temperature:.2f}, {before.ece:.3f} without; this many answers "
            f"show {after.ece_by_chance:.3f} by chance alone",
            f"Brier           {after.brier:.3f}, {before.brier:.3f} without; 0.25 says "
            f"nothing",
        ]
    if foreseen.tie_separation is not None:
        lines.append(
            f"ties            have the smaller lead {foreseen.tie_separation:.0%} of "
            f"the time, 50% is chance"
        )
    if reached is not None:
        lines.append(
            f"spread          {reached.spread:.2f} on the policy, "
            f"{reached.spread_judged:.2f} on the judged clips"
        )
        if reached.drift is not None:
            lines.append(f"drift           {spelled(reached.drift)}")
    return lines
