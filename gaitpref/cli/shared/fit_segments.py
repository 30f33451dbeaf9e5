"""`gaitpref fit --segments`: a reward for segments of any table."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from io import StringIO
from pathlib import Path
from typing import Any, cast

from data.answers.rater_habits import RARE, Sides
from data.datasets.segments import (
    Segments,
    TableAnswer,
    read_answers,
    read_segments,
)
from data.errors import GaitprefError
from data.files.files import require_directory, whole_directory, write_atomically
from gaitpref.cli.options import options
from gaitpref.console.progress import console, counting_bar
from gaitpref.report.findings import findings_of_fit
from gaitpref.report.fit_summary import fit_summary
from rewardmodel.answers.likelihood import HARDLY_LOOKS
from rewardmodel.fitting.fit_reward import models_fitted
from rewardmodel.fitting.tables import (
    TABLE_FIT,
    TABLE_KINDS,
    TableKind,
    TableReward,
    fit_table,
)

REPORT_NAME, WORTH_NAME, WEIGHTS_NAME = "report.json", "segments.csv", "weights.csv"
_NAMES = (REPORT_NAME, WORTH_NAME, WEIGHTS_NAME)


def fit_segments(command: options.Fit) -> None:
    """Fit as `command` says; write what was found, and say it.

    Raises:
        GaitprefError: an option does not go with tables, or a table cannot be used.
    """
    if command.segments is None or command.labels is None or command.dataset:
        raise GaitprefError(
            "--segments and --labels go together, and without --dataset: the one holds "
            "what was judged, the other what was said of it"
        )
    if command.model not in TABLE_KINDS:
        raise GaitprefError(
            f"--model {command.model} sees a robot's gait; of --segments it is "
            f"{', '.join(TABLE_KINDS)}"
        )
    for name, given in (
        ("--method", command.method),
        ("--semi-supervised", command.semi_supervised),
        ("--doubted-below", command.doubted_below),
        ("--round", command.round),
        ("--rounds", command.rounds),
        ("--first-reward", command.first_reward),
        ("--answers", command.answers),
    ):
        if given:
            raise GaitprefError(f"{name} is about data sets: leave it out")
    require_directory(command.out, _NAMES)
    segments = read_segments(command.segments)
    answers = _answers_for(read_answers(command.labels, segments), command)
    kind = cast(TableKind, command.model)
    told = f"fitting {kind} to {len(answers)} answers, models"
    with counting_bar(told, models_fitted(TABLE_FIT)) as bar:
        reward = fit_table(
            segments,
            answers,
            kind,
            seed=command.seed,
            advance=lambda: bar.advance(bar.task_ids[0]),
        )
    _write(reward, segments, command.out)
    report = reward.report
    findings = findings_of_fit(report, ())
    one_sided = tuple(_one_sided(answers))
    findings = replace(findings, against=(*findings.against, *one_sided))
    sentence = findings.sentence
    if command.json:
        print(json.dumps({"model": kind, **asdict(report), "sentence": sentence}))
        return
    told = fit_summary(report, "the segments' pairs")
    console.print(f"{kind}: {told}; what it found is in {command.out}")
    if report.held_out_ece is not None:
        console.print(
            f"calibration error {report.held_out_ece:.2f}, at temperature "
            f"{report.temperature:.2f}; {report.ties} answers are ties"
        )
    console.print(sentence)
    for rater, share in report.raters:
        console.print(
            f"{rater}: {share:.0%} of the answers are taken for random"
            + (", who hardly looks" if share >= HARDLY_LOOKS else "")
        )


def _answers_for(answers: list[TableAnswer], command: options.Fit) -> list[TableAnswer]:
    """The answers of the raters whom the command names; of all where it names none.

    Raises:
        GaitprefError: somebody gave no answer, or a group is meant.
    """
    known = sorted({answer.rater for answer in answers})
    for name in command.whom:
        if name not in known:
            raise GaitprefError(
                f"--for {name}: no such rater answered in {command.labels}; there are "
                f"{', '.join(known)} (groups are of data sets, whose habits have names)"
            )
    return [a for a in answers if not command.whom or a.rater in command.whom]


def _one_sided(answers: Sequence[TableAnswer]) -> Iterator[str]:
    """Raters who prefer one side as hardly anybody does where sides are drawn by lot,
    in words; whether they are, a table does not say."""
    for rater in sorted({answer.rater for answer in answers}):
        own = [a.target for a in answers if a.rater == rater and a.target != 0.5]
        left = sum(target > 0.5 for target in own)
        sides = Sides(rater, left, len(own) - left, shuffled=True)
        if sides.one_sided:
            side = "left" if sides.left > sides.right else "right"
            times = max(sides.left, sides.right)
            yield (
                f"{rater} prefers the {side} segment in {times} of {len(own)} answers: "
                f"where sides are drawn by lot, less than one in {round(1 / RARE)} of "
                "those who look does"
            )


def _write(reward: TableReward, segments: Segments, directory: Path) -> None:
    """All files, or none."""
    with whole_directory(directory, _NAMES) as partial:
        text = json.dumps(asdict(reward.report), indent=1)
        write_atomically(partial / REPORT_NAME, text.encode())
        worth, spread = reward.worth(segments)
        rows = zip(segments.ids, worth.tolist(), spread.tolist(), strict=True)
        _table(partial / WORTH_NAME, ("segment", "worth", "spread"), rows)
        weights = reward.scorer.linear_weights
        if weights is not None:
            own = weights / reward.normaliser.std
            columns = (own.mean(dim=0).tolist(), own.std(dim=0).tolist())
            rows = zip(reward.names, *columns, strict=True)
            _table(partial / WEIGHTS_NAME, ("column", "weight", "spread"), rows)


def _table(path: Path, names: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    write_atomically(path, text.getvalue().encode())
