"""What the benchmark of preferences runs: tasks, raters, methods, budgets, seeds.

Fixed before anything is tuned on it; docs/benchmarks.md says how it is read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from data.answers.answer_records import Aspect
from gaitpref.loop.loop_cfg import LoopCfg, StepsCfg
from gaitpref.loop.presets import loop_cfg
from gaitpref.method.budget import FrontLoaded
from gaitpref.method.exploration import PutBack
from gaitpref.method.method import STYLE, Method
from gaitpref.method.paid import AsFitted, SurelyLiked
from gaitpref.method.questions import Questions
from gaitpref.raters.rater_cfg import RaterCfg
from policy.env.env_cfg import getup_env
from policy.rollouts.record_cfg import RecordCfg
from rewardmodel.cfg import FitCfg, PosteriorCfg
from rewardmodel.extensions_cfg import LabelFilterCfg, RawCfg, SemiSupervisedCfg

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
ABOUT: dict[str, Aspect] = {
    "high_step": "feet",
    "crouch": "posture",
    "low_energy": "effort",
    "smooth": "steadiness",
    "trot": "rhythm",
    "carried_foot": "feet",
    "nose_up": "posture",
    "pace": "rhythm",
    "lean": "posture",
    "bound": "rhythm",
    "front_feet": "feet",
}
"""What a rater who names a reason names in four of five answers about a style."""
RATERS = {
    "perfect": RaterCfg(),
    "mistakes20": RaterCfg(mistakes=0.2),
    "stochastic30": RaterCfg(beta=1.0),
    "mistakes40": RaterCfg(mistakes=0.4),
    "why80": RaterCfg(why="posture"),
    "mistakes20why80": RaterCfg(mistakes=0.2, why="posture"),
}
Change = Callable[[Method], Method]
"""What is changed of a method."""
PEERS: dict[str, dict[str, Any]] = {
    "prefppo": {},
    "surf": {
        "semi_supervised": SemiSupervisedCfg(
            confidence=0.99, error_share=0.0, pairs_per_answer=4
        )
    },
    "rime": {"label_filter": LabelFilterCfg()},
}
"""What others' methods have beside networks on raw rows."""
_CROPS = {"surf": 0.75}
_RATES = {"": 1.0, "-rate-third": 1 / 3, "-rate-triple": 3.0}
"""Times the published learning rate, for a fair search."""

METHODS: dict[str, Change] = {
    "default": lambda method: method,
    "disagreeing": lambda method: replace(method, questions=Questions()),
    "uniform": lambda method: _asking(method, uniform_share=1.0),
    **{
        name: lambda method, name=name: _asking(method, strategy=name)
        for name in ("entropy", "bald", "kcenter", "medoids", "dpp")
    },
    **{
        name: lambda method, name=name: replace(
            method,
            reward=replace(method.reward, kind=name),
            paid=AsFitted(),
        )
        for name in ("linear", "posterior", "gp", "mlp", "auto")
    },
    "posterior-walk": lambda method: replace(
        method,
        reward=replace(STYLE.reward, posterior=PosteriorCfg()),
        questions=STYLE.questions,
        paid=AsFitted(),
        unstick=None,
    ),
    "plain-linear": lambda method: replace(
        method,
        reward=FitCfg(kind="linear", error_share=0.0, tie_threshold=0.0, adapt=False),
        paid=AsFitted(),
    ),
    "not-sure": lambda method: replace(method, paid=SurelyLiked(sure=0.0)),
    "no-caution": lambda method: replace(method, paid=SurelyLiked(caution=0.0)),
    "not-steady": lambda method: _expecting(method, unsteady_logit=0.0),
    "not-told": lambda method: _expecting(method, told_most=False),
    "no-calm": lambda method: replace(method, exploration=PutBack(calm_from=0.999)),
    "keep-noise": lambda method: replace(method, exploration=None),
    "no-limit": lambda method: replace(method, tracking=None),
    "no-mirror": lambda method: replace(method, mirror=False),
    "no-hope": lambda method: replace(method, unstick=None),
    "unjudged": lambda method: replace(method, accept=None),
    "no-posture": lambda method: _showing(method, posture_share=0.0),
    "no-rhythms": lambda method: _showing(method, rhythm_share=0.0),
    "half-noisy": lambda method: _showing(method, noisy_share=0.5),
    "no-earlier": lambda method: _showing(method, earlier_share=0.0),
    "even": lambda method: _asked_evenly(method),
    "trusting": lambda method: _fitting(method, adapt=False),
    "weight-1": lambda method: replace(method, weight=1.0),
    # Others' methods on the same walks, clips, steps and answers: B-Pref (arXiv
    # 2111.03026), SURF (2203.10050), and answers filtered after RIME (2402.17257).
    # Networks, likelihood and the opinions of SURF are as they publish them. Not theirs
    # are the share of the answers asked for first (a quarter, which has no source) and
    # the first walk: what B-Pref trains without any answer is left out. Of RIME it is
    # the idea alone: answers that rewards of other folds give less than 0.2 count as
    # random; none is turned round, no divergence has a threshold that falls, and no
    # reward begins where another ended.
    **{
        f"{name}{rate}": lambda method, name=name, times=times: _as_published(
            method,
            models=(_raw(times, _CROPS.get(name, 1.0)),),
            **PEERS[name],
        )
        for name in PEERS
        for rate, times in _RATES.items()
    },
    # The network of this project with its defaults, as good as they were made here.
    "prefppo-tuned": lambda method: replace(
        method,
        questions=Questions(),
        reward=FitCfg(kind="mlp"),
        paid=AsFitted(),
    ),
}
"""The methods by name: the one that ships, it with a decision left out or another in
its place, and others'."""


