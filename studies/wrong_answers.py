"""How often runs are told that their answers do not agree, and how often they should.

`python -m studies.wrong_answers --run RUN [RUN ...]` takes the questions of finished
runs from scratch whose rater was simulated. What the criterion says of them is turned
round at random, for a share of them, and fitted and judged as the loop does after each
of its rounds. With a fifth wrong a run ends well and an alarm is wrong; with two fifths
it does not, and one is right.

Shapes: B answers, T steps, F features.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
import tyro
from rich.console import Console
from rich.table import Table
from torch import Tensor

from data.datasets.dataset import Dataset
from data.files.files import write_atomically
from gaitpref.console.progress import counting_bar
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.run_config import read_config
from gaitpref.method.context import RoundContext
from gaitpref.method.noisy import NoisyAnswers
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from policy.training.checkpoint import load_policy
from rewardmodel.answers.answered_pairs import AnsweredPairs, load_pairs
from rewardmodel.fitting.fit_reward import fit_reward
from rewardmodel.trust.alarms import disagree
from rewardmodel.trust.held_out_report import foresee


@dataclass(frozen=True, kw_only=True)
class Options:
    """Draw answers anew, and count alarms."""

    run: tuple[Path, ...]
    """Finished runs of `gaitpref loop --base none`."""
    wrong: tuple[float, ...] = (0.0, 0.2, 0.4, 0.5)
    """Shares of the answers that are turned round."""
    draws: int = 20
    """Times that answers are drawn, for each run and share."""
    json: Path | None = None
    """Write what was found of every fit here."""


@dataclass(frozen=True, kw_only=True)
class Told:
    """What a fit to answers drawn anew came to."""

    run: str
    wrong: float
    draw: int
    round: int
    """The fit came after it."""
    answers: int
    accuracy: float
    """Share of the held-out answers that is foreseen."""
    opinion: float
    """The same, each counted by how sure the model was."""
    alarm: bool


def true_lead(pairs: AnsweredPairs, run: Path, cfg: LoopCfg) -> Tensor:
    """[B] by how much the criterion of a run prefers the left clips."""
    policy = load_policy(run / "rounds/00/policy/policy.pt")
    context = criterion_context(policy.robot(), policy.info.env)
    score = score_of_criterion(load_criterion(cfg.criterion, context))
    means = []
    for clips in (pairs.left, pairs.right):
        features = clips.features.transpose(0, 1)  # [T, B, F]
        starts = torch.zeros(features.shape[:2], dtype=torch.bool)
        starts[0] = True
        scores = score(features, starts).T * clips.valid
        means.append(scores.sum(dim=1) / clips.valid.sum(dim=1))
    return means[0] - means[1]


def fits(
    pairs: AnsweredPairs, cfg: LoopCfg, run: str, *, wrong: float, draw: int
) -> Iterator[Told]:
    """What is told after each round that trained, of answers as they are."""
    rounds, noisy = torch.tensor(pairs.rounds), None
    for number in range(cfg.rounds):
        known = pairs.subset(rounds <= number)
        context = RoundContext(
            number=number, rounds=cfg.rounds, labels=cfg.labels, noisy=noisy
        )
        settings = cfg.method.fit_of(context)
        model, _ = fit_reward(known, settings, seed=number, measured=False)
        noisy = NoisyAnswers.of(model).noisy if noisy is None else noisy
        found = foresee(model, known, seed=number)
        yield Told(
            run=run,
            wrong=wrong,
            draw=draw,
            round=number,
            answers=len(known),
            accuracy=found.accuracy.share if found.accuracy else 0.5,
            opinion=found.opinion.share if found.opinion else 0.5,
            alarm=disagree(found),
        )


def drawn(run: Path, wrong: Sequence[float], draws: int) -> Iterator[list[Told]]:
    """What is told of a run, for each share and draw."""
    cfg = read_config(run)
    pairs = load_pairs([Dataset.open(run / "dataset")], at_least=0)
    lead = true_lead(pairs, run, cfg)
    for share in wrong:
        for draw in range(draws):
            generator = torch.Generator().manual_seed(draw)
            turned = torch.rand(len(pairs), generator=generator) < share
            target = ((lead > 0) ^ turned).float()
            again = replace(pairs, target=target)
            yield list(fits(again, cfg, run.name, wrong=share, draw=draw))


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> int:
    """Draw, fit, print the table."""
    torch.set_num_threads(1)
    told: list[Told] = []
    total = len(options.run) * len(options.wrong) * options.draws
    with counting_bar("draws", total) as bar:
        for run in options.run:
            for each in drawn(run, options.wrong, options.draws):
                told += each
                bar.advance(bar.task_ids[0])
    Console().print(table_of(told))
    if options.json is not None:
        text = json.dumps([asdict(each) for each in told], indent=1)
        write_atomically(options.json, text.encode())
    return 0


def table_of(told: Sequence[Told]) -> Table:
    """Share of the fits that raise an alarm, by round, and of the runs."""
    rounds = sorted({each.round for each in told})
    table = Table("wrong", *(f"after round {n}" for n in rounds), "in any round")
    for wrong in sorted({each.wrong for each in told}):
        own = [each for each in told if each.wrong == wrong]
        shares = [
            _share([each.alarm for each in own if each.round == n]) for n in rounds
        ]
        runs: dict[tuple[str, int], bool] = {}
        for each in own:
            key = (each.run, each.draw)
            runs[key] = runs.get(key, False) or each.alarm
        table.add_row(f"{wrong:.2f}", *shares, _share(list(runs.values())))
    return table


def _share(alarms: Sequence[bool]) -> str:
    return f"{sum(alarms) / len(alarms):.2f} of {len(alarms)}"


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
