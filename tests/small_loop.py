"""A loop of a few thousand steps, as a process: `python -m tests.small_loop RUN`."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import torch

from gaitpref.loop import run_configured
from gaitpref.options import Loop
from gaitpref.run_config import LoopCfg, resolve
from policy.ppo import PpoCfg
from policy.record import RecordCfg


def small_cfg(*, seed: int = 0, base: str = "none") -> LoopCfg:
    """Two rounds, 24 answers, networks of 16 units."""
    options = Loop(
        run=Path("unused"), criterion="task", rounds=2, labels=24, base=base, seed=seed
    )
    return replace(
        resolve(options),
        base_steps=1536,
        round_steps=1536,
        last_round_steps=3072,
        evaluation_episodes=8,
        ppo=PpoCfg(num_envs=32, hidden_sizes=(16,)),
        record=RecordCfg(episodes=40, episode_s=2.0),
    )


def main(run: Path) -> None:
    """Run or go on with the small loop in the directory `run`."""
    torch.set_num_threads(1)
    run_configured(run, small_cfg())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
    os._exit(0)
