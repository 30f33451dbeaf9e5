"""The stages of a round, each a function from finished files to finished files.

A stage writes under a temporary name or adds what is named by its content, and ends
with one rename; one that finds its result already there does nothing. So the loop can
be killed anywhere and started again.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from data.dataset import Dataset
from data.files import replace_directory, write_atomically
from policy.checkpoint import load_policy
from policy.evaluate import rollout_features, summarise
from policy.ppo import IterationStats, RewardFn
from policy.record import record
from policy.robot import Robot
from policy.train import POLICY_NAME, SUMMARY_NAME, TrainCfg, train
from rewardmodel.caution import CautiousReward
from rewardmodel.fit import fit_reward
from rewardmodel.pairs import load_pairs
from rewardmodel.storage import load_reward, save_reward

from .criteria import Criterion
from .fit_summary import fit_summary
from .people import People
from .progress import console, counting_bar, training_bar
from .rewards import score_of_criterion, total_reward
from .rounds import Round, seed_of
from .run_config import LoopCfg
from .tracking_limit import TrackingLimit, limit_beside
from .watch import WatchedReward, deserves_training, trust_of_round, watched


class Interrupted(KeyboardInterrupt):
    """Training was interrupted by the user; the same command goes on from there."""


def policy_stage(
    cfg: LoopCfg, round: Round, robot: Robot, dataset: Dataset, people: People
) -> None:
    """Train the round's policy: the first on the base, later ones on the reward.

    A reward that does not deserve it is not trained on: the policy stays.
    """
    if round.policy.exists():
        return
    partial = round.root / "policy.partial"
    untrained = _untrained(cfg, round)
    if untrained is not None:
        partial.mkdir(parents=True, exist_ok=True)
        write_atomically(partial / POLICY_NAME, untrained)
        replace_directory(partial, round.policy.parent)
        return
    plan = _plan(cfg, round, robot, dataset)
    place, asks = _place(cfg, round), round.number < cfg.rounds
    with training_bar(f"round {round.number}: training", plan.cfg.steps) as bar:

        def after(stats: IterationStats) -> bool:
            bar(stats)
            # The last iteration may end beyond the steps that were asked for.
            done = min(stats.steps / max(plan.cfg.steps, 1), 1.0)
            people.tell(f"{place}: training", done)
            return asks and bool(plan.watch and plan.watch.alarm)

        people.tell(f"{place}: training", 0.0)
        result = train(
            partial,
            robot,
            plan.cfg,
            reward_fn=plan.reward_fn,
            reward_name=plan.reward_name,
            init=plan.init,
            resume=True,
            on_iteration=after,
        )
    if not result.finished:
        raise Interrupted
    if plan.watch:
        plan.watch.save(partial)
        if plan.watch.alarm:
            told = f"round {round.number}: {plan.watch.alarm}"
            before = ", so it asks before it trains on" if asks else ""
            console.print(f"[bold red]ALARM[/] {told}{before}")
    replace_directory(partial, round.policy.parent)


def _untrained(cfg: LoopCfg, round: Round) -> bytes | None:
    """The policy file of a round that trains nothing; None where it does."""
    if round.number == 0 and cfg.base not in ("task", "none"):
        load_policy(Path(cfg.base))
        return Path(cfg.base).read_bytes()
    if round.number and not deserves_training(round.before):
        asks = round.number < cfg.rounds
        console.print(
            f"round {round.number}: the policy stays as it was, because the answers do "
            f"not agree; {'asking again' if asks else 'no answers are left'}"
        )
        return round.before.policy.read_bytes()
    return None


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """What a round's policy is trained on, and from where."""

    cfg: TrainCfg
    reward_fn: RewardFn | None = None
    reward_name: str = "task"
    init: Path | None = None
    watch: WatchedReward | None = None


def _plan(cfg: LoopCfg, round: Round, robot: Robot, dataset: Dataset) -> _Plan:
    train_cfg = TrainCfg(
        steps=planned_steps(cfg, round),
        env=cfg.env,
        ppo=cfg.ppo,
        seed=seed_of(cfg, round.number, 1),
    )
    if round.number == 0:
        return _Plan(cfg=train_cfg)
    reward_fn = total_reward(
        CautiousReward.where_answers_err(load_reward(round.before.reward), cfg.caution),
        robot,
        cfg.env,
        known=cfg.known,
        weight=cfg.learned_weight,
        keep_task=cfg.keeps_task,
        tracking_limit=_tracking_limit(cfg, round),
    )
    watch = watched(cfg, round, dataset, reward_fn)
    if cfg.exploration is not None:
        last = round.number == cfg.rounds
        train_cfg = replace(
            train_cfg,
            exploration_std=cfg.exploration.std(round.number, cfg.rounds),
            final_std=cfg.exploration.final if last else None,
        )
    return _Plan(
        cfg=train_cfg,
        reward_fn=watch or reward_fn,
        reward_name=f"the reward learned in round {round.number - 1}",
        init=round.before.policy,
        watch=watch,
    )


