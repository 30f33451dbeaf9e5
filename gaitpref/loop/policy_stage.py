"""The stage that trains: a round's policy, on the reward of the round before.

Like every stage it finds what is finished already, so it can be killed anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from data.answers.address import Address
from data.datasets.dataset import Dataset
from data.files.files import read_file, read_json, replace_directory, write_atomically
from data.files.limits import POLICY_BYTES
from gaitpref.console.progress import console, training_bar
from gaitpref.method.context import RoundContext
from gaitpref.training.by_method import Retraining, rows_of
from gaitpref.training.off_policy_training import off_policy_cfg, paid_by_step
from gaitpref.training.symmetry import in_mirror
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.offpolicy.sac_cfg import SacCfg
from policy.parallel.ranks import ALONE, Ranks, others_alive
from policy.robots.robot import Robot
from policy.training.checkpoint import holding_home, load_policy
from policy.training.ppo import IterationStats, ScoreFn
from policy.training.train import Engine, train
from policy.training.train_cfg import TrainCfg
from policy.training.training_dir import POLICY_NAME, SUMMARY_NAME
from rewardmodel.models.storage import load_reward

from .drift import deserves_training, why_not_trained
from .loop_cfg import LoopCfg
from .people import People
from .run_dir import (
    STANDSTILL_NAME,
    Round,
    approved,
    began_from,
    context_of,
    place_of,
    seed_of,
    trained_before,
)
from .standstill import Standstill, standstill_before


class Interrupted(KeyboardInterrupt):
    """Training was interrupted by the user; the same command goes on from there."""


def policy_stage(
    cfg: LoopCfg,
    round: Round,
    context: RoundContext,
    robot: Robot,
    dataset: Dataset,
    people: People,
    ranks: Ranks = ALONE,
) -> None:
    """Train the round's policy: the first on the base, later ones on the reward.

    A reward that does not deserve it is not trained on: the policy stays, or, where
    there is none yet, holds the home pose. The last one waits for approval where
    answers are kept for that.
    """
    if round.policy.exists() or round.candidate.exists():
        return
    judged = context.is_last and cfg.method.labels_kept(context)
    done = round.candidate if judged else round.policy.parent
    partial = partial_of(round)
    untrained = _untrained(cfg, round)
    if untrained is not None:
        partial.mkdir(parents=True, exist_ok=True)
        write_atomically(partial / POLICY_NAME, untrained)
        # Where nothing was ever trained there is nobody to ask about.
        never = load_policy(partial / POLICY_NAME).info.steps == 0
        replace_directory(partial, round.policy.parent if never else done)
        return
    plan = _plan(cfg, round, context, robot, dataset)
    if plan.standstill:
        console.print(
            f"round {round.number}: the robot goes nowhere ({plan.standstill}); it is "
            f"trained on what those members of the reward think who like that least"
        )
    _train(cfg, round, robot, plan, people, ranks)
    if plan.standstill:
        plan.standstill.save(partial)
    replace_directory(partial, done)


def train_along(
    run: Path, cfg: LoopCfg, robot: Robot, answers: Address | None, ranks: Ranks
) -> None:
    """Take part in the trainings that the first of `ranks` comes to in `run`, to its
    end.

    Raises:
        Interrupted: the user ended one of them before it was done.
        RankLost: another rank is gone.
    """
    with others_alive():
        while (number := ranks.awaited()) is not None:
            round = Round(run, number)
            dataset = Dataset.open(run / "dataset", answers=answers)
            context = context_of(cfg, round)
            plan = _plan(cfg, round, context, robot, dataset)
            _train(cfg, round, robot, plan, People(), ranks)


def _train(
    cfg: LoopCfg,
    round: Round,
    robot: Robot,
    plan: _Plan,
    people: People,
    ranks: Ranks,
) -> None:
    """Train as planned into the round's unfinished directory, or go on with it.

    Raises:
        Interrupted: the user ended it before it was done.
    """
    if ranks.is_first:
        ranks.begin(round.number)
    place = place_of(cfg, round)
    with training_bar(f"round {round.number}: training", plan.cfg.steps) as bar:

        def after(stats: IterationStats) -> None:
            bar(stats)
            # The last iteration may end beyond the steps that were asked for.
            done = min(stats.steps / max(plan.cfg.steps, 1), 1.0)
            people.tell(f"{place}: training", done)

        people.tell(f"{place}: training", 0.0)
        result = train(
            partial_of(round),
            robot,
            plan.cfg,
            reward_fn=plan.reward_fn,
            reward_name=plan.reward_name,
            init=plan.init,
            resume=True,
            on_iteration=after,
            ranks=ranks,
            engine=plan.engine,
        )
    if not result.finished:
        raise Interrupted


def partial_of(round: Round) -> Path:
    """Where the round's policy is until it is finished."""
    return round.root / "policy.partial"


