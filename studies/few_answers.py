"""What few answers say of a wish, without any training: minutes instead of hours.

`python -m studies.few_answers --base POLICY` records a walking policy twice, asks
about the first recording and lets the fitted reward choose among clips of the second.
A figure is the true worth of the twentieth of those that it likes best, from 0 of the
mean clip to 1 of the truly best twentieth, in the mean over the commands.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
import tyro

from benchmarks.preference_plan import ABOUT, TASKS
from data.answers.answer_records import Aspect, Pair
from data.answers.strategy_names import StrategyName
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from gaitpref.method.method import STYLE
from gaitpref.raters.criteria import CriterionContext, load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from gaitpref.raters.error_model import said_why
from gaitpref.raters.rater_cfg import RaterCfg
from gaitpref.training.by_method import recorded_by
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import load_policy
from policy.training.ppo import ScoreFn
from rewardmodel.acquisition import asked_for
from rewardmodel.answers.answered_pairs import gather_pairs
from rewardmodel.answers.clip_batch import ClipBatch, read_clips
from rewardmodel.answers.recorded import RecordedClips, recorded_clips
from rewardmodel.asking.clip_questions import ClipCfg, ask, clips_of
from rewardmodel.cfg import FitCfg, KindName
from rewardmodel.fitting.fit_reward import fit_reward
from rewardmodel.models.model import RewardModel

BEST = 0.05
"""Share of the clips that are chosen."""
CUT = ClipCfg()


@dataclass(frozen=True, kw_only=True)
class FewAnswers:
    """Ask, fit, choose."""

    base: Path
    """Walking policy."""
    work: Path = Path("runs/few-answers")
    """Directory of the recordings."""
    kind: KindName = "posterior"
    """Reward that is fitted."""
    strategy: StrategyName = "information"
    """How questions are chosen."""
    batch: int = 1
    """Questions chosen at a time."""
    tasks: tuple[str, ...] = ("high_step", "crouch", "low_energy", "smooth", "trot")
    """Wishes, by their names in `benchmarks.preference_plan`."""
    counts: tuple[int, ...] = (5, 10, 20, 40)
    """Answers after which it is measured."""
    seeds: tuple[int, ...] = (100, 101)
    """Seeds of the questions; the table of `benchmarks.preferences` has 0 to 4."""
    why: bool = False
    """Answers name a reason, the right one in four of five."""
    mistakes: float = 0.0
    """Share of the answers that are the wrong way round."""

    @property
    def fit(self) -> FitCfg:
        """The style's, of another kind."""
        return replace(STYLE.reward, kind=self.kind)


class Recording:
    """Episodes of a policy, and what a criterion makes of them."""

    def __init__(self, dataset: Dataset) -> None:
        self.dataset = dataset
        self.entries = {entry.sha256: entry for entry in dataset.entries()}
        self.rows = {name: np.array(dataset.features(name)) for name in self.entries}

    @cached_property
    def clips(self) -> list[Clip]:
        """All there are."""
        return clips_of(list(self.entries.values()), CUT)

    @cached_property
    def batch(self) -> ClipBatch:
        """The same, padded."""
        return read_clips(self.clips, self.clip_rows)

    @cached_property
    def command(self) -> np.ndarray:
        """[C] number of what the robot was told in each."""
        told: dict[object, int] = {}
        facts = (asked_for(self.entries[c.rollout], c) for c in self.clips)
        return np.array([told.setdefault(fact, len(told)) for fact in facts])

    @cached_property
    def pool(self) -> RecordedClips | None:
        """What opinions are about."""
        return recorded_clips([self.dataset])

    def clip_rows(self, clip: Clip) -> np.ndarray:
        """[T, F] of a clip."""
        return self.rows[clip.rollout][clip.rows]

    def worth(self, score: ScoreFn) -> dict[str, np.ndarray]:
        """[T] of every episode, by name."""
        found = {}
        for name, rows in self.rows.items():
            starts = torch.arange(len(rows))[:, None] == 0
            found[name] = score(torch.from_numpy(rows)[:, None], starts)[:, 0].numpy()
        return found


