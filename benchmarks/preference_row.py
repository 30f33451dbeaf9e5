"""One row of the benchmark of preferences: a loop, and what it is measured against.

Shapes: T steps, N episodes, F feature columns.
"""

from __future__ import annotations

import fcntl
import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from data.files.files import write_atomically
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.run import run_loop
from gaitpref.method.context import RoundContext
from gaitpref.method.exploration import PutBack
from gaitpref.raters.criteria import Criterion, SequenceCriterion, load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from gaitpref.training.by_method import with_noise
from gaitpref.training.symmetry import in_mirror
from gaitpref.training.total_reward import TotalReward, total_reward
from gaitpref.training.tracking_limit import limit_beside
from policy.robots.shipped import WALK
from policy.rollouts.evaluate import Evaluation, rollout_features, summarise
from policy.rollouts.rollout import Actor, hold_home
from policy.training.checkpoint import Policy, load_policy
from policy.training.ppo import PpoCfg, ScoreFn, history_of
from policy.training.setup import setting_of
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

from .count_method import commit_of
from .preference_fresh import on_fresh_pairs
from .preference_plan import Cell, cfg_of, steps_of

EPISODES = 64
POLICY_SUFFIX = ".pt"
EVALUATION_SEED = 1_000_003
"""Seed of the episodes everything is evaluated on."""
REFERENCE_SEED = 1_000
"""Seed of the trainings that see the true reward, and of a walking base."""


@dataclass(frozen=True, kw_only=True)
class Places:
    """Where the benchmark keeps its files."""

    work: Path
    """Runs; what is finished there is not repeated."""
    results: Path
    """One JSON file for every finished row."""
    robot: Path | None = None
    """MJCF of the robot of cells that name one, or a policy.pt that it walks by."""
    references: Path | None = None
    """What rows are measured against, one file a task: it is trained once, and not on
    every machine. None: it is trained among the runs, and kept nowhere else."""
    quick: bool = False
    """A version of thousands of steps; its figures mean nothing."""

    @property
    def episodes(self) -> int:
        """Episodes of an evaluation."""
        return 8 if self.quick else EPISODES

    def result(self, cell: Cell) -> Path:
        return self.results / f"{cell.name}.json"

    def log(self, cell: Cell) -> Path:
        """What is said while it runs."""
        return self.work / f"{cell.name}.log"


def run_cell(cell: Cell, places: Places) -> None:
    """Run a cell, or go on with it, and write its row."""
    if places.result(cell).exists():
        return
    torch.set_num_threads(1)
    base = None if cell.from_scratch else walking_base(cell, places)
    cfg = cfg_of(cell, base, robot=places.robot, quick=places.quick)
    run = places.work / cell.name
    fresh = not run.exists()
    start_s = time.perf_counter()
    run_loop(run, cfg)
    minutes = (time.perf_counter() - start_s) / 60
    row = _row(cell, cfg, run, base, places)
    # A run that was interrupted does not know how long it took.
    row["minutes"] = minutes if fresh else None
    text = json.dumps(row, indent=1) + "\n"
    write_atomically(places.result(cell), text.encode())


def _row(
    cell: Cell, cfg: LoopCfg, run: Path, base: Path | None, places: Places
) -> dict[str, Any]:
    last = load_policy(run / f"rounds/{cfg.rounds:02d}/policy/policy.pt")
    score = _score(cfg, last)
    learned = measure(last, last, score, episodes=places.episodes)
    references = references_of(cell, cfg, base, places)
    start, true = references["start"]["return_mean"], references["true"]["return_mean"]
    reports = [
        json.loads((run / f"rounds/{number:02d}/report.json").read_text())
        for number in range(cfg.rounds + 1)
    ]
    *_, before, ended = reports
    fit = before["fit"]
    calibrated = before.get("trust", {}).get("calibrated") or {}
    alarms = [
        f"round {number}: {alarm}"
        for number, report in enumerate(reports)
        for alarm in report.get("trust", {}).get("alarms", ())
    ]
    return {
        **asdict(cell),
        "criterion": cfg.criterion,
        "fraction": (learned.return_mean - start) / (true - start),
        "return": learned.return_mean,
        "start_return": start,
        "true_return": true,
        "tracking_error_m_s": learned.tracking_error_m_s,
        "start_tracking_error_m_s": references["start"]["tracking_error_m_s"],
        "true_tracking_error_m_s": references["true"]["tracking_error_m_s"],
        "falls": learned.falls,
        "accuracy": fit["held_out_accuracy"],
        "at_random_accuracy": fit["at_random_accuracy"],
        "ece": fit["held_out_ece"],
        "ece_by_chance": calibrated.get("ece_by_chance"),
        "answers_used": fit["answers"],
        "verdict": ended.get("verdict", {}).get("word"),
        "alarms": len(alarms),
        "alarms_said": alarms,
        **on_fresh_pairs(run, cfg, _criterion(cfg, last)),
        "steps": steps_of(cfg),
        "commit": commit_of(Path(__file__).parents[1]),
    }