def _tracking_limit(cfg: LoopCfg, round: Round) -> TrackingLimit | None:
    """The same in all rounds, so that they cannot each add to the last one's error."""
    if not cfg.keeps_task or cfg.tracking_slack_m_s is None:
        return None
    return limit_beside(
        load_policy(Round(round.run, 0).policy),
        slack_m_s=cfg.tracking_slack_m_s,
        seed=seed_of(cfg, 0, 9),
    )


def planned_steps(cfg: LoopCfg, round: Round) -> int:
    """Environment steps of a round: its own, and what the round before left over."""
    if round.number == 0:
        return cfg.base_steps
    last = round.number == cfg.rounds
    own = cfg.last_round_steps if last else cfg.round_steps
    if round.number == 1:
        return own
    before = planned_steps(cfg, round.before)
    summary = round.before.policy.parent / SUMMARY_NAME
    done = json.loads(summary.read_text())["steps"] if summary.exists() else 0
    return own + max(0, before - done)


def record_stage(cfg: LoopCfg, round: Round, dataset: Dataset, people: People) -> None:
    """Log episodes of the round's policy and its checkpoints to the data set."""
    if round.recorded.exists():
        return
    seed = seed_of(cfg, round.number, 2)
    people.tell(f"{_place(cfg, round)}: recording what the new policy does")
    with counting_bar(f"round {round.number}: recording", cfg.record.episodes) as bar:

        def counted() -> Any:
            for episode in record(
                round.policy, cfg.record, seed=seed, round=round.number
            ):
                bar.advance(bar.task_ids[0])
                yield episode

        entries = dataset.add_episodes(counted())
    names = sorted(entry.sha256 for entry in entries)
    write_atomically(round.recorded, json.dumps(names, indent=0).encode())


def fit_stage(cfg: LoopCfg, round: Round, dataset: Dataset, people: People) -> None:
    """Fit a reward to all answers so far."""
    if round.reward.exists():
        return
    people.tell(f"{_place(cfg, round)}: learning from the answers")
    pairs = load_pairs([dataset])
    model, report = fit_reward(pairs, cfg.fit, seed=seed_of(cfg, round.number, 5))
    save_reward(model, round.reward)
    console.print(f"round {round.number}: {fit_summary(report)}")


def report_stage(
    cfg: LoopCfg, round: Round, dataset: Dataset, criterion: Criterion
) -> None:
    """Evaluate the round's policy under the criterion and the learned rewards."""
    if round.report.exists():
        return
    policy = load_policy(round.policy)
    # One seed for all rounds: their policies start from the same states.
    env = policy.info.env
    features, lengths = rollout_features(
        policy,
        policy.robot(),
        env,
        episodes=cfg.evaluation_episodes,
        seed=seed_of(cfg, 0, 6),
    )

    def measured(score_fn: RewardFn) -> dict[str, Any]:
        return asdict(
            summarise(features, lengths, score_fn, control_dt_s=env.control_dt_s)
        )

    result: dict[str, Any] = {
        "round": round.number,
        "policy_steps": policy.info.steps,
        "policy_sha256": policy.sha256,
        "evaluation": measured(score_of_criterion(criterion)),
    }
    summary = round.policy.parent / SUMMARY_NAME
    if summary.exists():
        result["training"] = json.loads(summary.read_text())
    rose = False
    if round.number:
        trained_against = measured(load_reward(round.before.reward))
        result["learned_return"] = trained_against["return_mean"]
        untrained = json.loads(round.before.report.read_text())["learned_return_next"]
        rose = result["learned_return"] > untrained
    if round.reward.exists():
        model = load_reward(round.reward)
        result["learned_return_next"] = measured(model)["return_mean"]
        result["fit"] = asdict(model.provenance.report)
    result["trust"] = trust_of_round(
        cfg, round, dataset, features, lengths, return_rose=rose
    )
    write_atomically(round.report, json.dumps(result, indent=1).encode())
    evaluation = result["evaluation"]
    console.print(
        f"round {round.number}: return {evaluation['return_mean']:.2f} "
        f"± {evaluation['return_ci95']:.2f} under {cfg.criterion}, tracking error "
        f"{evaluation['tracking_error_m_s']:.2f} m/s, "
        f"{evaluation['falls_per_minute']:.2f} falls/min"
    )
    for reason in result["trust"]["alarms"]:
        console.print(f"[bold red]ALARM[/] round {round.number}: {reason}")


def _place(cfg: LoopCfg, round: Round) -> str:
    """Where the loop is, for people, who count from 1."""
    if round.number == cfg.rounds:
        return "all rounds are answered"
    return f"round {round.number + 1} of {cfg.rounds}"
