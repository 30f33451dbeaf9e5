"""A loop of a few thousand steps: `python -m tests.helpers.small_loop RUN`.

With `--port P` people answer it on the labeling page, `--patience S` seconds a round.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import pytest
import torch
import tyro

from gaitpref.cli.commands.loop import page_of_loop
from gaitpref.cli.options.options import Loop, Serving
from gaitpref.cli.shared.launched import ranks_of_launch
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.loop import run as loop
from gaitpref.loop.loop_cfg import LoopCfg, StepsCfg
from gaitpref.loop.run import run_loop
from gaitpref.loop.run_dir import Round
from gaitpref.method.meanwhile import Meanwhile
from policy.rollouts.record_cfg import RecordCfg
from policy.training.ppo import PpoCfg
from tests.helpers.curves_of_reports import blank


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run or go on with the small loop."""

    run: tyro.conf.Positional[Path]
    port: int | None = None
    patience: Annotated[float | None, tyro.conf.arg(metavar="S")] = None


def small_cfg(*, seed: int = 0, base: str = "none") -> LoopCfg:
    """Two rounds, 24 answers, networks of 16 units, episodes of two seconds."""
    options = Loop(
        run=Path("unused"), criterion="task", rounds=2, labels=24, base=base, seed=seed
    )
    cfg = resolve(options)
    return replace(
        cfg,
        env=replace(cfg.env, episode_s=2.0),
        steps=StepsCfg(base=1536, round=1536, last=3072),
        evaluation_episodes=8,
        ppo=PpoCfg(num_envs=32, hidden_sizes=(16,)),
        record=RecordCfg(episodes=40, episode_s=2.0),
    )


def human_cfg() -> LoopCfg:
    """The same with people; long enough that they can answer while it trains."""
    cfg = small_cfg()
    return replace(
        cfg,
        rater="human",
        method=replace(cfg.method, meanwhile=Meanwhile()),
        steps=replace(cfg.steps, round=60_000),
    )


class Killed(Exception):
    """What ends a loop where it is, as a kill does."""


def stopped(stage: str, number: int, run: Path, cfg: LoopCfg) -> None:
    """Run a loop until a stage of a round would begin."""
    begun = getattr(loop, stage)

    def killed(cfg: LoopCfg, round: Round, *others: object) -> object:
        if round.number == number:
            raise Killed
        return begun(cfg, round, *others)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, stage, killed)
        with pytest.raises(Killed):
            run_loop(run, cfg)


def main(options: Options) -> None:
    """Run or go on with the small loop in the directory `run`."""
    torch.set_num_threads(1)
    if options.port is None:
        with ranks_of_launch() as ranks:
            run_loop(options.run, small_cfg(), ranks=ranks)
        return
    patience = None if options.patience is None else options.patience / 60
    asked = Loop(run=options.run, patience=patience, page=Serving(port=options.port))
    run_loop(options.run, human_cfg(), open_page=partial(page_of_loop, asked))


if __name__ == "__main__":
    with blank():
        main(tyro.cli(Options))
    os._exit(0)
