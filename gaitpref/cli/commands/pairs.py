"""`gaitpref pairs`: with a data set and torch alone.

No simulator is imported here, as in `fit_command`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data.answers.answer_records import Pair
from data.datasets.gone import pairs_gone
from data.errors import GaitprefError
from gaitpref.cli.options import options
from gaitpref.cli.shared.by_hand import METHODS
from gaitpref.cli.shared.dataset_argument import open_dataset
from gaitpref.cli.shared.next_of_answers import next_answers
from gaitpref.console.progress import console, counted
from gaitpref.method.questions import Questions
from rewardmodel.asking.clip_questions import ClipCfg, ask, with_known_answer
from rewardmodel.asking.strategies import make_strategy
from rewardmodel.asking.visible import Visible
from rewardmodel.models.model import RewardModel
from rewardmodel.models.storage import load_reward

FEW = 0.8
"""Share of pairs that differ visibly, below which it is said what helps."""
_AT_ONCE = (
    "they were drawn at random; a loop chooses the next by what answers so far leave "
    "open"
)
_MORE = (
    "the others are hard to tell apart: record other postures and rhythms as well "
    "(`gaitpref record --method style`, or `--varied 0.5`), or more policies"
)

_MORE_OF_TEAMS = (
    "the others are hard to tell apart: record teams with a robot that is lazy now and "
    "then (`gaitpref team record --lazy 0.5`), or of more policies"
)


def run(command: options.Pairs) -> int:
    """Run the command; gives the exit code."""
    if command.method is not None and command.strategy is not None:
        raise GaitprefError(
            f"--strategy beside --method {command.method}: the method decides that; "
            "leave one of the two out"
        )
    dataset = open_dataset(command)
    model = None if command.reward is None else load_reward(command.reward)
    cut, rng = ClipCfg.of(command.clip_s), np.random.default_rng(command.seed)
    with dataset.answers() as store, counted("choosing what to ask, clips") as tell:
        visible = Visible(dataset, command.apart, tell)
        known = store.pairs()
        round = max((pair.round for pair in known), default=-1) + 1
        chosen = _chosen(command, visible, model, cut, known, round, rng)
        gold = with_known_answer(
            dataset.entries(),
            cut,
            command.gold,
            known=[*known, *chosen],
            round_number=round,
            rng=rng,
        )
        added = store.add_pairs([*chosen, *gold])
        told, share = visible.told_of(chosen), visible.share(chosen)
    of_these = f", {len(gold)} of them with a known answer" if command.gold else ""
    console.print(f"{added} pairs were added to {command.dataset}{of_these}")
    if command.strategy is None and model is None:
        console.print(_AT_ONCE)
    elif command.method is not None and command.count > _asked_by(command).batch:
        console.print(
            f"a loop asks {_asked_by(command).batch} at a time, and fits a reward to "
            "the answers before the next"
        )
    console.print(told)
    if share < FEW:
        teams = any(entry.meta.is_team for entry in dataset.entries())
        console.print(_MORE_OF_TEAMS if teams else _MORE)
    if gone := pairs_gone(dataset):
        console.print(gone)
    console.next(next_answers(dataset, command.answers))
    return 0


def _chosen(
    command: options.Pairs,
    visible: Visible,
    model: RewardModel | None,
    cut: ClipCfg,
    known: Sequence[Pair],
    round: int,
    rng: np.random.Generator,
) -> list[Pair]:
    own = _asked_by(command)
    strategy = command.strategy or ("uniform" if model is None else own.strategy)
    # Refused before anything is chosen at random instead.
    dataset = visible.dataset
    make_strategy(strategy, model, dataset.clip_features)
    return ask(
        dataset,
        dataset.entries(),
        cut,
        command.count,
        known=known,
        model=model,
        round_number=round,
        uniform_share=0.0 if command.strategy else own.uniform_share,
        strategy=strategy,
        told_apart=visible if visible.least > 0 else None,
        rng=rng,
    )


def _asked_by(command: options.Pairs) -> Questions:
    """How pairs are chosen: as from scratch, where nobody says otherwise."""
    return METHODS[command.method or "scratch"].questions
