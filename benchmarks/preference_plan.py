"""What the benchmark of preferences runs: tasks, raters, methods, budgets, seeds.

Fixed before anything is tuned on it; docs/benchmarks.md says how it is read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from gaitpref.loop_cfg import LoopCfg
from gaitpref.options import Loop
from gaitpref.presets import resolve
from gaitpref.rater_cfg import RaterCfg
from policy.config import getup_env
from policy.ppo import PpoCfg
from policy.record import RecordCfg
from policy.variation import VariationCfg
from rewardmodel.cfg import FitCfg

TASKS = {
    "walk": "task",
    "high_step": "high_step",
    "crouch": "crouch",
    "low_energy": "low_energy",
    "smooth": "smooth",
    "trot": "trot@3.0",
    "carried_foot": "benchmarks.wishes:carried_right_foot",
    "nose_up": "benchmarks.wishes:nose_up_when_slow",
    "pace": "pace",
    "get_up": "task",
    "lean": "benchmarks.strangers:lean",
    "bound": "benchmarks.strangers:bound",
    "front_feet": "benchmarks.strangers:front_feet_high",
    "published_walk": "benchmarks.strangers:published_walk",
    "brisk_walk": "benchmarks.strangers:brisk_walk",
}
"""The hidden criterion of each task."""
FROM_SCRATCH = ("walk", "get_up", "published_walk", "brisk_walk")
"""Tasks without a task reward; `get_up` starts lying. The others are styles on top of a
walking base."""
HELD_BACK = ("pace",)
"""Tasks nobody looks at until everything is chosen; run where they are named."""
RATERS = {
    "perfect": RaterCfg(),
    "mistakes20": RaterCfg(mistakes=0.2),
    "stochastic30": RaterCfg(beta=1.0),
    "mistakes40": RaterCfg(mistakes=0.4),
}
METHODS: dict[str, Callable[[LoopCfg], LoopCfg]] = {
    "default": lambda cfg: cfg,
    "uniform": lambda cfg: replace(cfg, uniform_share=1.0),
    **{
        name: lambda cfg, name=name: replace(cfg, strategy=name)
        for name in ("entropy", "bald", "kcenter", "medoids", "dpp")
    },
    **{
        name: lambda cfg, name=name: replace(cfg, fit=replace(cfg.fit, kind=name))
        for name in ("linear", "sparse", "gp", "mlp", "auto")
    },
    "no-hurry": lambda cfg: replace(cfg, hurry=0.0),
    "not-beyond": lambda cfg: replace(cfg, beyond=0.0),
    "no-mirror": lambda cfg: replace(cfg, mirror=False),
    "no-caution": lambda cfg: replace(cfg, caution=0.0),
    "unjudged": lambda cfg: replace(cfg, approval_labels=0, last_labels=0),
    "from-last": lambda cfg: replace(cfg, from_best=False),
    "no-limit": lambda cfg: replace(cfg, tracking_slack_m_s=None),
    "no-posture": lambda cfg: replace(
        cfg, record=replace(cfg.record, variation=VariationCfg())
    ),
    "no-calm": lambda cfg: replace(cfg, calm_from=0.999),
    "no-hope": lambda cfg: replace(cfg, optimism=0.0),
    "no-rhythms": lambda cfg: replace(
        cfg, record=replace(cfg.record, babble_share=0.0)
    ),
    "no-earlier": lambda cfg: replace(cfg, earlier_share=0.0),
    "no-front": lambda cfg: replace(cfg, first_share=None, most_first_share=None),
    "keep-noise": lambda cfg: replace(cfg, exploration=None),
    "not-steady": lambda cfg: replace(
        cfg, fit=replace(cfg.fit, linear=replace(cfg.fit.linear, unsteady_logit=0.0))
    ),
    "not-told": lambda cfg: replace(
        cfg, fit=replace(cfg.fit, linear=replace(cfg.fit.linear, told_most=False))
    ),
    "lean": lambda cfg: replace(
        cfg,
        hurry=0.0,
        quiet_logit=0.0,
        sure=0.0,
        fit=replace(cfg.fit, kind="linear"),
    ),
    "weight-1": lambda cfg: replace(cfg, learned_weight=1.0),
    "weight-2": lambda cfg: replace(cfg, learned_weight=2.0),
    "weight-4": lambda cfg: replace(cfg, learned_weight=4.0),
    "plain-linear": lambda cfg: replace(
        cfg,
        fit=FitCfg(kind="linear", error_share=0.0, tie_threshold=0.0, adapt=False),
    ),
}
"""What is changed of the loop's configuration."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One row of the benchmark: one seed of one method on one task."""

    task: str
    answers: int
    rater: str
    method: str
    seed: int
    robot: str | None = None
    """Name of the robot; None is the one that ships."""

    @property
    def name(self) -> str:
        """Of its files; tells all that decides its outcome."""
        what = f"{self.task}-{self.answers}-{self.rater}-{self.method}"
        return f"{self.of_robot(what)}-seed{self.seed}"

    def of_robot(self, name: str) -> str:
        """`name` for what another robot does not share."""
        return name if self.robot is None else f"{name}-{self.robot}"

    @property
    def from_scratch(self) -> bool:
        """Whether no task reward is kept."""
        return self.task in FROM_SCRATCH


