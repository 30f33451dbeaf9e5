"""Questions that were answered, and are asked again because the answer looks wrong."""

from __future__ import annotations

from collections.abc import Sequence

from data.answers import Pair
from data.dataset import Dataset
from rewardmodel.acquisition import AGAIN
from rewardmodel.errors import RewardError
from rewardmodel.extensions.label_filter import likelihoods
from rewardmodel.kinds import kind_called, prepare
from rewardmodel.model import RewardModel
from rewardmodel.pairs import load_pairs, pairs_behind
from rewardmodel.reliability import judge


def ask_again(
    dataset: Dataset,
    count: int,
    *,
    known: Sequence[Pair],
    model: RewardModel,
    round_number: int,
    seed: int,
) -> list[Pair]:
    """The `count` pairs of `known` whose answers look most wrong, with their sides
    swapped.

    An answer looks wrong to a reward like `model` that was fitted to others. Swapped,
    a pair is a new question to every rater, and its answers count beside the old ones;
    no pair is asked more than twice.

    Raises:
        RewardError: not so many pairs were answered, and asked once only.
    """
    cfg = model.provenance.cfg
    answered, asked = load_pairs([dataset]), pairs_behind([dataset])
    taken = {(pair.a, pair.b) for pair in known}
    by_curves = kind_called(cfg.kind).by_curves
    judged = judge(prepare(answered, cfg), answered.raters, cfg, by_curves=by_curves)
    likely = likelihoods(judged.prepared, cfg, seed=seed)
    chosen: dict[str, Pair] = {}
    for row in likely.argsort(stable=True).tolist():
        pair = asked[row]
        if len(chosen) == count:
            break
        if (pair.b, pair.a) in taken:
            continue
        info = {"again": pair.pair_id, "likelihood": round(float(likely[row]), 4)}
        swapped = Pair.make(
            pair.b, pair.a, strategy=AGAIN, round=round_number, info=info
        )
        chosen.setdefault(pair.pair_id, swapped)
    if len(chosen) < count:
        raise RewardError(
            f"{dataset.root}: {len(chosen)} answered pairs can be asked again, {count} "
            "are wanted: a pair is asked twice at most; ask for fewer, or about new "
            "pairs with another --strategy"
        )
    return list(chosen.values())
