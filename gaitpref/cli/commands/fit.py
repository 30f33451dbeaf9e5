"""`gaitpref fit` and `gaitpref relabel`: with a data set and torch alone.

Neither a simulator nor viser is imported here, so that data sets can be reused where
they are not installed.
"""

from __future__ import annotations

import json
import shlex
from dataclasses import asdict, replace

import numpy as np

from data.datasets.dataset import Dataset
from data.datasets.gone import told_gone
from data.datasets.manifest_file import writable
from data.errors import GaitprefError
from data.files.files import require_directory
from data.files.lock import only_writer
from gaitpref.cli.options import options
from gaitpref.cli.shared.by_hand import (
    refuse_beside_method,
    stage_of,
    told_without_method,
)
from gaitpref.cli.shared.dataset_argument import address
from gaitpref.cli.shared.fit_segments import fit_segments
from gaitpref.console.extras import require
from gaitpref.console.progress import console, counted, counting_bar
from gaitpref.raters.rater_groups import answers_for
from gaitpref.report.findings import findings_of_fit
from gaitpref.report.fit_summary import fit_summary
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.answers.likelihood import HARDLY_LOOKS
from rewardmodel.cfg import FitCfg
from rewardmodel.extensions.questions.unanswered import unanswered_pairs
from rewardmodel.extensions_cfg import LabelFilterCfg, SemiSupervisedCfg
from rewardmodel.fitting.fit_reward import fit_reward, models_fitted
from rewardmodel.models.storage import REWARD_NAMES, load_reward, save_reward


def run(command: options.Command) -> int:
    """Run the command; gives the exit code."""
    if isinstance(command, options.Relabel):
        _relabel(command)
    elif isinstance(command, options.Fit):
        _fit(command)
    else:
        raise TypeError(f"{type(command).__name__} is run by another module")
    return 0


def _fit(command: options.Fit) -> None:
    require_directory(command.out, REWARD_NAMES if command.dataset else None)
    with only_writer(command.out, console.print, replaced=True):
        _fit_alone(command)


def _fit_alone(command: options.Fit) -> None:
    if command.segments is not None or command.labels is not None:
        fit_segments(command)
        return
    if not command.dataset:
        raise GaitprefError(
            "what is to be fitted? give --dataset DIR, or --segments FILE with --labels"
        )
    answers = address(command.answers)
    datasets = [Dataset.open(path, answers=answers) for path in command.dataset]
    if teams := [d.root for d in datasets if any(e.meta.is_team for e in d.entries())]:
        raise GaitprefError(
            f"{teams[0]} shows teams of two, of which this reward would see one robot: "
            f"`gaitpref team fit --dataset {teams[0]} --out {command.out}` sees both"
        )
    cfg = FitCfg(kind=command.model, label_filter=_label_filter(command.doubted_below))
    refuse_beside_method(
        command,
        {
            "--model": command.model != "linear",
            "--doubted-below": command.doubted_below > 0,
            "--semi-supervised": command.semi_supervised,
        },
    )
    stage = stage_of(command)
    if stage is not None:
        cfg = stage.fit
    with counted("reading answers, clips") as tell:
        pairs = load_pairs(datasets, unchecked=command.unchecked, tell=tell)
    unanswered = None
    if command.whom:
        pairs = answers_for(pairs, command.whom)
    if command.semi_supervised:
        semi = SemiSupervisedCfg()
        cfg = replace(cfg, semi_supervised=semi)
        rng = np.random.default_rng(command.seed)
        unanswered = unanswered_pairs(datasets, pairs, semi, rng=rng)
    told = f"fitting {cfg.kind} to {len(pairs)} answers, models"
    with counting_bar(told, models_fitted(cfg)) as bar:
        model, report = fit_reward(
            pairs,
            cfg,
            seed=command.seed,
            unanswered=unanswered,
            advance=lambda: bar.advance(bar.task_ids[0]),
        )
    save_reward(model, command.out)
    kind = model.provenance.cfg.kind
    findings = findings_of_fit(report, pairs.sides)
    if command.json:
        told = {"answers_gone": pairs.num_gone, "sentence": findings.sentence}
        print(json.dumps({"model": kind, **asdict(report), **told}))
        return
    console.print(f"{kind}: {fit_summary(report)}; the reward is {command.out}")
    gone = told_gone(pairs.num_gone, pairs.num_collected, command.dataset[0])
    left_out = [f"answers: {told}" for told in pairs.left_out.told]
    for line in filter(None, (gone, *left_out, *findings.besides)):
        console.print(line)
    if stage is None:
        console.print(told_without_method("fits other settings"))
    if cfg.label_filter:
        console.print(f"{report.doubted} answers look wrong and are taken for random")
    for rater, share in report.raters:
        console.print(
            f"{rater}: {share:.0%} of the answers are taken for random"
            + (", and none measures the reward" if share >= HARDLY_LOOKS else "")
        )
    given = f"--reward {command.out} --dataset {command.dataset[0]}"
    of_whom = f" --for {shlex.join(command.whom)}" if command.whom else ""
    console.next(
        f"`gaitpref trust {given}{of_whom}` says how far to believe it, `gaitpref "
        f"train --method style {given} --init POLICY --out NEW` trains on it"
    )


def _label_filter(doubted_below: float) -> LabelFilterCfg | None:
    """
    Raises:
        GaitprefError: that is no probability below one half.
    """
    if not 0.0 <= doubted_below < 0.5:
        raise GaitprefError(
            f"--doubted-below must lie in [0, 0.5), got {doubted_below:g}: from 0.5 on "
            "every answer looks wrong to a reward that has no opinion; try 0.2"
        )
    return LabelFilterCfg(below=doubted_below) if doubted_below else None


def _relabel(command: options.Relabel) -> None:
    # Before the work, and in one line.
    require("pyarrow", "parquet")
    from gaitpref.formats.parquet_rewards import write_rewards

    dataset = Dataset.open(command.dataset)
    model = load_reward(command.reward)
    with writable(command.out.parent), counted("scoring, episodes") as tell:
        steps = write_rewards(command.out, dataset, model, tell)
    episodes = len(dataset.entries())
    if command.json:
        print(json.dumps({"episodes": episodes, "steps": steps}))
        return
    console.print(
        f"the reward of {steps:,} steps of {episodes:,} episodes is in {command.out}"
    )
    console.next(f"pandas.read_parquet({str(command.out)!r}) reads it")