def _untrained(cfg: LoopCfg, round: Round) -> bytes | None:
    """The policy file of a round that trains nothing; None where it does."""
    if round.number == 0 and cfg.base_file is not None:
        return read_file(cfg.base_file, POLICY_BYTES)
    if round.number and not deserves_training(round.before):
        asks = round.number < cfg.rounds
        kept = approved(round.before)
        # A policy that was trained to be seen need not please.
        shown = (kept.parent / STANDSTILL_NAME).exists()
        untrained = load_policy(kept).info.steps == 0
        stands = cfg.base == "none" and (untrained or shown)
        why = why_not_trained(round.before)
        stays = "robot stands still" if stands else "policy stays as it was"
        console.print(
            f"round {round.number}: the {stays}, because the answers {why}; "
            f"{'asking again' if asks else 'no round is left'}"
        )
        return holding_home(kept) if stands else read_file(kept, POLICY_BYTES)
    return None


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """What a round's policy is trained on, and from where."""

    cfg: TrainCfg
    reward_fn: ScoreFn | None = None
    reward_name: str = "task"
    init: Path | None = None
    standstill: Standstill | None = None
    """The standing still that the training is to leave."""
    engine: Engine | None = None
    """What learns; None is PPO."""


def _plan(
    cfg: LoopCfg, round: Round, context: RoundContext, robot: Robot, dataset: Dataset
) -> _Plan:
    method = cfg.method
    train_cfg = TrainCfg(
        steps=planned_steps(cfg, round),
        env=cfg.env,
        ppo=cfg.ppo,
        sim=cfg.steps.sim,
        seed=seed_of(cfg, round.number, 1),
    )
    if context.is_first:
        if method.mirror:
            train_cfg = replace(train_cfg, ppo=in_mirror(cfg.ppo, robot))
        return _learned_by(method.learner, round, _Plan(cfg=train_cfg))
    model = load_reward(round.before.reward)
    init = began_from(round)
    retraining = Retraining(
        method=method,
        context=context,
        robot=robot,
        model=model,
        seen=rows_of(dataset, read_json(round.before.recorded)),
        start=load_policy(init),
        base=load_policy(Round(round.run, 0).policy) if cfg.keeps_task else None,
    )
    standstill = standstill_before(cfg, round, context)
    if standstill and method.unstick:
        learned = standstill.reward(model, method.unstick)
    else:
        learned = method.paid.of(model, context)
    plan = _Plan(
        cfg=retraining.trained(train_cfg),
        reward_fn=retraining.reward(learned, train_cfg),
        reward_name=f"the reward learned in round {round.number - 1}",
        init=init,
        standstill=standstill,
    )
    return _learned_by(method.learner, round, plan)


def _learned_by(learner: SacCfg | None, round: Round, plan: _Plan) -> _Plan:
    """`plan` as `learner` does it, whose memory begins with that of the training
    before; None is PPO."""
    if learner is None:
        return plan
    engine = OffPolicy(cfg=learner, replay=trained_before(round), tell=console.print)
    paid = paid_by_step(plan.reward_fn, console.print)
    return replace(plan, cfg=off_policy_cfg(plan.cfg), engine=engine, reward_fn=paid)


def planned_steps(cfg: LoopCfg, round: Round) -> int:
    """Environment steps of a round: its own, and what the round before left over."""
    if round.number == 0:
        return cfg.steps.base
    own = cfg.steps.last if round.number == cfg.rounds else cfg.steps.round
    if round.number == 1:
        return own
    before = planned_steps(cfg, round.before)
    summary = round.before.policy.parent / SUMMARY_NAME
    done = read_json(summary)["steps"] if summary.exists() else 0
    return own + max(0, before - done)
