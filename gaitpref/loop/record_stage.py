"""Episodes of the round's policy, into the data set."""

from __future__ import annotations

import json

from data.datasets.dataset import Dataset
from data.files.files import write_atomically
from gaitpref.console.progress import each_counted
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
    recorded = record(
        round.policy,
        recorded_by(cfg.method.clips, cfg.record),
        seed=seed,
        round=round.number,
    )
    title = f"round {round.number}: recording"
    with each_counted(title, recorded, cfg.record.episodes) as episodes:
        entries = dataset.add_episodes(episodes)
    names = sorted(entry.sha256 for entry in entries)
    write_atomically(round.recorded, json.dumps(names, indent=0).encode())