_BUDGETS = (
    ("walk", 100, "perfect", 5),
    ("walk", 40, "perfect", 5),
    ("walk", 100, "mistakes20", 3),
    ("walk", 150, "stochastic30", 3),
    ("walk", 200, "mistakes40", 3),
    *((task, 60, "perfect", 3) for task in ("high_step", "crouch", "low_energy")),
    *((task, 60, "perfect", 3) for task in ("smooth", "trot", "pace")),
    *((task, 150, "perfect", 3) for task in ("carried_foot", "nose_up")),
    ("get_up", 100, "perfect", 3),
    *((task, 60, "perfect", 3) for task in ("lean", "bound", "front_feet")),
    *((task, 100, "perfect", 3) for task in ("published_walk", "brisk_walk")),
)
"""Task, answers, rater and number of seeds."""


def plan(
    *,
    tasks: tuple[str, ...] = (),
    methods: tuple[str, ...] = (),
    raters: tuple[str, ...] = (),
    answers: tuple[int, ...] = (),
    robot: str | None = None,
    seeds: int | None,
) -> list[Cell]:
    """The cells to run: first seeds first, so that every row soon has a figure.

    Args:
        tasks: Only these; by default all that are not held back.
        methods: Only these; by default `default`.
        raters: Only these; by default all.
        answers: Only rows with so many; by default all.
        robot: Name of another robot than the one that ships.
        seeds: At most so many of every row.
    """
    chosen = tasks or tuple(task for task in TASKS if task not in HELD_BACK)
    cells = [
        Cell(
            task=task,
            answers=labels,
            rater=rater,
            method=method,
            seed=seed,
            robot=robot,
        )
        for task, labels, rater, count in _BUDGETS
        if task in chosen
        and rater in (raters or RATERS)
        and (not answers or labels in answers)
        for method in methods or ("default",)
        for seed in range(count if seeds is None else min(count, seeds))
    ]
    return sorted(cells, key=lambda cell: cell.seed)


def loop_cfg(
    cell: Cell, base: Path | None, *, robot: Path | None = None, quick: bool
) -> LoopCfg:
    """The loop of a cell.

    Args:
        cell: Which.
        base: Walking policy of the style tasks, which knows its robot.
        robot: MJCF of another robot than the one that ships, where there is no base.
        quick: Thousands of steps instead of millions; the figures mean nothing.
    """
    options = Loop(
        run=Path("unused"),
        labels=cell.answers,
        criterion=TASKS[cell.task],
        base="none" if cell.from_scratch else str(base),
        robot=robot if base is None else None,
        preset="quick",
        seed=cell.seed,
    )
    cfg = replace(resolve(options), simulated=RATERS[cell.rater])
    if cell.task == "get_up":
        cfg = replace(cfg, env=getup_env(cfg.env))
    cfg = METHODS[cell.method](cfg)
    return tiny(cfg) if quick else cfg


def tiny(cfg: LoopCfg) -> LoopCfg:
    """The same loop with one round and next to no training."""
    return replace(
        cfg,
        rounds=1,
        labels=12,
        base_steps=1536,
        last_round_steps=1536,
        evaluation_episodes=8,
        ppo=PpoCfg(num_envs=32, hidden_sizes=(16,)),
        record=RecordCfg(episodes=40, episode_s=2.0),
    )


def steps_of(cfg: LoopCfg) -> int:
    """Environment steps a loop trains for, without its base."""
    return (cfg.rounds - 1) * cfg.round_steps + cfg.last_round_steps
