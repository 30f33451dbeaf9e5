"""The stages of a round, each a function from finished files to finished files.

A stage writes under a temporary name or adds what is named by its content, and ends
with one rename; one that finds its result already there does nothing. So the loop can
be killed anywhere and started again.
"""

from __future__ import annotations

import json
from dataclasses import asdict
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
from .watch import deserves_training, trust_of_round, watched


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
    if round.number == 0 and cfg.base not in ("task", "none"):
        source = Path(cfg.base)
        load_policy(source)
        write_atomically(_made(partial) / POLICY_NAME, source.read_bytes())
        replace_directory(partial, round.policy.parent)
        return
    if round.number and not deserves_training(round.before):
        kept = round.before.policy.read_bytes()
        write_atomically(_made(partial) / POLICY_NAME, kept)
        replace_directory(partial, round.policy.parent)
        console.print(
            f"round {round.number}: the policy stays as it was, because the answers do "
            f"not agree; "
            + ("asking again" if round.number < cfg.rounds else "no answers are left")
        )
        return
    reward_fn, name, init, std, final_std = None, "task", None, None, None
    watch = None
    steps = planned_steps(cfg, round)
    if round.number:
        reward_fn = total_reward(
            load_reward(round.before.reward),
            robot,
            cfg.env,
            known=cfg.known,
            weight=cfg.learned_weight,
            keep_task=cfg.keeps_task,
        )
        watch = watched(cfg, round, dataset, reward_fn)
        name = f"the reward learned in round {round.number - 1}"
        init = round.before.policy
        if cfg.exploration is not None:
            std = cfg.exploration.std(round.number, cfg.rounds)
            last = round.number == cfg.rounds
            final_std = cfg.exploration.final if last else None
    train_cfg = TrainCfg(
        steps=steps,
        env=cfg.env,
        ppo=cfg.ppo,
        seed=seed_of(cfg, round.number, 1),
        exploration_std=std,
        final_std=final_std,
    )
    with training_bar(f"round {round.number}: training", steps) as bar:

        def after(stats: IterationStats) -> bool:
            bar(stats)
            # The last iteration may end beyond the steps that were asked for.
            done = min(stats.steps / max(steps, 1), 1.0)
            people.tell(f"{_place(cfg, round)}: training", done)
            return round.number < cfg.rounds and bool(watch and watch.alarm)

        people.tell(f"{_place(cfg, round)}: training", 0.0)
        result = train(
            partial,
            robot,
            train_cfg,
            reward_fn=watch or reward_fn,
            reward_name=name,
            init=init,
            resume=True,
            on_iteration=after,
        )
    if not result.finished:
        raise Interrupted
    if watch:
        watch.save(partial)
    if watch and watch.alarm:
        asks = ", so it asks before it trains on" if round.number < cfg.rounds else ""
        console.print(f"[bold red]ALARM[/] round {round.number}: {watch.alarm}{asks}")
    replace_directory(partial, round.policy.parent)


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


def _made(directory: Path) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    return directory


def _place(cfg: LoopCfg, round: Round) -> str:
    """Where the loop is, for people, who count from 1."""
    if round.number == cfg.rounds:
        return "all rounds are answered"
    return f"round {round.number + 1} of {cfg.rounds}"
