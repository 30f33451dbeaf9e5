"""`gaitpref loop`: train, record, ask, fit, retrain, round after round."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from data.datasets.dataset import Dataset
from gaitpref.cli.options import options
from gaitpref.cli.options.options import Loop
from gaitpref.cli.shared.dataset_argument import address
from gaitpref.cli.shared.presets import resolve
from gaitpref.console.extras import require
from gaitpref.console.progress import console
from gaitpref.loop.loop_cfg import LoopCfg, RunError
from gaitpref.loop.people import People
from gaitpref.loop.run import no_page, run_configured
from policy.env.env_cfg import EnvCfg, getup_env
from policy.training.setup import Setting, setting_of


def run(command: options.Loop) -> int:
    """Run the command; gives the exit code."""
    console.print(f"the report is {run_loop(command)}")
    return 0


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


@contextmanager
def page_of_loop(options: Loop, dataset: Dataset) -> Iterator[People]:
    """The labeling page of a run, up over all its rounds.

    Raises:
        GaitprefError: it cannot be served, as where the port is busy.
    """
    # A loop without people needs no viser.
    command = require("gaitpref.cli.commands.label", "label")
    page = require("gaitpref.loop.label_page", "label")
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
