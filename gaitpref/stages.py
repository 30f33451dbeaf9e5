"""The stages of a round, each a function from finished files to finished files.

A stage writes under a temporary name or adds what is named by its content, and ends
with one rename; one that finds its result already there does nothing. So the loop can
be killed anywhere and started again.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from data.datasets.dataset import Dataset
from data.datasets.gone import told_gone
from data.files.files import read_json, write_atomically
from gaitpref.method.context import RoundContext
from gaitpref.method.noisy import NoisyAnswers
from policy.rollouts.evaluate import evaluate, rollout_features, summarise
from policy.rollouts.record import record
from policy.training.checkpoint import load_policy
from policy.training.ppo import ScoreFn
from policy.training.train import SUMMARY_NAME
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.fitting.fit_reward import fit_reward, no_reward
from rewardmodel.models.storage import load_reward, save_reward

from .by_method import recorded_by
from .criteria import Criterion
from .findings import findings_of_run
from .fit_summary import fit_summary
from .loop_cfg import LoopCfg
from .people import People
from .progress import console, counting_bar
from .rewards import score_of_criterion
from .rounds import Round, began_from, decided_before, place_of, seed_of
from .verdict import Verdict
from .watch import trust_of_round


def record_stage(cfg: LoopCfg, round: Round, dataset: Dataset, people: People) -> None:
    """Log episodes of the round's policy and its checkpoints to the data set."""
    if round.recorded.exists():
        return
    seed = seed_of(cfg, round.number, 2)
    people.tell(f"{place_of(cfg, round)}: recording what the new policy does")
    with counting_bar(f"round {round.number}: recording", cfg.record.episodes) as bar:

        def counted() -> Any:
            for episode in record(
                round.policy,
                recorded_by(cfg.method.clips, cfg.record),
                seed=seed,
                round=round.number,
            ):
                bar.advance(bar.task_ids[0])
                yield episode

        entries = dataset.add_episodes(counted())
    names = sorted(entry.sha256 for entry in entries)
    write_atomically(round.recorded, json.dumps(names, indent=0).encode())


def fit_stage(
    cfg: LoopCfg,
    round: Round,
    context: RoundContext,
    dataset: Dataset,
    people: People,
) -> None:
    """Fit a reward to all answers so far; where they prefer too little, it is 0.

    The first reward of a run decides whether its answers err.
    """
    if round.reward.exists():
        return
    people.tell(f"{place_of(cfg, round)}: learning from the answers")
    pairs = load_pairs([dataset], at_least=0)
    settings = cfg.method.fit_of(context)
    if pairs.too_little:
        model, _ = no_reward(pairs, settings)
        told = f"{pairs.too_little}: it is 0"
    else:
        seed = seed_of(cfg, round.number, 5)
        model, report = fit_reward(pairs, settings, seed=seed)
        told = fit_summary(report)
        if not decided_before(round):
            decided = NoisyAnswers.of(model)
            text = json.dumps({**asdict(decided), "told": str(decided)})
            write_atomically(round.decided, text.encode())
            told = f"{told}; {decided}"
    save_reward(model, round.reward)
    console.print(f"round {round.number}: {told}")
    if gone := told_gone(pairs.num_gone, pairs.num_collected, dataset.root):
        console.print(f"round {round.number}: {gone}")


def began_with(cfg: LoopCfg, round: Round) -> float:
    """Return, under the reward a round trained on, of the policy it began from."""
    began = began_from(round)
    if began == round.before.policy:
        return read_json(round.before.report)["learned_return_next"]
    return evaluate(
        load_policy(began),
        load_reward(round.before.reward),
        episodes=cfg.evaluation_episodes,
        seed=seed_of(cfg, 0, 6),
    ).return_mean


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

    def measured(score_fn: ScoreFn) -> dict[str, Any]:
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
        result["training"] = read_json(summary)
    if round.approval.exists():
        result["approval"] = read_json(round.approval)
    if round.verdict.exists():
        result["verdict"] = read_json(round.verdict)
    if round.decided.exists():
        result["decided"] = read_json(round.decided)
    if round.standstill.exists():
        result["standstill"] = read_json(round.standstill)
    rose = False
    if round.number:
        trained_against = measured(load_reward(round.before.reward))
        result["learned_return"] = trained_against["return_mean"]
        rose = result["learned_return"] > began_with(cfg, round)
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
        console.alarm(f"round {round.number}: {reason}")
    findings = findings_of_run(
        [*(read_json(Round(round.run, n).report) for n in range(round.number)), result],
        criterion=cfg.wish,
    )
    for besides in findings.besides:
        console.print(f"round {round.number}: {besides}")
    if "verdict" in result:
        verdict = Verdict.from_json(result["verdict"])
        console.print(f"the run: {verdict.sentence}")
        console.print(f"next: {verdict.advice(round.run)}")
