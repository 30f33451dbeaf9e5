"""Which policy stays: the new one, or the one it was to better."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path

from data.dataset import Dataset
from data.files import read_file, replace_directory, write_atomically
from data.limits import POLICY_BYTES
from policy.train import POLICY_NAME

from .asking import Patience, answered
from .criteria import Criterion
from .loop_cfg import LoopCfg
from .people import People
from .progress import console
from .rounds import Round, began_from
from .side_by_side import (
    both_policies,
    first_erred,
    labels_kept,
    pairs_of_both,
    verdict_of,
)

ODDS_BEFORE = 10.0
"""That a new policy is better before anybody is asked: 22 of 24 were."""
ODDS_TO_GO_ON, ODDS_TO_STAY = 1.0 / ODDS_BEFORE, 3.0 / ODDS_BEFORE
"""How much likelier than not answers alone must make it that a new policy is better:
for the next training to begin from it, and to be the last one where answers err."""


def verdict_stage(round: Round, dataset: Dataset) -> None:
    """What the round's answers say of its policy, where they were asked about it."""
    if not round.approval.exists():
        _judge(
            round,
            dataset,
            round.policy,
            ODDS_TO_GO_ON,
            otherwise="training goes on from",
        )


def approval_stage(
    cfg: LoopCfg, round: Round, dataset: Dataset, criterion: Criterion, people: People
) -> None:
    """Have the policy that waits for approval judged; it or the one before it stays."""
    file = round.candidate / POLICY_NAME
    if round.policy.exists() or not file.exists():
        return
    both = both_policies(cfg, round, dataset)
    with dataset.answers() as store:
        known = store.pairs()
        asked = sum(pair.round == round.number for pair in known)
        if both and not asked:
            pairs = pairs_of_both(cfg, round, dataset, both, known=known)
            asked = store.add_pairs(pairs[: labels_kept(cfg, round, dataset)])
    answered(cfg, round, dataset, criterion, Patience(people), asked, last=True)
    # A policy no clip shows, as one whose simulations diverge, is not approved either.
    needed = ODDS_TO_STAY if first_erred(round) else ODDS_TO_GO_ON
    if _judge(round, dataset, file, needed, otherwise="what stays is"):
        replace_directory(round.candidate, round.policy.parent)
        return
    partial = round.root / "policy.partial"
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    write_atomically(partial / POLICY_NAME, read_file(began_from(round), POLICY_BYTES))
    replace_directory(partial, round.policy.parent)


def _judge(
    round: Round, dataset: Dataset, new: Path, needed: float, *, otherwise: str
) -> bool:
    """Write down what the answers say of the policy file `new`, if asked; whether they
    approve it."""
    verdict = verdict_of(round, dataset, new, needed=needed)
    if verdict is None:
        return False
    console.print(
        f"round {round.number}: the new policy is preferred to the one before in "
        f"{verdict.for_new} of {verdict.for_new + verdict.for_old} answers"
        + ("" if verdict.approved else f"; {otherwise} the one before")
    )
    found = {**asdict(verdict), "odds": verdict.odds, "approved": verdict.approved}
    write_atomically(round.approval, json.dumps(found, indent=1).encode())
    return verdict.approved
