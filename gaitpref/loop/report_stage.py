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

from data.datasets.dataset import Dataset
from data.files.files import read_json, write_atomically
from gaitpref.console.progress import console, counted
from gaitpref.raters.criteria import Criterion
from gaitpref.raters.criterion_scores import score_of_criterion
from gaitpref.raters.rater_groups import who_agrees
from gaitpref.report.findings import findings_of_run
from gaitpref.report.return_text import return_text
from gaitpref.report.verdict import Verdict
from policy.rollouts.evaluate import evaluate, rollout_features, summarise
from policy.training.checkpoint import load_policy
from policy.training.ppo import ScoreFn
from policy.training.training_dir import SUMMARY_NAME
from rewardmodel.models.storage import load_reward

from .drift import trust_of_round
from .loop_cfg import LoopCfg
from .run_dir import Round, began_from, seed_of

_RUN = Path("RUN")
"""The run's directory, in what is advised."""


def began_with(cfg: LoopCfg, round: Round) -> float:
    """Return, under the reward a round trained on, of the policy it began from."""
    began = began_from(round)
    if began == round.before.policy:
        return read_json(round.before.report)["learned_return_next"]
    title = f"round {round.number}: evaluating what it began from, steps"
    with counted(title) as tell:
        return evaluate(
            load_policy(began),
            load_reward(round.before.reward),
            episodes=cfg.evaluation_episodes,
            seed=seed_of(cfg, 0, 6),
            tell=tell,
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
    with counted(f"round {round.number}: evaluating, steps") as tell:
        features, lengths = rollout_features(
            policy,
            policy.robot(),
            env,
            episodes=cfg.evaluation_episodes,
            seed=seed_of(cfg, 0, 6),
            tell=tell,
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
    for name, file in (
        ("training", round.policy.parent / SUMMARY_NAME),
        ("approval", round.approval),
        ("verdict", round.verdict),
        ("decided", round.decided),
        ("standstill", round.standstill),
    ):
        if file.exists():
            result[name] = read_json(file)
    if "verdict" in result:
        # Wherever the run is by then: the page and `watch` put in its place.
        advice = Verdict.from_json(result["verdict"]).advice(_RUN)
        result["verdict"] = {**result["verdict"], "advice": advice}
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
    if round.number == cfg.rounds:
        result["groups"] = who_agrees(
            dataset,
            unchecked=cfg.unchecked,
            # The wish of a program never changes.
            alone=cfg.rater == "human",
            where=f"round {round.number}: ",
        )
    write_atomically(round.report, json.dumps(result, indent=1).encode())
    evaluation = result["evaluation"]
    earned = return_text(evaluation["return_mean"], evaluation["return_ci95"])
    console.print(
        f"round {round.number}: return {earned} under {cfg.criterion}, tracking error "
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
    for line in result.get("groups", ()):
        console.print(line)
    if "verdict" in result:
        verdict = Verdict.from_json(result["verdict"])
        console.print(f"the run: {verdict.sentence}")
        console.print(f"next: {verdict.advice(round.run)}")
