"""Whether the loop may believe its reward, judged every round.

Shapes: T steps, N episodes, F feature columns.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from data.datasets.dataset import Dataset
from data.files.files import read_json
from gaitpref.console.progress import counted
from gaitpref.report.findings import about_raters
from gaitpref.report.trust_json import alarm_json, as_json
from rewardmodel.answers.answered_pairs import AnsweredPairs, load_pairs
from rewardmodel.models.storage import load_reward
from rewardmodel.trust.alarms import alarms, disagree, prefers, reach, unforeseen_sides
from rewardmodel.trust.held_out_report import Foreseen, foresee

from .loop_cfg import LoopCfg
from .run_dir import Round, seed_of

_JUDGED = 4
"""Answers about the clips of a policy from which on it was judged."""


def deserves_training(round: Round) -> bool:
    """Whether the reward of a finished round may be trained on."""
    return bool(_trust_in(round).get("deserves_training", True))


def why_not_trained(round: Round) -> str:
    """What the answers do, where the reward of a finished round may not be."""
    if _trust_in(round).get("too_little"):
        return "prefer too little"
    return "do not agree"


def _trust_in(round: Round) -> dict[str, Any]:
    return read_json(round.report).get("trust", {})


def trust_of_round(
    cfg: LoopCfg,
    round: Round,
    dataset: Dataset,
    features: Tensor,
    lengths: Tensor,
    *,
    return_rose: bool,
) -> dict[str, Any]:
    """What a round's report says of trust.

    Args:
        cfg: The loop.
        round: Its newest round.
        dataset: With the answers so far.
        features: [T, N, F] of the round's policy without exploration noise.
        lengths: [N] of its episodes.
        return_rose: Whether training raised the learned return.
    """
    pairs = load_pairs([dataset], at_least=0, unchecked=cfg.unchecked)
    before = judged_before(pairs, round)
    reached, foreseen = None, None
    found: dict[str, Any] = {"confirmed": False}
    if before is not None:
        trained_on = load_reward(round.before.reward)
        reached = reach(trained_on, before, features, lengths)
    too_little = pairs.too_little if round.reward.exists() else ""
    if round.reward.exists() and not too_little:
        model = load_reward(round.reward)
        title = f"round {round.number}: foreseeing {len(pairs)} answers, models"
        with counted(title) as tell:
            foreseen = foresee(
                model, pairs, seed=seed_of(cfg, round.number, 5), tell=tell
            )
        found["raters"] = about_raters(model.provenance.report, pairs.sides)
        if before is not None and was_judged(foreseen):
            found["confirmed"] = prefers(model, features, lengths, before)
    if round.verdict.exists():
        # Surely better by the answers alone is liked, wherever it went.
        found["confirmed"] |= read_json(round.verdict)["word"] == "better"
    distrusted = foreseen is not None and (
        disagree(foreseen) or bool(unforeseen_sides(foreseen, pairs.sides))
    )
    reasons = alarms(
        foreseen,
        reached,
        return_rose=return_rose,
        confirmed=found["confirmed"],
        sides=pairs.sides if foreseen else (),
    )
    if too_little:
        found["too_little"] = too_little
        reasons = (f"{too_little}: it is 0, and trained on by nobody", *reasons)
    found["deserves_training"] = not (distrusted or too_little)
    return as_json(foreseen, reached) | found | alarm_json(reasons)


def was_judged(foreseen: Foreseen) -> bool:
    """Whether enough answers about the newest round's clips say what they are worth."""
    newest = foreseen.newest
    return newest is not None and newest.answers >= _JUDGED


def judged_before(pairs: AnsweredPairs, round: Round) -> AnsweredPairs | None:
    """The answers that the reward of the round before was fitted to; None where there
    was none."""
    earlier = torch.tensor(pairs.rounds) < round.number
    return pairs.subset(earlier) if earlier.any() else None
