"""What one rater who does not look costs, and whether that one is found out.

`python -m benchmarks.raters --run RUN [RUN ...]` takes finished runs of a simulated
rater, gives their answers to several, has one of these answer at random or always left
instead, and fits a reward to all: with the raters judged, with all taken to be alike,
and without the one who does not look. Each is asked about pairs nobody was asked about.

Shapes: B answers.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

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
from rewardmodel.cfg import ReliabilityCfg
from rewardmodel.fit import fit_reward
from rewardmodel.held_out_report import accuracy_of
from rewardmodel.pairs import AnsweredPairs, load_pairs

from .kinds import turned_round
from .preference_fresh import FreshPairs, fresh_pairs

How = Literal["random", "left", "looking"]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Rewards fitted to the answers of several raters, one of whom does not look."""

    run: tuple[Path, ...]
    """Runs of `gaitpref loop` with a simulated rater."""
    how: How = "random"
    """What the one answers: as chance has it, always left, or like the others."""
    raters: int = 2
    """How many there are."""
    share: float = 0.4
    """Of the answers, that the one gives; the others share the rest."""
    mistakes: float = 0.0
    """Share of the answers of who looks that are turned round, beside what the rater of
    the run got wrong."""
    draws: int = 3
    """Times the answers of each run are given out."""

    def __post_init__(self) -> None:
        if self.raters < 2 or not 0.0 < self.share < 1.0 or self.draws < 1:
            raise ValueError(
                "raters must be at least 2, share in (0, 1) and draws at least 1, got "
                f"{self.raters}, {self.share} and {self.draws}"
            )


@dataclass(frozen=True, kw_only=True)
class Learned:
    """What came of one draw."""

    shares: tuple[float, ...]
    """Of the answers of each rater, taken for random; the one's first."""
    judged: float
    """Share of fresh preferences foreseen, the raters judged."""
    alike: float
    """The same where all are taken to be alike."""
    without: float
    """The same from the others' answers alone."""


def given_out(
    pairs: AnsweredPairs, options: Options, *, seed: int
) -> tuple[AnsweredPairs, Tensor]:
    """`pairs` of several raters, and which answers [B] are those of the one."""
    rng = torch.Generator().manual_seed(seed)
    drawn = torch.rand(len(pairs), generator=rng)
    chance = (torch.rand(len(pairs), generator=rng) < 0.5).float()
    one = drawn < options.share
    other = torch.randint(1, options.raters, (len(pairs),), generator=rng)
    raters = torch.where(one, 0, other).tolist()
    said = {"random": chance, "left": torch.ones_like(chance), "looking": pairs.target}
    target = torch.where(one, said[options.how], pairs.target)
    names = tuple(f"rater {rater}" for rater in raters)
    return replace(pairs, target=target, raters=names), one


def learned(run: Path, options: Options) -> Iterator[tuple[int, Learned]]:
    """Answers of a run, and what came of each draw."""
    cfg, pairs = read_config(run), load_pairs([Dataset.open(run / "dataset")])
    policy = load_policy(run / "rounds/00/policy/policy.pt")
    context = criterion_context(policy.robot(), policy.info.env)
    fresh = fresh_pairs(run, cfg, load_criterion(cfg.criterion, context))
    for seed in range(options.draws):
        # Another seed than that of who answers what: mistakes are everybody's.
        meant = turned_round(pairs, options.mistakes, seed=options.draws + seed)
        answers, one = given_out(meant, options, seed=seed)
        judged, shares = _foreseen(answers, cfg, fresh)
        alike, _ = _foreseen(answers, cfg, fresh, judging=False)
        without, _ = _foreseen(answers.subset(~one), cfg, fresh, judging=False)
        found = Learned(shares=shares, judged=judged, alike=alike, without=without)
        yield len(pairs), found


def _foreseen(
    pairs: AnsweredPairs, cfg: LoopCfg, fresh: FreshPairs, *, judging: bool = True
) -> tuple[float, tuple[float, ...]]:
    """Share of fresh preferences foreseen, and each rater's share of random answers."""
    fit = cfg.fit_of(cfg.rounds - 1)
    fit = replace(fit, reliability=ReliabilityCfg(enabled=judging))
    model, report = fit_reward(pairs, fit, seed=0, measured=False)
    accuracy = accuracy_of(fresh.leads(model), fresh.target)
    if accuracy is None:
        raise ValueError("the criterion prefers no clip to another")
    return accuracy.share, tuple(share for _, share in report.raters)


def main(options: Options) -> int:
    """Print a line for every draw, and means of all."""
    torch.set_num_threads(1)
    console.print(
        f"one of {options.raters} raters answers {options.share:.0%} of the questions "
        f"({options.how}): answers, shares taken for random, foreseen with raters "
        "judged, all alike, without the one"
    )
    found: list[Learned] = []
    for run in options.run:
        for answers, each in learned(run, options):
            found.append(each)
            shares = " ".join(f"{share:.2f}" for share in each.shares)
            console.print(f"{run.name}  {answers:4d}  {shares}  {_told(each)}")
    mean = Learned(
        shares=(),
        judged=sum(each.judged for each in found) / len(found),
        alike=sum(each.alike for each in found) / len(found),
        without=sum(each.without for each in found) / len(found),
    )
    console.print(f"mean of {len(found)}  {_told(mean)}")
    return 0


def _told(found: Learned) -> str:
    return f"{found.judged:.2f}  {found.alike:.2f}  {found.without:.2f}"


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options)))
