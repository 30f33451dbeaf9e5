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

from .collecting import Collector
from .criteria import Criterion
from .loop_cfg import LoopCfg
from .method.context import RoundContext
from .method.method import Method
from .people import People
from .progress import console
from .rounds import Round, began_from
from .side_by_side import (
    both_policies,
    labels_kept,
    pairs_of_both,
    verdict_of,
)


def verdict_stage(
    method: Method, round: Round, context: RoundContext, dataset: Dataset
) -> None:
    """What the round's answers say of its policy, where they were asked about it."""
    if round.approval.exists() or method.accept is None:
        return
    needed = method.accept.odds_needed(context)
    otherwise = "training goes on from"
    _judge(round, dataset, round.policy, needed, otherwise=otherwise)


def approval_stage(
    cfg: LoopCfg,
    round: Round,
    context: RoundContext,
    dataset: Dataset,
    criterion: Criterion,
    people: People,
) -> None:
    """Have the policy that waits for approval judged; it or the one before it stays."""
    file = round.candidate / POLICY_NAME
    accept = cfg.method.accept
    if round.policy.exists() or not file.exists() or accept is None:
        return
    both = both_policies(cfg.method, round, context)
    with dataset.answers() as store:
        known = store.pairs()
        asked = sum(pair.round == round.number for pair in known)
        if both and not asked:
            pairs = pairs_of_both(cfg, round, dataset, both, known=known)
            asked = store.add_pairs(pairs[: labels_kept(cfg.method, context)])
    collector = Collector(
        cfg=cfg, round=round, dataset=dataset, criterion=criterion, people=people
    )
    collector.answered(asked, last=True)
    # A policy no clip shows, as one whose simulations diverge, is not approved either.
    needed = accept.odds_needed(context)
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
