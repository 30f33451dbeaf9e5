"""`gaitpref record`: episodes of a policy into a data set."""

from __future__ import annotations

from data.datasets.dataset import Dataset
from data.episodes.chunks import Compression
from data.errors import GaitprefError
from gaitpref.cli.options import options
from gaitpref.cli.shared.by_hand import METHODS, told_without_method
from gaitpref.cli.shared.next_of_answers import next_pairs
from gaitpref.console.progress import console, each_counted
from gaitpref.team.team_sets import require_kind
from gaitpref.training.by_method import recorded_by
from policy.robots.shipped import WALK
from policy.rollouts.record import record
from policy.rollouts.record_cfg import LONGEST_S, RecordCfg
from policy.rollouts.variation import VariationCfg
from policy.training.checkpoint import load_policy


def _record_cfg(command: options.Record) -> RecordCfg:
    """What is recorded, as the command line says it.

    Raises:
        GaitprefError: something is out of range.
    """
    if not 0.0 <= command.varied <= 1.0:
        raise GaitprefError(f"--varied must lie in [0, 1], got {command.varied:g}")
    for name, value in (
        ("--episode-s", command.episode_s),
        ("--change-s", command.change_s),
    ):
        if value is not None and not 0.0 < value <= LONGEST_S:
            raise GaitprefError(
                f"{name} must lie in (0, {LONGEST_S:g}] seconds, got {value:g}"
            )
    cfg = RecordCfg(
        episodes=command.episodes,
        episode_s=command.episode_s,
        change_s=command.change_s,
        variation=VariationCfg(share=command.varied),
    )
    if command.method is None:
        return cfg
    if command.varied:
        raise GaitprefError(
            f"--varied {command.varied:g} with --method {command.method}: the method "
            "says which share is in another posture; leave one of the two out"
        )
    return recorded_by(METHODS[command.method].clips, cfg)


def run(command: options.Record) -> int:
    """Run the command; gives the exit code."""
    policy = command.policy or WALK
    load_policy(policy)
    cfg = _record_cfg(command)
    dataset = Dataset.create(command.dataset)
    require_kind(dataset, team=False)
    recorded = record(policy, cfg, seed=command.seed, round=command.round)
    compression: Compression = "zstd" if command.compression == "zstd" else ""
    with each_counted("recording", recorded, cfg.episodes) as episodes:
        entries = dataset.add_episodes(episodes, compression=compression)
    steps = sum(entry.num_steps for entry in entries)
    console.print(
        f"{len(entries)} episodes with {steps:,} steps are in {command.dataset}"
    )
    if command.method is None:
        console.print(told_without_method("records other postures and rhythms too"))
    console.next(next_pairs(dataset))
    return 0
