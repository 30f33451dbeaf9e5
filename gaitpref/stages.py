"""The stages of a round, each a function from finished files to finished files.

A stage writes under a temporary name or adds what is named by its content, and ends
with one rename; one that finds its result already there does nothing. So the loop can
be killed anywhere and started again.
"""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data.dataset import Dataset
from data.files import replace_directory, write_atomically
from policy.checkpoint import load_policy
from policy.evaluate import rollout_features, summarise
from policy.ppo import RewardFn
from policy.record import record
from policy.robot import Robot
from policy.train import POLICY_NAME, SUMMARY_NAME, TrainCfg, train
from rewardmodel.fit import fit_reward
from rewardmodel.pairs import load_pairs
from rewardmodel.storage import load_reward, save_reward

from .criteria import Criterion
from .fit_summary import fit_summary
from .progress import console, counting_bar, training_bar
from .questions import ask
from .rater import answer_pairs
from .rewards import score_of_criterion, total_reward
from .run_config import LoopCfg

RATER_ID = "simulated"


@dataclass(frozen=True)
class Round:
    """The files of one round."""

    run: Path
    number: int

    @property
    def root(self) -> Path:
        return self.run / "rounds" / f"{self.number:02d}"

    @property
    def policy(self) -> Path:
        """The round's policy file."""
        return self.root / "policy" / POLICY_NAME

    @property
    def reward(self) -> Path:
        """The reward fitted to all answers up to this round."""
        return self.root / "reward"

    @property
    def report(self) -> Path:
        return self.root / "report.json"

    @property
    def recorded(self) -> Path:
        """Names the episodes of the round, once all are in the data set."""
        return self.root / "episodes.json"

    @property
    def before(self) -> Round:
        return Round(self.run, self.number - 1)


class Interrupted(KeyboardInterrupt):
    """Training was interrupted by the user; the same command goes on from there."""


def seed_of(cfg: LoopCfg, *purpose: int) -> int:
    """A seed of its own for every purpose."""
    return int(np.random.SeedSequence([cfg.seed, *purpose]).generate_state(1)[0])


def policy_stage(cfg: LoopCfg, round: Round, robot: Robot) -> None:
    """Train the round's policy: the first on the base, later ones on the reward."""
    if round.policy.exists():
        return
    partial = round.root / "policy.partial"
    if round.number == 0 and cfg.base not in ("task", "none"):
        source = Path(cfg.base)
        load_policy(source)
        write_atomically(_made(partial) / POLICY_NAME, source.read_bytes())
        replace_directory(partial, round.policy.parent)
        return
    reward_fn, name, init, std = None, "task", None, None
    if round.number == 0:
        steps = cfg.base_steps
    else:
        last = round.number == cfg.rounds
        steps = cfg.last_round_steps if last else cfg.round_steps
        reward_fn = total_reward(
            load_reward(round.before.reward),
            robot,
            cfg.env,
            known=cfg.known,
            weight=cfg.learned_weight,
            keep_task=cfg.keeps_task,
        )
        name = f"the reward learned in round {round.number - 1}"
        init = round.before.policy
        if cfg.exploration is not None:
            std = cfg.exploration.std(round.number, cfg.rounds)
    train_cfg = TrainCfg(
        steps=steps,
        env=cfg.env,
        ppo=cfg.ppo,
        seed=seed_of(cfg, round.number, 1),
        exploration_std=std,
    )
    with training_bar(f"round {round.number}: training", steps) as bar:
        result = train(
            partial,
            robot,
            train_cfg,
            reward_fn=reward_fn,
            reward_name=name,
            init=init,
            resume=True,
            on_iteration=bar,
        )
    if not result.finished:
        raise Interrupted
    replace_directory(partial, round.policy.parent)


def record_stage(cfg: LoopCfg, round: Round, dataset: Dataset) -> None:
    """Log episodes of the round's policy and its checkpoints to the data set."""
    if round.recorded.exists():
        return
    seed = seed_of(cfg, round.number, 2)
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


def pairs_stage(cfg: LoopCfg, round: Round, dataset: Dataset) -> None:
    """Add the round's questions, most of them where the ensemble disagrees."""
    with dataset.answers() as store:
        if store.pairs(round=round.number):
            return
        known = store.pairs()
    model = load_reward(round.before.reward) if round.number else None
    names = set(json.loads(round.recorded.read_text()))
    entries = [entry for entry in dataset.entries() if entry.sha256 in names]
    count = cfg.labels_of(round.number)
    rng = np.random.default_rng(seed_of(cfg, round.number, 3))
    chosen = ask(
        dataset,
        entries,
        cfg.clips,
        count,
        known=known,
        model=model,
        round_number=round.number,
        uniform_share=cfg.uniform_share,
        rng=rng,
    )
    with dataset.answers() as store:
        store.add_pairs(chosen)


def answers_stage(
    cfg: LoopCfg, round: Round, dataset: Dataset, criterion: Criterion
) -> None:
    """Have the round's questions answered."""
    if cfg.rater == "simulated":
        answer_pairs(
            dataset,
            criterion,
            rater_id=RATER_ID,
            seed=seed_of(cfg, round.number, 4),
            round=round.number,
        )
        return
    wait_for_answers(dataset, round.number, cfg.labels_of(round.number))


def wait_for_answers(dataset: Dataset, round: int, count: int) -> None:
    """Wait until `count` pairs of the round have an answer, whoever gives it."""
    console.print(f"round {round}: waiting for {count} answers to {dataset.root}")
    with (
        counting_bar(f"round {round}: answers", count) as bar,
        dataset.answers() as store,
    ):
        while True:
            answered = count - len(store.unanswered(round=round))
            bar.update(bar.task_ids[0], completed=answered)
            if answered >= count:
                return
            time.sleep(0.5)


def fit_stage(cfg: LoopCfg, round: Round, dataset: Dataset) -> None:
    """Fit a reward to all answers so far."""
    if round.reward.exists():
        return
    pairs = load_pairs([dataset])
    model, report = fit_reward(pairs, cfg.fit, seed=seed_of(cfg, round.number, 5))
    save_reward(model, round.reward)
    console.print(f"round {round.number}: {fit_summary(report)}")


def report_stage(cfg: LoopCfg, round: Round, criterion: Criterion) -> None:
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
    if round.number:
        trained_against = measured(load_reward(round.before.reward))
        result["learned_return"] = trained_against["return_mean"]
    if round.reward.exists():
        model = load_reward(round.reward)
        result["learned_return_next"] = measured(model)["return_mean"]
        result["fit"] = asdict(model.provenance.report)
    write_atomically(round.report, json.dumps(result, indent=1).encode())
    evaluation = result["evaluation"]
    console.print(
        f"round {round.number}: return {evaluation['return_mean']:.2f} "
        f"± {evaluation['return_ci95']:.2f} under {cfg.criterion}, tracking error "
        f"{evaluation['tracking_error_m_s']:.2f} m/s, "
        f"{evaluation['falls_per_minute']:.2f} falls/min"
    )


def _made(directory: Path) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    return directory
