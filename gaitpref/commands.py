"""What each command does, with everything it needs imported."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, replace

from data.dataset import Dataset
from data.episode_chunks import Compression
from data.errors import DatasetError, GaitprefError
from data.gone import pairs_gone
from data.lock import only_writer
from policy.checkpoint import PolicyError, load_policy
from policy.config import RANDOMISE, EnvCfg, getup_env
from policy.curriculum import CurriculumCfg
from policy.evaluate import evaluate
from policy.extensions.exploration import ExplorationBonusCfg
from policy.extensions.kl_penalty import KlPenaltyCfg
from policy.known_terms import KnownTermsCfg
from policy.ppo import PpoCfg
from policy.record import LONGEST_S, RecordCfg, record
from policy.reward import task_reward_for
from policy.robot import load_robot_xml
from policy.train import POLICY_NAME, RESUME_NAME, TrainCfg, train
from policy.variation import VariationCfg

from . import options
from .criteria import CriterionContext, load_criterion
from .loop import run_loop
from .opening import open_dataset
from .progress import console, counting_bar, training_bar
from .rater import answer_pairs
from .rater_cfg import rater_cfg
from .report import write_report
from .rewards import criterion_context, load_score, total_reward
from .setting import setting_of
from .terminal import EXIT_INTERRUPTED


def run(command: options.Command) -> int:
    """Run the command; gives the exit code."""
    match command:
        case options.Loop():
            page = run_loop(command)
            console.print(f"the report is {page}")
        case options.Train():
            return _train(command)
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


def _train(command: options.Train) -> int:
    with only_writer(command.out, console.print):
        return _train_alone(command)


def _train_alone(command: options.Train) -> int:
    names = (POLICY_NAME, RESUME_NAME)
    if not command.resume and any((command.out / name).exists() for name in names):
        raise PolicyError(
            f"{command.out} holds a training run: --resume goes on with it, or give "
            f"another --out"
        )
    setting = setting_of(command.init, command.robot)
    robot = setting.robot
    env = replace(
        setting.env,
        randomise=RANDOMISE[command.randomize],
        terrain=replace(setting.env.terrain, kind=command.terrain),
        curriculum=CurriculumCfg() if command.curriculum else None,
    )
    if command.getup:
        env = getup_env(env)
    reward_fn = None
    if command.reward != "task":
        score = load_score(command.reward, criterion_context(robot, env))
        reward_fn = total_reward(
            score, robot, env, known=KnownTermsCfg(), keep_task=command.keep_task
        )
    cfg = TrainCfg(
        steps=command.steps,
        env=env,
        ppo=PpoCfg(
            num_envs=command.envs,
            hidden_sizes=setting.hidden_sizes,
            bonus=(
                None
                if command.exploration == "none"
                else ExplorationBonusCfg(kind=command.exploration)
            ),
            kl_penalty=(
                None
                if command.kl_penalty == "none"
                else KlPenaltyCfg(kind=command.kl_penalty)
            ),
            mirror=command.mirror,
            privileged_critic=command.randomize != "off",
        ),
        seed=command.seed,
        checkpoints=command.checkpoints,
    )
    with training_bar("training", command.steps) as bar:
        result = train(
            command.out,
            robot,
            cfg,
            reward_fn=reward_fn,
            reward_name=command.reward + (" and task" if command.keep_task else ""),
            init=command.init,
            resume=command.resume,
            on_iteration=bar,
        )
    if not result.finished:
        print(
            f"gaitpref: stopped after {result.steps:,} steps; the same command with "
            f"--resume goes on",
            file=sys.stderr,
        )
        return EXIT_INTERRUPTED
    console.print(f"the policy is {result.policy}")
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
    return RecordCfg(
        episodes=command.episodes,
        episode_s=command.episode_s,
        change_s=command.change_s,
        variation=VariationCfg(share=command.varied),
    )


def _record(command: options.Record) -> None:
    load_policy(command.policy)
    cfg = _record_cfg(command)
    dataset = Dataset.create(command.dataset)
    with counting_bar("recording", cfg.episodes) as bar:

        def counted():
            for episode in record(command.policy, cfg, seed=command.seed):
                bar.advance(bar.task_ids[0])
                yield episode

        compression: Compression = "zstd" if command.compression == "zstd" else ""
        entries = dataset.add_episodes(counted(), compression=compression)
    steps = sum(entry.num_steps for entry in entries)
    console.print(
        f"{len(entries)} episodes with {steps:,} steps are in {command.dataset}"
    )


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
