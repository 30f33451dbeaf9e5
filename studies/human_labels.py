"""What people said of other robots: how well rewards foresee it, ours and Uni-RLHF's.

    python -m studies.human_labels --labels human_label/hopper-medium-replay-v2 \\
        --rows hopper_medium_replay-v2.hdf5

Both learn from the same four fifths of the answers and are asked about the rest, on
several splits. Nothing is downloaded: a file that is missing is named, and where it is
published. Segments overlap now and then, as published; no model profits more than
another.
"""

from __future__ import annotations

import json
import statistics
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table
from torch import Tensor

from data.datasets.segments import Segments, TableAnswer
from data.errors import GaitprefError
from rewardmodel.fitting.tables import TableKind, fit_table
from rewardmodel.measures.calibration import calibration
from rewardmodel.models.prediction import Prediction, as_answered

from .published_labels import labelled_segments
from .published_mlp import EPOCHS, published_leads

Leads = Callable[[Sequence[TableAnswer], Sequence[TableAnswer], int], Tensor]
"""Answers to learn from, answers to foresee, seed; gives logits for the left side."""


@dataclass(frozen=True, kw_only=True)
class HumanLabels:
    """Fit, foresee, compare."""

    labels: Path
    """Directory with the three lists of one task."""
    rows: Path
    """D4RL's HDF5 file of the same task."""
    steps: int | None = None
    """Steps of a segment; by default as a file name says, else 100."""
    kinds: tuple[TableKind, ...] = ("linear", "gp")
    """Our models."""
    splits: int = 5
    """Draws of what is held out."""
    held_out: float = 0.2
    """Share of the answers that is held out."""
    most_epochs: int = EPOCHS
    """Epochs after which Uni-RLHF's network ends at the latest."""
    json: bool = False
    """Print JSON in place of a table."""


@dataclass(frozen=True, kw_only=True)
class Foreseen:
    """How well a model foresees held-out answers, in the mean over splits."""

    model: str
    accuracy: float
    """Share of the preferences, without ties, that it gets right."""
    accuracy_std: float
    """Over splits."""
    ece: float
    """Expected calibration error of the probability that left is better."""
    ece_by_chance: float
    """What a calibrated model would show on so few answers."""
    log_loss: float
    """Mean loss of the preferences, in nats; log 2 is a guess."""
    ties_told: float
    """Probability that a tie has a smaller lead than a preference; half is a guess."""


def foreseen(
    model: str, leads_of: Leads, answers: Sequence[TableAnswer], options: HumanLabels
) -> Foreseen:
    """Measure a model over the splits of `options`.

    Raises:
        GaitprefError: a split leaves nothing to foresee.
    """
    told = []
    for seed in track(range(options.splits), f"{model}", console=_console):
        order = np.random.default_rng(seed).permutation(len(answers))
        kept = round(options.held_out * len(answers))
        asked = [answers[i] for i in order[:kept]]
        fitted = [answers[i] for i in order[kept:]]
        target = torch.tensor([answer.target for answer in asked])
        told.append(_measured(leads_of(fitted, asked, seed), target))
    means = [statistics.fmean(column) for column in zip(*told, strict=True)]
    spread = statistics.pstdev([row[0] for row in told])
    accuracy, ece, by_chance, log_loss, ties = means
    return Foreseen(
        model=model,
        accuracy=accuracy,
        accuracy_std=spread,
        ece=ece,
        ece_by_chance=by_chance,
        log_loss=log_loss,
        ties_told=ties,
    )


def _measured(lead: Tensor, target: Tensor) -> tuple[float, ...]:
    found = calibration(lead, target)
    if found is None:
        raise GaitprefError("no held-out answer prefers a segment: give more answers")
    kept = target != 0.5
    left = target[kept] > 0.5
    right = torch.where(lead[kept] == 0, 0.5, ((lead[kept] > 0) == left).double())
    loss = torch.nn.functional.binary_cross_entropy_with_logits(
        lead[kept].double(), left.double()
    )
    size = lead.abs()
    closer = size[~kept][:, None] - size[kept][None]
    ties = torch.where(closer == 0, 0.5, (closer < 0).double())
    told = float(ties.mean()) if ties.numel() else 0.5
    return float(right.mean()), found.ece, found.ece_by_chance, float(loss), told


def our_leads(segments: Segments, kind: TableKind) -> Leads:
    """A model of ours."""

    def leads(
        fitted: Sequence[TableAnswer], asked: Sequence[TableAnswer], seed: int
    ) -> Tensor:
        reward = fit_table(segments, fitted, kind, seed=seed)
        worth = reward.of_members(segments)  # [M, S]
        sides = torch.tensor([[answer.left, answer.right] for answer in asked]).mT
        of_members = worth[:, sides[0]] - worth[:, sides[1]]
        foreseen = Prediction.of(of_members.mean(dim=0), of_members)
        cooled = foreseen.logit / reward.report.temperature
        return as_answered(cooled, reward.cfg.error_share)

    return leads


def main(
    options: Annotated[HumanLabels, tyro.conf.FlagCreatePairsOff],
) -> list[Foreseen]:
    """Compare, print."""
    segments, answers = labelled_segments(
        options.labels, options.rows, steps=options.steps
    )
    ties = sum(answer.target == 0.5 for answer in answers)
    _console.print(
        f"{len(answers)} answers, {ties / len(answers):.0%} ties, about "
        f"{len(segments.ids)} segments of {segments.rows.shape[1]} steps"
    )
    models: dict[str, Leads] = {
        f"gaitpref {kind}": our_leads(segments, kind) for kind in options.kinds
    }
    models["Uni-RLHF MLP"] = lambda fitted, asked, seed: published_leads(
        segments, fitted, asked, seed=seed, most_epochs=options.most_epochs
    )
    found = [foreseen(name, of, answers, options) for name, of in models.items()]
    if options.json:
        print(json.dumps([asdict(each) for each in found]))
    else:
        Console().print(_table(found))
    return found


def _table(found: Sequence[Foreseen]) -> Table:
    table = Table(
        "model", "accuracy", "calibration error", "by chance", "log loss", "ties told"
    )
    for each in found:
        table.add_row(
            each.model,
            f"{each.accuracy:.3f} ± {each.accuracy_std:.3f}",
            f"{each.ece:.3f}",
            f"{each.ece_by_chance:.3f}",
            f"{each.log_loss:.3f}",
            f"{each.ties_told:.2f}",
        )
    return table


_console = Console(stderr=True)

if __name__ == "__main__":
    try:
        main(tyro.cli(HumanLabels, description=__doc__))
    except GaitprefError as error:
        sys.exit(f"studies.human_labels: {error}")
