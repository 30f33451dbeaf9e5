"""What each command does, with everything it needs imported."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

from data.datasets.dataset import Dataset
from data.datasets.gone import pairs_gone
from data.episodes.chunks import Compression
from data.errors import DatasetError, GaitprefError
from policy.env.env_cfg import EnvCfg
from policy.env.task_reward import task_reward_for
from policy.robots.robot import load_robot_xml
from policy.rollouts.evaluate import evaluate
from policy.rollouts.record import LONGEST_S, RecordCfg, record
from policy.rollouts.variation import VariationCfg
from policy.training.checkpoint import load_policy

from . import options
from .by_hand import METHODS, told_without_method
from .by_method import recorded_by
from .criteria import CriterionContext, load_criterion
from .loop import run_loop
from .opening import open_dataset
from .progress import console, counting_bar
from .rater import answer_pairs
from .rater_cfg import rater_cfg
from .report import write_report
from .rewards import criterion_context, load_score


def run(command: options.Command) -> int:
    """Run the command; gives the exit code."""
    match command:
        case options.Loop():
            page = run_loop(command)
            console.print(f"the report is {page}")
        case options.Record():
            _record(command)
        case options.Answer():
            _answer(command)
        case options.Evaluate():
            _evaluate(command)
        case options.Report():
            console.print(f"the report is {write_report(command.run)}")
        case _:
            raise TypeError(f"{type(command).__name__} is run by another module")
    return 0


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


def _record(command: options.Record) -> None:
    load_policy(command.policy)
    cfg = _record_cfg(command)
    dataset = Dataset.create(command.dataset)
    with counting_bar("recording", cfg.episodes) as bar:

        def counted():
            for episode in record(
                command.policy, cfg, seed=command.seed, round=command.round
            ):
                bar.advance(bar.task_ids[0])
                yield episode

        compression: Compression = "zstd" if command.compression == "zstd" else ""
        entries = dataset.add_episodes(counted(), compression=compression)
    steps = sum(entry.num_steps for entry in entries)
    console.print(
        f"{len(entries)} episodes with {steps:,} steps are in {command.dataset}"
    )
    if command.method is None:
        console.print(told_without_method("records other postures and rhythms too"))


def _answer(command: options.Answer) -> None:
    dataset = open_dataset(command)
    cfg = rater_cfg(command)
    criterion = load_criterion(command.criterion, _context_of(dataset))
    rater = f"simulated:{command.criterion}"
    count = answer_pairs(dataset, criterion, rater_id=rater, seed=command.seed, cfg=cfg)
    console.print(
        f"{count} pairs of {command.dataset} were answered by {command.criterion}"
    )
    if gone := pairs_gone(dataset):
        console.print(gone)


def _context_of(dataset: Dataset) -> CriterionContext:
    """The figures of the robot in the data set, out of its first episode."""
    entries = dataset.entries()
    if not entries:
        raise DatasetError(
            f"{dataset.root} holds no episode: `gaitpref record --policy POLICY "
            f"--dataset {dataset.root}` adds some"
        )
    episode = dataset.read(entries[0].sha256)
    meta = episode.meta
    robot = load_robot_xml(
        episode.mjcf, name=meta.robot, physics_dt_s=meta.physics_dt_s
    )
    return CriterionContext(
        task=task_reward_for(robot, EnvCfg().task), control_dt_s=meta.control_dt_s
    )


def _evaluate(command: options.Evaluate) -> None:
    policy = load_policy(command.policy)
    robot, env = policy.robot(), policy.info.env
    if command.terrain is not None:
        env = replace(env, terrain=replace(env.terrain, kind=command.terrain))
    score = load_score(command.reward, criterion_context(robot, env))
    result = evaluate(
        policy, score, episodes=command.episodes, seed=command.seed, env=env
    )
    if command.json:
        print(json.dumps(asdict(result)))
        return
    print(
        f"return          {result.return_mean:.2f} ± {result.return_ci95:.2f} "
        f"under {command.reward}"
    )
    print(f"tracking error  {result.tracking_error_m_s:.3f} m/s")
    print(f"falls           {result.falls} ({result.falls_per_minute:.2f} a minute)")
    print(
        f"episode         {result.episode_length_s:.1f} s, {result.episodes} episodes"
    )
    print(f"power           {result.power_w:.0f} W")