def measure(
    actor: Actor, policy: Policy, score: ScoreFn, *, episodes: int
) -> Evaluation:
    """`actor` on robot and grid of `policy`, without noise, from equal starts."""
    env = policy.info.env
    features, lengths = rollout_features(
        actor, policy.robot(), env, episodes=episodes, seed=EVALUATION_SEED
    )
    return summarise(features, lengths, score, control_dt_s=env.control_dt_s)


def _criterion(cfg: LoopCfg, policy: Policy) -> Criterion:
    context = criterion_context(policy.robot(), policy.info.env)
    return load_criterion(cfg.criterion, context)


def _score(cfg: LoopCfg, policy: Policy) -> ScoreFn:
    return score_of_criterion(_criterion(cfg, policy))


def walking_base(cell: Cell, places: Places) -> Path:
    """The policy all style tasks of a robot start from: the one that ships, that of
    others, or for a robot of others PPO on the hand-written walking reward."""
    if places.robot is None:
        return WALK
    if places.robot.suffix == POLICY_SUFFIX:
        return places.robot
    crouch = Cell(task="crouch", answers=60, rater="perfect", method="default", seed=0)
    cfg = cfg_of(crouch, None, robot=places.robot, quick=places.quick)

    def make(out: Path) -> None:
        setting = setting_of(None, places.robot)
        ppo = in_mirror(cfg.ppo, setting.robot) if cfg.method.mirror else cfg.ppo
        train_cfg = TrainCfg(
            steps=cfg.steps.base, env=setting.env, ppo=ppo, seed=REFERENCE_SEED
        )
        train(out, setting.robot, train_cfg, resume=True)

    return _made_once(places.work / cell.of_robot("base"), make) / "policy.pt"


def references_of(
    cell: Cell, cfg: LoopCfg, base: Path | None, places: Places
) -> dict[str, dict[str, Any]]:
    """Evaluations under the criterion: of the start, and of PPO that sees it.

    The start is the home pose, or the walking base; PPO goes on from the same start for
    as many steps with the same settings.
    """
    name = cell.of_robot(f"true-{cell.task}-{steps_of(cfg)}")
    of = {
        "base_sha256": None if base is None else load_policy(base).sha256,
        "episodes": places.episodes,
    }
    kept = None if places.references is None else places.references / f"{name}.json"
    if kept is not None and kept.exists():
        known = json.loads(kept.read_text())
        if known.pop("of") == of:
            return known

    def make(out: Path) -> None:
        # A loop decides by its reward whether noise comes down; here whichever is
        # better is compared with.
        ways = (False,) if base is None else (False, True)
        places_of = {calm: out / ("calm" if calm else "noisy") for calm in ways}
        beside = None
        if base is not None:
            beside = _beside_the_task(cfg, base, places.episodes)
        for calm, place in places_of.items():
            _train_on_criterion(place, cfg, base, beside, calm=calm)
        policies = [load_policy(place / "policy.pt") for place in places_of.values()]
        score = _score(cfg, policies[0])
        measured = [
            measure(policy, policy, score, episodes=places.episodes)
            for policy in policies
        ]
        start = hold_home if base is None else load_policy(base)
        begun = measure(start, policies[0], score, episodes=places.episodes)
        true = max(measured, key=lambda each: each.return_mean)
        found = {"start": asdict(begun), "true": asdict(true)}
        write_atomically(out / "references.json", json.dumps(found).encode())

    out = _made_once(places.work / name, make)
    found = json.loads((out / "references.json").read_text())
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"of": of, **found}, indent=1) + "\n"
        write_atomically(kept, text.encode())
    return found


