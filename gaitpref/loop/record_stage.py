"""Episodes of the round's policy, and of what its training makes on the way, into the
data set."""

from __future__ import annotations

import json
from dataclasses import replace

from data.datasets.dataset import Dataset
from data.files.files import read_json, write_atomically
from gaitpref.console.progress import each_counted
from gaitpref.training.by_method import recorded_by
from policy.rollouts.record import record
from policy.training.checkpoint import PolicyError, load_policy
from policy.training.training_dir import CHECKPOINTS_NAME

from .loop_cfg import LoopCfg
from .people import People
from .policy_stage import partial_of
from .run_dir import Round, place_of, seed_of

_EPISODES_ON_THE_WAY = 10
"""Two of every command that is recorded."""


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


def record_on_the_way(cfg: LoopCfg, round: Round, dataset: Dataset) -> None:
    """Log a few episodes of the newest checkpoint of the training that goes on, where
    that was not done.

    Every second checkpoint is left out, and one thread is used, for about a second:
    the training goes on beside it.
    """
    done = _checkpoints_recorded(round)
    files = sorted((partial_of(round) / CHECKPOINTS_NAME).glob("step_*.pt"))[1::2]
    if not files or files[-1].name in done:
        return
    try:
        policy = load_policy(files[-1])
    except PolicyError:
        if files[-1].exists():
            raise
        # The training has ended, and its directory another name.
        return
    few = replace(cfg.record, episodes=_EPISODES_ON_THE_WAY)
    entries = dataset.add_episodes(
        record(
            files[-1],
            replace(recorded_by(cfg.method.clips, few), babble_share=0.0),
            seed=seed_of(cfg, round.number, 14, policy.info.steps),
            round=round.number,
            policies=[policy],
            threads=1,
        )
    )
    done[files[-1].name] = sorted(entry.sha256 for entry in entries)
    write_atomically(round.on_the_way, json.dumps(done, indent=0).encode())


def recorded_on_the_way(round: Round) -> list[str]:
    """The episodes of checkpoints of the round's training, by their SHA-256."""
    each = _checkpoints_recorded(round).values()
    return [name for names in each for name in names]


def _checkpoints_recorded(round: Round) -> dict[str, list[str]]:
    return read_json(round.on_the_way) if round.on_the_way.exists() else {}
