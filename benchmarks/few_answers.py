"""What few answers say of a wish, without any training: in minutes, not hours.

`python -m benchmarks.few_answers --base POLICY` records a walking policy twice, asks
about the first recording and lets the fitted reward choose among the second. A figure
is the true score of the twentieth of those clips it likes best, from 0 of the mean clip
to 1 of the truly best twentieth, in the mean over the commands.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
import tyro

from data.answers import Pair
from data.clips import Clip
from data.dataset import Dataset, EpisodeEntry
from gaitpref.by_method import recorded_by
from gaitpref.criteria import load_criterion
from gaitpref.method.method import STYLE
from gaitpref.questions import ClipCfg, ask, clips_of
from gaitpref.rewards import criterion_context, score_of_criterion
from policy.checkpoint import load_policy
from policy.record import RecordCfg, record
from rewardmodel.acquisition import asked_for
from rewardmodel.cfg import FitCfg
from rewardmodel.clips import read_clips
from rewardmodel.fit import fit_reward
from rewardmodel.model import RewardModel
from rewardmodel.pairs import gather_pairs
from rewardmodel.recorded import recorded_clips

from .preference_plan import TASKS

_BEST = 0.05


@dataclass(frozen=True, kw_only=True)
class FewAnswers:
    """Ask, fit, choose."""

    base: Path
    """Walking policy."""
    work: Path = Path("runs/few-answers")
    """Directory of the recordings and results."""
    kind: str = "posterior"
    """Reward that is fitted."""
    strategy: str = "information"
    """How questions are chosen."""
    batch: int = 1
    """Questions chosen at a time."""
    tasks: tuple[str, ...] = (
        "high_step",
        "crouch",
        "low_energy",
        "smooth",
        "trot",
        "lean",
    )
    counts: tuple[int, ...] = (5, 10, 20, 40)
    """Answers after which it is measured."""
    seeds: int = 1
    mistakes: float = 0.0
    """Share of the answers that are the wrong way round."""
    name: str = "results"


class Recorded:
    """One recording, in memory."""

    def __init__(self, dataset: Dataset) -> None:
        self.dataset = dataset
        self.entries: tuple[EpisodeEntry, ...] = dataset.entries()
        self.rows = {
            e.sha256: np.array(dataset.features(e.sha256)) for e in self.entries
        }

    def clip_rows(self, clip: Clip) -> np.ndarray:
        return self.rows[clip.rollout][clip.rows]


def recordings(cfg: FewAnswers) -> list[Recorded]:
    found = []
    for name, seed in (("ask", 11), ("fresh", 12)):
        root = cfg.work / name
        if not (root / "done").exists():
            dataset = Dataset.create(root)
            how = recorded_by(STYLE.clips, RecordCfg())
            dataset.add_episodes(record(cfg.base, how, seed=seed))
            (root / "done").touch()
        found.append(Recorded(Dataset.open(root)))
    return found


def share_of_best(worth: np.ndarray, truth: np.ndarray, command: np.ndarray) -> float:
    shares = []
    for told in np.unique(command):
        own, true = worth[command == told], truth[command == told]
        count = max(1, round(_BEST * len(own)))
        liked, best = true[np.argsort(-own)][:count], np.sort(true)[-count:]
        shares.append((liked.mean() - true.mean()) / (best.mean() - true.mean()))
    return float(np.mean(shares))


def main(cfg: FewAnswers) -> None:
    torch.set_num_threads(1)
    asked_of, fresh = recordings(cfg)
    policy = load_policy(cfg.base)
    context = criterion_context(policy.robot(), policy.info.env)
    pool = recorded_clips([asked_of.dataset])
    cut = ClipCfg()
    clips = clips_of(fresh.entries, cut)
    by_sha = {e.sha256: e for e in fresh.entries}
    batch = read_clips(clips, fresh.clip_rows)
    told: dict[object, int] = {}
    command = np.array(
        [told.setdefault(asked_for(by_sha[c.rollout], c), len(told)) for c in clips]
    )
    asked_of.dataset.clip_features = asked_of.clip_rows  # type: ignore[method-assign]
    out = cfg.work / f"{cfg.name}.jsonl"
    for task in cfg.tasks:
        score = score_of_criterion(load_criterion(TASKS[task], context))

        def scores(of: Recorded) -> dict[str, np.ndarray]:
            found = {}
            for sha, rows in of.rows.items():
                starts = torch.zeros(len(rows), 1, dtype=torch.bool)
                starts[0] = True
                found[sha] = score(torch.from_numpy(rows)[:, None], starts)[
                    :, 0
                ].numpy()
            return found

        true_asked, true_fresh = scores(asked_of), scores(fresh)
        truth = np.array([true_fresh[c.rollout][c.rows].mean() for c in clips])
        for seed in range(cfg.seeds):
            rng = np.random.default_rng([seed, 5])
            pairs: list[Pair] = []
            targets: list[float] = []
            model: RewardModel | None = None
            shares: dict[int, float] = {}
            spent = [0.0, 0.0]
            fit_cfg = (
                replace(STYLE.reward, kind=cfg.kind)
                if cfg.kind == "sparse"
                else FitCfg(kind=cfg.kind, tie_threshold=0.3)
            )
            while len(pairs) < max(cfg.counts):
                start = time.perf_counter()
                new = ask(
                    asked_of.dataset,
                    asked_of.entries,
                    cut,
                    cfg.batch,
                    known=pairs,
                    model=model,
                    round_number=0,
                    uniform_share=0.0 if cfg.kind == "posterior" else 0.2,
                    strategy=cfg.strategy,
                    rng=rng,
                )
                spent[0] += time.perf_counter() - start
                for pair in new:
                    a, b = (
                        true_asked[c.rollout][c.rows].mean() for c in (pair.a, pair.b)
                    )
                    left = float(a > b)
                    targets.append(1 - left if rng.random() < cfg.mistakes else left)
                    pairs.append(pair)
                start = time.perf_counter()
                gathered = replace(
                    gather_pairs([asked_of.dataset], pairs),
                    target=torch.tensor(targets),
                    raters=("simulated",) * len(pairs),
                    recorded=pool,
                )
                if cfg.kind == "posterior" or len(pairs) >= 8:
                    model, _ = fit_reward(
                        gathered, fit_cfg, seed=seed * 1000 + len(pairs), measured=False
                    )
                spent[1] += time.perf_counter() - start
                if len(pairs) in cfg.counts and model is not None:
                    worth = model._returns(model.payer, batch).mean(dim=0).numpy()
                    shares[len(pairs)] = share_of_best(worth, truth, command)
            row = {
                "task": task,
                "seed": seed,
                "shares": shares,
                "ask_s": spent[0] / len(pairs),
                "fit_s": spent[1] / len(pairs),
            }
            print(
                task,
                seed,
                {k: round(v, 2) for k, v in shares.items()},
                f"{row['ask_s']:.2f} {row['fit_s']:.2f} s",
                flush=True,
            )
            with out.open("a") as file:
                file.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main(tyro.cli(FewAnswers))