def _train_on_criterion(
    out: Path,
    cfg: LoopCfg,
    base: Path | None,
    beside: tuple[PpoCfg, TotalReward] | None,
    *,
    calm: bool,
) -> None:
    xml = None if cfg.robot is None else Path(cfg.robot)
    setting = setting_of(base, xml)
    ppo = in_mirror(cfg.ppo, setting.robot) if cfg.method.mirror else cfg.ppo
    reward_fn = None
    if beside is not None:
        ppo, reward_fn = beside
    elif cfg.criterion != "task":
        context = criterion_context(setting.robot, cfg.env)
        score = score_of_criterion(load_criterion(cfg.criterion, context))
        reward_fn = total_reward(score, setting.robot, cfg.env, known=cfg.method.safety)
    train_cfg = TrainCfg(steps=steps_of(cfg), env=cfg.env, ppo=ppo, seed=REFERENCE_SEED)
    if base is not None:
        noise = PutBack().noise(
            RoundContext(number=1, rounds=cfg.rounds, labels=cfg.labels),
            policy_std=float(load_policy(base).std.mean()),
            pays_for_rate=calm,
        )
        train_cfg = with_noise(train_cfg, noise)
    train(
        out,
        setting.robot,
        train_cfg,
        reward_fn=reward_fn,
        reward_name=cfg.criterion,
        init=base,
        resume=True,
    )


def _beside_the_task(
    cfg: LoopCfg, base: Path, episodes: int
) -> tuple[PpoCfg, TotalReward]:
    """PPO and reward where the criterion counts beside the walking reward, as a learned
    style does."""
    setting, policy = setting_of(base, None), load_policy(base)
    rows, lengths = rollout_features(
        policy, setting.robot, setting.env, episodes=episodes, seed=REFERENCE_SEED
    )
    score, tracking, ppo = _score(cfg, policy), cfg.method.tracking, cfg.ppo
    if cfg.method.mirror:
        ppo = in_mirror(ppo, setting.robot, score, rows)
    return ppo, total_reward(
        _standardised(score, rows, lengths),
        setting.robot,
        setting.env,
        known=cfg.method.safety,
        weight=cfg.method.weight,
        keep_task=True,
        tracking_limit=None
        if tracking is None
        else limit_beside(policy, tracking, seed=REFERENCE_SEED),
    )


def _standardised(score: ScoreFn, features: Tensor, lengths: Tensor) -> ScoreFn:
    """`score` scaled as a learned reward is: unit deviation on what the base does in
    episodes [T, N, F] of `lengths` [N]."""
    steps = torch.arange(len(features))[:, None]
    scores = score(features, (steps == 0).expand(features.shape[:2]))
    std, mean = torch.std_mean(scores[steps < lengths])
    # A base that never shows the style has no deviation to divide by.
    scale = max(float(std), 0.05)

    def standardised(features: Tensor, starts: Tensor) -> Tensor:
        return (score(features, starts) - mean) / scale

    return SequenceCriterion(standardised, history_of(score))


def _made_once(out: Path, make: Callable[[Path], None]) -> Path:
    """The directory `out`, made by one process while the others wait for it."""
    done = out / "done"
    with _locked(out.with_suffix(".lock")):
        if not done.exists():
            out.mkdir(parents=True, exist_ok=True)
            make(out)
            done.touch()
    return out


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def forget(cell: Cell, places: Places) -> None:
    """Remove the run of a finished cell: its row is all that is kept."""
    shutil.rmtree(places.work / cell.name, ignore_errors=True)
    places.log(cell).unlink(missing_ok=True)
