"""What the answers of a run could tell at most, in bits.

`python -m benchmarks.answer_bits --run RUN ...` takes runs of a simulated rater. A
choice between two clips is one bit where the rater never errs, and 1 - H(p) where it is
wrong with probability p (the capacity of a binary symmetric channel, Shannon 1948,
theorem 12): less the oftener, and next to nothing between clips that are worth the
same. So runs can be compared whose raters err in different ways.

Shapes: B answers.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray

from data.dataset import Dataset
from gaitpref.criteria import load_criterion
from gaitpref.progress import console
from gaitpref.rater import ClipScores
from gaitpref.rater_cfg import RaterCfg
from gaitpref.rewards import criterion_context
from gaitpref.rounds import Round
from gaitpref.run_config import read_config
from policy.checkpoint import load_policy

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Bits in the answers of finished runs."""

    run: tuple[Path, ...]
    """Runs of `gaitpref loop` with a simulated rater who neither skips nor ties."""


@dataclass(frozen=True, eq=False)
class Choices:
    """The choices of a run, in the order of its rounds."""

    rounds: NDArray[np.int64]
    """[B]"""
    leads: Array
    """[B] of the clip that was chosen, in mean score under the criterion."""

    def wrong(self, cfg: RaterCfg) -> Array:
        """Probability [B] that the rater takes the worse clip.

        Its unit of a lead is the median over the pairs asked by then.
        """
        sizes = np.abs(self.leads)
        chance = np.zeros(len(sizes))
        if np.isfinite(cfg.beta):
            for number in np.unique(self.rounds):
                typical = np.median(sizes[self.rounds <= number])
                own = self.rounds == number
                chance[own] = 1 / (1 + np.exp(cfg.beta * sizes[own] / typical))
        return chance * (1 - cfg.mistakes) + (1 - chance) * cfg.mistakes


def choices_of(run: Path) -> tuple[Choices, RaterCfg]:
    """What a run's rater chose, and how it errs.

    Raises:
        ValueError: the rater is a person, forgets, skips or has ties.
    """
    cfg = read_config(run)
    rater = cfg.simulated
    if cfg.rater != "simulated" or (rater.gamma, rater.skip, rater.equal) != (1, 0, 0):
        raise ValueError(f"{run}: give runs of a simulated rater who always chooses")
    policy = load_policy(Round(run, 0).policy)
    context = criterion_context(policy.robot(), policy.info.env)
    dataset = Dataset.open(run / "dataset")
    scores = ClipScores(dataset.features, load_criterion(cfg.criterion, context))
    with dataset.answers() as store:
        answers = store.current_answers()
    rounds, leads = [], []
    for pair, answer in answers:
        if answer.choice in ("a", "b") and pair.round is not None:
            lead = float(scores(pair.a).mean() - scores(pair.b).mean())
            rounds.append(pair.round)
            leads.append(lead if answer.choice == "a" else -lead)
    return Choices(np.array(rounds), np.array(leads)), rater


def bits(wrong: Array) -> Array:
    """What choices tell [B] that are wrong with probabilities [B]."""
    right = 1 - wrong
    logs = [np.log2(p, where=p > 0, out=np.zeros(len(p))) for p in (wrong, right)]
    return 1 + wrong * logs[0] + right * logs[1]


def main(options: Options) -> int:
    for run in options.run:
        choices, rater = choices_of(run)
        told = bits(choices.wrong(rater))
        rounds = [
            f"{told[choices.rounds == n].sum():.1f} of {(choices.rounds == n).sum()}"
            for n in np.unique(choices.rounds)
        ]
        console.print(
            f"{run.name}: {told.sum():.1f} bits in {len(told)} answers, "
            f"{(choices.leads < 0).mean():.2f} of them wrong; by round "
            f"{', '.join(rounds)}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
