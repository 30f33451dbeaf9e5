"""How sure a reward may be of pairs, with and without the quarrels of its members.

`python -m benchmarks.sureness --run RUN [RUN ...]` takes finished runs of a simulated
rater, fits a reward to each run's answers, finds a temperature on the held-out ones,
and asks both about pairs nobody was asked about. Once a lead says all; once the spread
of the members' leads counts too (`rewardmodel.prediction`); and once, as it is, the
temperature is found on questions drawn at random most (`calibration.counting`).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro

from gaitpref.criteria import load_criterion
from gaitpref.progress import console
from gaitpref.rewards import criterion_context
from gaitpref.run_config import read_config
from policy.checkpoint import load_policy
from rewardmodel.calibration import Calibration, calibration, counting, fit_temperature
from rewardmodel.fit import fit_reward
from rewardmodel.held_out import held_out_predictions
from rewardmodel.kinds import prepare
from rewardmodel.noise_level import takes_to_err

from .choosing import answers_of
from .preference_fresh import fresh_pairs


@dataclass(frozen=True, kw_only=True)
class Options:
    """Calibration of rewards fitted to the answers of finished runs."""

    run: tuple[Path, ...]
    """Runs of `gaitpref loop` with a simulated rater."""
    seed: int = 0
    """Of the fits."""


@dataclass(frozen=True, kw_only=True)
class Sureness:
    """How well probabilities hold that were made in one way."""

    way: str
    temperature: float
    held_out: Calibration | None
    """On the answers the temperature was found on."""
    fresh: Calibration | None
    """On pairs nobody was asked about, answered by the run's rater."""


def sureness(run: Path, *, seed: int) -> Iterator[Sureness]:
    """All ways, for one run."""
    cfg = read_config(run)
    policy = load_policy(run / "rounds/00/policy/policy.pt")
    context = criterion_context(policy.robot(), policy.info.env)
    fresh = fresh_pairs(run, cfg, load_criterion(cfg.criterion, context))
    last = cfg.rounds - 1
    pairs = answers_of(run, last)
    model, _ = fit_reward(pairs, cfg.fit_of(last), seed=seed, measured=False)
    found = model.provenance.cfg
    prepared = prepare(pairs, found)
    asked, held_out = held_out_predictions(prepared, pairs.episodes, found, seed)
    of_fresh = model.prediction(fresh.left, fresh.right)
    alike = torch.ones(len(held_out.lead))
    target = prepared.described.target[asked]
    counts = counting(pairs.at_random[asked], target, erring=takes_to_err(found))
    for way, known, new, weights in (
        ("by lead", held_out.lead, of_fresh.lead, alike),
        ("with spread", held_out.logit, of_fresh.logit, alike),
        ("as it is", held_out.logit, of_fresh.logit, counts),
    ):
        temperature = fit_temperature(known, target, weights)
        yield Sureness(
            way=way,
            temperature=temperature,
            held_out=calibration(known / temperature, target, weights),
            fresh=fresh.calibration(new / temperature),
        )


def main(options: Options) -> int:
    """Print three lines for every run."""
    torch.set_num_threads(1)
    console.print(
        "calibration error on held-out answers, as they count, and on fresh pairs; "
        "temperature"
    )
    for run in options.run:
        for found in sureness(run, seed=options.seed):
            errors = (found.held_out, found.fresh)
            told = ("-" if part is None else f"{part.ece:.3f}" for part in errors)
            console.print(
                f"{run.name:40s}  {found.way:11s}  {'  '.join(told)}"
                f"  {found.temperature:.2f}"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, description=__doc__)))