def recordings(cfg: FewAnswers) -> tuple[Recording, Recording]:
    """What is asked about, and what is chosen from; made once."""
    found = []
    for name, seed in (("asked", 11), ("fresh", 12)):
        root = cfg.work / name
        if not (root / "done").exists():
            how = recorded_by(STYLE.clips, RecordCfg())
            Dataset.create(root).add_episodes(record(cfg.base, how, seed=seed))
            (root / "done").touch()
        found.append(Recording(Dataset.open(root)))
    return found[0], found[1]


def share_of_best(worth: np.ndarray, truth: np.ndarray, command: np.ndarray) -> float:
    """How good the best by `worth` [C] truly are [C], in the mean over commands [C]."""
    shares = []
    for told in np.unique(command):
        own, true = worth[command == told], truth[command == told]
        count = max(1, round(BEST * len(own)))
        liked, best = true[np.argsort(-own)][:count], np.sort(true)[-count:]
        shares.append((liked.mean() - true.mean()) / (best.mean() - true.mean()))
    return float(np.mean(shares))


def learned(
    cfg: FewAnswers,
    asked_of: Recording,
    truth: dict[str, np.ndarray],
    seed: int,
    *,
    about: Aspect,
) -> Iterator[tuple[int, RewardModel]]:
    """Number of answers, and the reward fitted to them, of every count."""
    rng = np.random.default_rng([seed, 5])
    pairs: list[Pair] = []
    targets: list[float] = []
    whys: list[str] = []
    rater = RaterCfg(why=about if cfg.why else None)
    model = None
    while len(pairs) < max(cfg.counts):
        new = ask(
            asked_of.dataset,
            list(asked_of.entries.values()),
            CUT,
            cfg.batch,
            known=pairs,
            model=model,
            round_number=0,
            uniform_share=0.0,
            strategy=cfg.strategy,
            rng=rng,
        )
        for pair in new:
            left, right = (truth[c.rollout][c.rows].mean() for c in (pair.a, pair.b))
            wrong = rng.random() < cfg.mistakes
            targets.append(float((left > right) != wrong))
            pairs.append(pair)
            whys.append(said_why(rater, rng))
        answered = replace(
            gather_pairs([asked_of.dataset], pairs),
            target=torch.tensor(targets),
            whys=tuple(whys),
            recorded=asked_of.pool,
        )
        model, _ = fit_reward(answered, cfg.fit, seed=len(pairs), measured=False)
        if len(pairs) in cfg.counts:
            yield len(pairs), model


def main(cfg: FewAnswers) -> None:
    """Print a line of JSON for every wish and seed."""
    torch.set_num_threads(1)
    asked_of, fresh = recordings(cfg)
    policy = load_policy(cfg.base)
    context: CriterionContext = criterion_context(policy.robot(), policy.info.env)
    for task in cfg.tasks:
        score = score_of_criterion(load_criterion(TASKS[task], context))
        true = fresh.worth(score)
        truth = np.array([true[c.rollout][c.rows].mean() for c in fresh.clips])
        for seed in cfg.seeds:
            shares = {}
            asked = learned(
                cfg, asked_of, asked_of.worth(score), seed, about=ABOUT[task]
            )
            for count, model in asked:
                found = share_of_best(_liked(model, fresh), truth, fresh.command)
                shares[count] = round(found, 3)
            row = {"task": task, "seed": seed, "kind": cfg.kind, "shares": shares}
            print(json.dumps(row), flush=True)


def _liked(model: RewardModel, of: Recording) -> np.ndarray:
    """[C] mean reward of every clip."""
    reward, _ = model.clip_rewards(of.batch)
    scored = of.batch.scored
    return ((reward * scored).sum(dim=1) / scored.sum(dim=1).clamp_min(1)).numpy()


if __name__ == "__main__":
    main(tyro.cli(FewAnswers))