def _as_published(method: Method, **fit: Any) -> Method:
    """Networks on raw rows, disagreement, sessions that begin small; answers are taken
    for right; what this project decides about training is left out."""
    return replace(
        method,
        budget=FrontLoaded(first_share=0.25),
        questions=Questions(uniform_share=0.0),
        reward=FitCfg(
            kind="raw", error_share=0.0, adapt=False, tie_threshold=0.0, **fit
        ),
        paid=AsFitted(),
        exploration=None,
        mirror=False,
        unstick=None,
        accept=None,
        tracking=None,
    )


def _raw(times: float, min_crop: float) -> RawCfg:
    usual = RawCfg()
    return replace(usual, learning_rate=times * usual.learning_rate, min_crop=min_crop)


def _asking(method: Method, **changes: Any) -> Method:
    return replace(method, questions=replace(method.questions, **changes))


def _showing(method: Method, **changes: Any) -> Method:
    return replace(method, clips=replace(method.clips, **changes))


def _fitting(method: Method, **changes: Any) -> Method:
    return replace(method, reward=replace(method.reward, **changes))


def _expecting(method: Method, **changes: Any) -> Method:
    return _fitting(method, linear=replace(method.reward.linear, **changes))


def _asked_evenly(method: Method) -> Method:
    """As many answers a round: from scratch there are four here, of a style two."""
    share = 0.25 if method.tracking is None else 0.5
    return replace(method, budget=replace(method.budget, first_share=share))


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
        """Name of the row's files; tells all that decides its outcome."""
        what = f"{self.task}-{self.answers}-{self.rater}-{self.method}"
        return f"{self.of_robot(what)}-seed{self.seed}"

    def of_robot(self, name: str) -> str:
        """`name` for what another robot does not share."""
        return name if self.robot is None else f"{name}-{self.robot}"

    @property
    def from_scratch(self) -> bool:
        """Whether no task reward is kept."""
        return self.task in FROM_SCRATCH


Row = tuple[str, int, str, int]
_BUDGETS: tuple[Row, ...] = (
    ("walk", 100, "perfect", 5),
    ("walk", 40, "perfect", 5),
    ("walk", 100, "mistakes20", 3),
    ("walk", 150, "stochastic30", 3),
    ("walk", 200, "mistakes40", 3),
    ("brisk_walk", 100, "mistakes20", 3),
    *((task, 60, "mistakes20", 3) for task in ("trot", "high_step")),
    *((task, 20, "perfect", 3) for task in ("high_step", "crouch", "low_energy")),
    *((task, 20, "perfect", 3) for task in ("trot", "lean")),
    *((task, 60, "perfect", 3) for task in ("high_step", "crouch", "low_energy")),
    *((task, 60, "perfect", 3) for task in ("smooth", "trot", "pace")),
    *((task, 150, "perfect", 3) for task in ("carried_foot", "nose_up")),
    ("get_up", 100, "perfect", 3),
    *((task, 60, "perfect", 3) for task in ("lean", "bound", "front_feet")),
    *((task, 100, "perfect", 3) for task in ("published_walk", "brisk_walk")),
)
"""Task, answers, rater and number of seeds."""


SCRATCH_ONLY = ("not-sure", "no-caution")
"""Methods that change a decision which styles do not have."""
_CURVED = ("high_step", "crouch", "trot")
_JUDGED = ("crouch", "high_step", "trot", "low_energy", "lean")
_BESIDE = ("walk", "high_step", "trot")


