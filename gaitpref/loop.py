"""The loop: the stages of every round in their order."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

from data.answers.address import Address
from data.datasets.dataset import Dataset
from data.files.lock import only_writer
from policy.env.env_cfg import EnvCfg, getup_env
from policy.training.setup import Setting, setting_of

from .approval import approval_stage, verdict_stage
from .asking import questions_stage
from .extras import require
from .loop_cfg import LoopCfg, RunError
from .opening import address
from .options import Loop
from .people import People
from .presets import resolve
from .progress import console
from .report import PAGE_NAME, write_report
from .retraining import policy_stage
from .rounds import Round, context_of
from .run_config import claim
from .run_inputs import inputs_of
from .side_by_side import show_stage
from .stages import fit_stage, record_stage, report_stage

OpenPage = Callable[[Dataset], AbstractContextManager[People]]
"""Lets people in to the run's data set while the loop runs."""


def no_page(dataset: Dataset) -> AbstractContextManager[People]:
    """Nobody is let in."""
    return nullcontext(People())


def run_loop(options: Loop) -> Path:
    """Run or go on with the loop of `options`; gives the page of its report.

    Raises:
        GaitprefError: an input cannot be used; nothing is written then.
    """
    cfg = resolve(options)
    setting = _setting(cfg)
    ppo = replace(cfg.ppo, hidden_sizes=setting.hidden_sizes)
    env = _lying(setting.env, cfg.base) if options.getup else setting.env
    cfg = replace(cfg, env=env, ppo=ppo)
    human = cfg.rater == "human"
    open_page = partial(page_of_loop, options) if human else no_page
    return run_configured(
        options.run, cfg, open_page=open_page, answers=address(options.answers)
    )


def run_configured(
    run: Path,
    cfg: LoopCfg,
    *,
    open_page: OpenPage = no_page,
    answers: Address | None = None,
) -> Path:
    """Run or go on with the loop of `cfg` in the directory `run`.

    Args:
        run: The run's directory.
        cfg: Everything that decides how the run goes.
        open_page: Lets people in while it runs.
        answers: Where pairs and answers are kept, if not in a file of the run. It is
            no part of the configuration: it may hold a password.
    """
    with only_writer(run, console.print):
        _run(run, cfg, open_page, answers)
    return run / PAGE_NAME


def _run(run: Path, cfg: LoopCfg, open_page: OpenPage, answers: Address | None) -> None:
    inputs = inputs_of(cfg)
    robot, criterion = inputs.robot, inputs.criterion
    claim(run, cfg, inputs.contents)
    dataset = Dataset.create(run / "dataset", answers=answers)
    with open_page(dataset) as people:
        for number in range(cfg.rounds + 1):
            round = Round(run, number)
            round.root.mkdir(parents=True, exist_ok=True)
            context = context_of(cfg, round, dataset)
            policy_stage(cfg, round, context, robot, dataset, people)
            if number < cfg.rounds:
                record_stage(cfg, round, dataset, people)
                show_stage(cfg, round, context, dataset, people)
                questions_stage(cfg, round, context, dataset, criterion, people)
                approval_stage(cfg.method, round, context, dataset)
                fit_stage(cfg, round, context, dataset, people)
            else:
                show_stage(cfg, round, context, dataset, people)
                verdict_stage(cfg, round, context, dataset, criterion, people)
            report_stage(cfg, round, dataset, criterion)
            write_report(run)


@contextmanager
def page_of_loop(options: Loop, dataset: Dataset) -> Iterator[People]:
    """The labeling page of a run, up over all its rounds.

    Raises:
        GaitprefError: it cannot be served, as where the port is busy.
    """
    # A loop without people needs no viser.
    command = require("gaitpref.label_command", "label")
    page = require("gaitpref.loop_page", "label")
    cfg = command.label_cfg(options.page)
    with page.loop_page(dataset.root, cfg) as (notices, opened):
        os.nice(page.NICENESS)
        for line in command.greeting(notices, dataset.root, cfg):
            console.print(line)
        patience = {}
        if options.patience is not None:
            patience = {"patience_s": 60 * options.patience}
        yield People(announce=opened.announce, require_page=opened.require, **patience)


def _lying(env: EnvCfg, base: str) -> EnvCfg:
    """The environment of a loop about getting up.

    Raises:
        RunError: what it goes on with is a policy for something else.
    """
    if env.getup is not None:
        return env
    if base not in ("task", "none"):
        raise RunError(
            f"--getup with --base {base}: that policy was never trained lying; give "
            f"one of `gaitpref train --getup`, or --base none or task"
        )
    return getup_env(env)


def _setting(cfg: LoopCfg) -> Setting:
    base = None if cfg.base in ("task", "none") else Path(cfg.base)
    return setting_of(base, None if cfg.robot is None else Path(cfg.robot))
