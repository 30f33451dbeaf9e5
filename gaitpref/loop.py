"""The loop: the stages of every round in their order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from data.answer_backend import Address
from data.dataset import Dataset

from .criteria import load_criterion
from .opening import address
from .options import Loop
from .report import PAGE_NAME, write_report
from .rewards import criterion_context
from .run_config import LoopCfg, claim, resolve
from .setting import Setting, setting_of
from .stages import (
    Round,
    answers_stage,
    fit_stage,
    pairs_stage,
    policy_stage,
    record_stage,
    report_stage,
)


def run_loop(options: Loop) -> Path:
    """Run or go on with the loop of `options`; gives the page of its report.

    Raises:
        GaitprefError: an input cannot be used; nothing is written then.
    """
    cfg = resolve(options)
    setting = _setting(cfg)
    ppo = replace(cfg.ppo, hidden_sizes=setting.hidden_sizes)
    cfg = replace(cfg, env=setting.env, ppo=ppo)
    return run_configured(options.run, cfg, answers=address(options.answers))


def run_configured(run: Path, cfg: LoopCfg, *, answers: Address | None = None) -> Path:
    """Run or go on with the loop of `cfg` in the directory `run`.

    Args:
        run: The run's directory.
        cfg: Everything that decides how the run goes.
        answers: Where pairs and answers are kept, if not in a file of the run. It is
            no part of the configuration: it may hold a password.
    """
    robot = _setting(cfg).robot
    criterion = load_criterion(cfg.criterion, criterion_context(robot, cfg.env))
    claim(run, cfg)
    dataset = Dataset.create(run / "dataset", answers=answers)
    for number in range(cfg.rounds + 1):
        round = Round(run, number)
        round.root.mkdir(parents=True, exist_ok=True)
        policy_stage(cfg, round, robot)
        if number < cfg.rounds:
            record_stage(cfg, round, dataset)
            pairs_stage(cfg, round, dataset)
            answers_stage(cfg, round, dataset, criterion)
            fit_stage(cfg, round, dataset)
        report_stage(cfg, round, criterion)
        write_report(run)
    return run / PAGE_NAME


def _setting(cfg: LoopCfg) -> Setting:
    base = None if cfg.base in ("task", "none") else Path(cfg.base)
    return setting_of(base, None if cfg.robot is None else Path(cfg.robot))