@dataclass(frozen=True, kw_only=True)
class Figure:
    """Rows that are run where their figure is named."""

    rows: tuple[Row, ...]
    """As of the rows that are run by default."""
    methods: tuple[str, ...] = ("default",)
    first_seed: int = 0


FIGURES = {
    "answers": Figure(
        rows=(
            *(("walk", few, "perfect", 5) for few in (20, 40, 70, 100)),
            *(
                (task, few, rater, 5)
                for task in _CURVED
                for few in (10, 20, 40, 60)
                for rater in ("perfect", "why80")
            ),
        )
    ),
    "erring": Figure(
        rows=(
            ("walk", 40, "mistakes20", 5),
            ("walk", 150, "stochastic30", 5),
            *(
                (task, 60, rater, 3)
                for task in _JUDGED
                for rater in ("mistakes20", "stochastic30")
            ),
            *((task, 20, "mistakes20why80", 3) for task in _CURVED),
        )
    ),
    "peers": Figure(
        rows=tuple(
            (task, answers, rater, 3)
            for task in _BESIDE
            for answers in (40, 100, 500)
            for rater in ("perfect", "mistakes20")
        ),
        methods=("default", *PEERS, "prefppo-tuned"),
    ),
    "rates": Figure(
        rows=tuple((task, 100, "perfect", 2) for task in _BESIDE),
        methods=tuple(f"{name}{rate}" for name in PEERS for rate in _RATES),
        first_seed=100,
    ),
}
"""Share against answers with and without reasons, raters who err, others' methods on
the same answers, and the search of their learning rates on seeds of its own."""


def plan(
    *,
    tasks: tuple[str, ...] = (),
    methods: tuple[str, ...] = (),
    raters: tuple[str, ...] = (),
    answers: tuple[int, ...] = (),
    robot: str | None = None,
    seeds: int | None,
    figure: str | None = None,
) -> list[Cell]:
    """The cells to run: first seeds first, so that every row soon has a figure.

    Methods are left out on tasks they change nothing of.

    Args:
        tasks: Only these; by default all that are not held back.
        methods: Only these; by default `default`, or those of the figure.
        raters: Only these; by default all.
        answers: Only rows with so many; by default all.
        robot: Name of another robot than the one that ships.
        seeds: At most so many of every row.
        figure: The rows of a figure, in place of those that run by default.
    """
    named = FIGURES[figure] if figure else Figure(rows=_BUDGETS)
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
        for task, labels, rater, count in named.rows
        if task in chosen
        and rater in (raters or RATERS)
        and (not answers or labels in answers)
        for method in methods or named.methods
        if task in FROM_SCRATCH or method not in SCRATCH_ONLY
        for seed in _seeds(
            named.first_seed, count if seeds is None else min(count, seeds)
        )
    ]
    return sorted(cells, key=lambda cell: cell.seed)


def _seeds(first: int, count: int) -> range:
    return range(first, first + count)


def cfg_of(
    cell: Cell, base: Path | None, *, robot: Path | None = None, quick: bool
) -> LoopCfg:
    """The loop of a cell.

    Args:
        cell: Which.
        base: Walking policy of the style tasks, which knows its robot; None: one that
            is trained first.
        robot: MJCF of another robot than the one that ships, where there is no base.
        quick: Thousands of steps instead of millions; the figures mean nothing.
    """
    rater = RATERS[cell.rater]
    if rater.why:
        rater = replace(rater, why=ABOUT[cell.task])
    cfg = loop_cfg(
        criterion=TASKS[cell.task],
        base="none" if cell.from_scratch else base or "task",
        robot=robot if base is None else None,
        labels=cell.answers,
        simulated=rater,
        quick=True,
        seed=cell.seed,
    )
    if cell.task == "get_up":
        cfg = replace(cfg, env=getup_env(cfg.env))
    cfg = replace(cfg, method=METHODS[cell.method](cfg.method))
    return tiny(cfg) if quick else cfg


def tiny(cfg: LoopCfg) -> LoopCfg:
    """`cfg` with one round, short episodes and next to no training."""
    return replace(
        cfg,
        env=replace(cfg.env, episode_s=2.0),
        rounds=1,
        labels=12,
        steps=StepsCfg(base=1536, round=1536, last=1536),
        evaluation_episodes=8,
        ppo=replace(cfg.ppo, num_envs=32),
        record=RecordCfg(episodes=40, episode_s=2.0),
    )


def steps_of(cfg: LoopCfg) -> int:
    """Environment steps a loop trains for, without its base."""
    return (cfg.rounds - 1) * cfg.steps.round + cfg.steps.last
