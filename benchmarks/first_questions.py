"""What the first answers from scratch teach: is a walk worth more than standing still?

    python -m benchmarks.first_questions [--labels 40] [--mistakes 0.2] [--ways WAY ...]

A run from scratch walks or stands by whether its first reward prefers the walk of a PPO
policy over holding the home pose. This asks the questions of the first round alone, in
seconds instead of the minutes of a whole run, and gives the lead of the walk in
deviations of the reward, for several ways to ask.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

import torch
import tyro
from torch import Tensor

from data.dataset import Dataset
from gaitpref.asking import questions_stage
from gaitpref.criteria import load_criterion
from gaitpref.loop_cfg import LoopCfg
from gaitpref.options import Loop
from gaitpref.people import People
from gaitpref.presets import resolve
from gaitpref.rater_cfg import RaterCfg
from gaitpref.retraining import policy_stage
from gaitpref.rewards import criterion_context, total_reward
from gaitpref.rounds import Round
from gaitpref.stages import fit_stage, record_stage
from policy.checkpoint import Policy, load_policy
from policy.evaluate import evaluate_actor
from policy.extensions.exploration import ExplorationBonusCfg
from policy.robot import Robot
from policy.rollout import hold_home
from policy.train import TrainCfg, train
from rewardmodel.cfg import LinearCfg
from rewardmodel.storage import load_reward

from .harness import Figure, gaitpref, median, publish

Way = Literal[
    "as_it_is",
    "half_the_episodes",
    "uniform_questions",
    "one_batch",
    "evaluated_speeds",
    "shaking",
    "nothing_expected",
    "five_members",
    "never_asks_on",
    "half_of_few",
    "explores_first",
]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure what the first questions teach."""

    work: Path = Path("runs/benchmark-learning")
    """Where `benchmarks.learning` keeps its policy on the task; trained if missing."""
    seeds: int = 6
    """Seeds of every way to ask."""
    ways: tuple[Way, ...] = ()
    """Only these, as `as_it_is` and `nothing_expected`; by default all."""
    labels: int = 100
    """Answers of the whole run, of which the first round gets its share."""
    mistakes: float = 0.0
    """Share of the answers that are turned round."""
    quick: bool = False
    """One seed, few episodes, and a policy that hardly moves."""
    json: Path | None = None
    """Write the figures here."""


def ways(cfg: LoopCfg, *, quick: bool) -> Mapping[Way, LoopCfg]:
    """The first round as it is, and with one thing changed."""
    record = cfg.record

    def fitted(linear: LinearCfg) -> LoopCfg:
        return replace(cfg, fit=replace(cfg.fit, linear=linear))

    return {
        "as_it_is": cfg,
        "half_the_episodes": replace(
            cfg, record=replace(record, episodes=record.episodes // 2)
        ),
        "uniform_questions": replace(cfg, uniform_share=1.0),
        "one_batch": replace(cfg, batch_labels=cfg.labels, most_first_share=None),
        "evaluated_speeds": replace(
            cfg, record=replace(record, babble_m_s=cfg.env.commands.evaluated_m_s)
        ),
        "shaking": replace(cfg, record=replace(record, babble_share=0.0)),
        "nothing_expected": fitted(LinearCfg(unsteady_logit=0.0)),
        "five_members": fitted(LinearCfg(num_members=5)),
        "never_asks_on": replace(cfg, most_first_share=None),
        "half_of_few": replace(cfg, first_least=0),
        "explores_first": replace(cfg, base_steps=3_000 if quick else 300_000),
    }


def explore(out: Path, cfg: LoopCfg, robot: Robot) -> None:
    """Train a policy on new motion and the safety terms alone, before any question."""

    def nothing(features: Tensor, starts: Tensor) -> Tensor:
        return features.new_zeros(starts.shape)

    train(
        out,
        robot,
        TrainCfg(
            steps=cfg.base_steps,
            env=cfg.env,
            ppo=replace(cfg.ppo, bonus=ExplorationBonusCfg(kind="entropy")),
            seed=cfg.seed,
        ),
        reward_fn=total_reward(nothing, robot, cfg.env, known=cfg.known),
    )


def lead_of_walk(run: Path, cfg: LoopCfg, walk: Policy) -> float:
    """Mean reward per second of the walk less that of standing, after one round."""
    robot, people = walk.robot(), People()
    dataset, first = Dataset.create(run / "dataset"), Round(run, 0)
    first.root.mkdir(parents=True)
    criterion = load_criterion(cfg.criterion, criterion_context(robot, cfg.env))
    if cfg.base_steps:
        explore(first.policy.parent, cfg, robot)
    policy_stage(cfg, first, robot, dataset, people)
    record_stage(cfg, first, dataset, people)
    questions_stage(cfg, first, dataset, criterion, people)
    fit_stage(cfg, first, dataset, people)
    reward, env = load_reward(first.reward), walk.info.env
    walking, standing = (
        evaluate_actor(actor, robot, env, reward) for actor in (walk, hold_home)
    )
    return walking.score_mean - standing.score_mean


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure every way to ask and publish it."""
    torch.set_num_threads(1)
    out = options.work / "task"
    if not (out / "policy.pt").exists():
        steps = "6144" if options.quick else "1500000"
        gaitpref("train", "--out", out, "--reward", "task", "--steps", steps)
    walk = load_policy(out / "policy.pt")
    cfg = resolve(
        Loop(
            run=Path("unused"),
            labels=options.labels,
            base="none",
            criterion="task",
            preset="quick",
        )
    )
    cfg = replace(cfg, simulated=RaterCfg(mistakes=options.mistakes))
    if options.quick:
        cfg = replace(cfg, record=replace(cfg.record, episodes=40, episode_s=2.0))
    figures: dict[str, Figure] = {
        "answers": cfg.labels_of(0),
        "most_answers": cfg.most_first_labels,
    }
    tried = ways(cfg, quick=options.quick)
    for name in options.ways or tried:
        way = tried[name]
        leads: list[float] = []
        for seed in range(1 if options.quick else options.seeds):
            with TemporaryDirectory() as run:
                leads.append(lead_of_walk(Path(run), replace(way, seed=seed), walk))
        figures |= {f"{name}_median": median(leads), f"{name}_worst": min(leads)}
    publish("first questions", figures, {}, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
