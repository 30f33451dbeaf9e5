"""Episodes of the round's policy, into the data set."""

from __future__ import annotations

import json
from typing import Any

from data.datasets.dataset import Dataset
from data.files.files import write_atomically
from gaitpref.console.progress import counting_bar
from gaitpref.training.by_method import recorded_by
from policy.rollouts.record import record

from .loop_cfg import LoopCfg
from .people import People
from .run_dir import Round, place_of, seed_of


def record_stage(cfg: LoopCfg, round: Round, dataset: Dataset, people: People) -> None:
    """Log episodes of the round's policy and its checkpoints to the data set."""
    if round.recorded.exists():
        return
    seed = seed_of(cfg, round.number, 2)
    people.tell(f"{place_of(cfg, round)}: recording what the new policy does")
    with counting_bar(f"round {round.number}: recording", cfg.record.episodes) as bar:

        def counted() -> Any:
            for episode in record(
                round.policy,
                recorded_by(cfg.method.clips, cfg.record),
                seed=seed,
                round=round.number,
            ):
                bar.advance(bar.task_ids[0])
                yield episode

        entries = dataset.add_episodes(counted())
    names = sorted(entry.sha256 for entry in entries)
    write_atomically(round.recorded, json.dumps(names, indent=0).encode())
