"""What each kind of model learns from the same answers.

`python -m benchmarks.kinds --run RUN [RUN ...]` takes finished runs of a simulated
rater, turns a share of the answers round, fits every kind of model to the answers up to
each round, and asks each about pairs nobody was asked about, and to order the policies
of all the runs. The questions are those the run's own model was least sure of.

Shapes: T steps, N episodes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import torch
import tyro
from torch import Tensor

from data.dataset import Dataset
from gaitpref.criteria import load_criterion
from gaitpref.loop_cfg import LoopCfg
from gaitpref.progress import console
from gaitpref.rewards import criterion_context
from gaitpref.run_config import read_config
from policy.checkpoint import load_policy
from rewardmodel.cfg import KindName
from rewardmodel.fit import fit_reward
from rewardmodel.held_out_report import accuracy_of
from rewardmodel.pairs import AnsweredPairs, load_pairs

from .policy_order import Walk, rank_correlation, walks_of
from .preference_fresh import FreshPairs, fresh_pairs


@dataclass(frozen=True, kw_only=True)
class Options:
    """Accuracy of kinds of models, fitted to the answers of finished runs."""

    run: tuple[Path, ...]
    """Runs of `gaitpref loop` with a simulated rater, all of one criterion."""
    kinds: tuple[KindName, ...] = ("linear", "sparse", "gp")
    """Models to fit."""
    draws: int = 1
    """Fits of each model to the same answers."""
    mistakes: tuple[float, ...] = (0.0,)
    """Shares of the answers that are turned round, beside what the rater got wrong."""
    seed: int = 0
    """Of the fits, and which answers are turned round."""


@dataclass(frozen=True, kw_only=True)
class Learned:
    """What one model learned."""

    answers: int
    mistakes: float
    kind: KindName
    error_share: float
    """Of the answers, as the fit found it."""
    held_out: float | None
    """Share of the held-out preferences foreseen."""
    fresh: float | None
    """The same of pairs nobody was asked about."""
    order: float
    """Rank correlation of what it pays policies with how good they are."""
    mean_order: float
    """The same of the plain mean over its members, which is another in a sum of
    curves."""


def learned(run: Path, walks: list[Walk], options: Options) -> Iterator[Learned]:
    """Every kind's result on the answers of one run."""
    cfg = read_config(run)
    dataset = Dataset.open(run / "dataset")
    policy = load_policy(run / "rounds/00/policy/policy.pt")
    context = criterion_context(policy.robot(), policy.info.env)
    fresh = fresh_pairs(run, cfg, load_criterion(cfg.criterion, context))
    pairs = load_pairs([dataset])
    rounds = torch.tensor(pairs.rounds)
    seeds = range(options.seed, options.seed + options.draws)
    for last in rounds.unique():
        some = pairs.subset(rounds <= last)
        for mistakes in options.mistakes:
            asked = turned_round(some, mistakes, seed=options.seed)
            for kind, seed in product(options.kinds, seeds):
                yield _fitted(asked, kind, mistakes, cfg, fresh, walks, seed)


def _fitted(
    pairs: AnsweredPairs,
    kind: KindName,
    mistakes: float,
    cfg: LoopCfg,
    fresh: FreshPairs,
    walks: list[Walk],
    seed: int,
) -> Learned:
    model, report = fit_reward(pairs, replace(cfg.fit, kind=kind), seed=seed)
    accuracy = accuracy_of(fresh.leads(model), fresh.target)

    def mean(features: Tensor, starts: Tensor) -> Tensor:
        return model.members(features, starts).mean(dim=0)

    return Learned(
        answers=len(pairs),
        mistakes=mistakes,
        kind=kind,
        error_share=model.provenance.cfg.error_share,
        held_out=report.held_out_accuracy,
        fresh=accuracy.share if accuracy else None,
        order=rank_correlation(walks, model),
        mean_order=rank_correlation(walks, mean),
    )


def turned_round(pairs: AnsweredPairs, share: float, *, seed: int) -> AnsweredPairs:
    """`pairs` with each answer turned round with probability `share`."""
    rng = torch.Generator().manual_seed(seed)
    wrong = torch.rand(len(pairs), generator=rng) < share
    return replace(pairs, target=torch.where(wrong, 1 - pairs.target, pairs.target))


def main(options: Options) -> int:
    """Print a line for every fit."""
    torch.set_num_threads(1)
    walks = walks_of(options.run)
    for run in options.run:
        console.print(
            f"{run.name}: answers, turned round, model, held out, fresh, order of "
            f"{len(walks)} policies by what is paid and by the members' mean"
        )
        for found in learned(run, walks, options):
            shares = (found.held_out, found.fresh, found.order, found.mean_order)
            told = ("-" if share is None else f"{share:.2f}" for share in shares)
            console.print(
                f"  {found.answers:4d}  {found.mistakes:4.2f}  {found.kind:11s}  "
                f"{'  '.join(told)}  (errors found: {found.error_share:g})"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, description=__doc__)))
