"""The two stages of a round that ask: choose its pairs, and have them answered."""

from __future__ import annotations

import json
import time

import numpy as np

from data.answers import AnswerStore
from data.dataset import Dataset
from rewardmodel.pairs import MIN_ANSWERS, count_evidence
from rewardmodel.storage import load_reward

from .criteria import Criterion
from .people import People
from .progress import console, counting_bar
from .questions import ask, with_known_answer
from .rater import answer_pairs
from .rounds import Round, seed_of
from .run_config import LoopCfg

RATER_ID = "simulated"
GOLD_SHARE = 0.05
"""Pairs with a known answer to every pair that people are asked."""
_POLL_S = 0.5


def pairs_stage(cfg: LoopCfg, round: Round, dataset: Dataset) -> None:
    """Add the round's questions, most of them where the ensemble disagrees."""
    with dataset.answers() as store:
        if store.pairs(round=round.number):
            return
    _add_pairs(cfg, round, dataset, cfg.labels_of(round.number))


def _add_pairs(cfg: LoopCfg, round: Round, dataset: Dataset, count: int) -> None:
    with dataset.answers() as store:
        known = store.pairs()
    model = load_reward(round.before.reward) if round.number else None
    names = set(json.loads(round.recorded.read_text()))
    entries = [entry for entry in dataset.entries() if entry.sha256 in names]
    # More pairs for the same round are others, even after a restart.
    asked_before = sum(pair.round == round.number for pair in known)
    rng = np.random.default_rng([seed_of(cfg, round.number, 3), asked_before])
    chosen = ask(
        dataset,
        entries,
        cfg.clips,
        count,
        known=known,
        model=model,
        round_number=round.number,
        uniform_share=cfg.uniform_share,
        rng=rng,
    )
    if cfg.rater == "human":
        chosen += with_known_answer(
            entries,
            cfg.clips,
            -int(-GOLD_SHARE * count // 1),
            known=[*known, *chosen],
            round_number=round.number,
            rng=rng,
        )
    with dataset.answers() as store:
        store.add_pairs(chosen)


def answers_stage(
    cfg: LoopCfg, round: Round, dataset: Dataset, criterion: Criterion, people: People
) -> None:
    """Have the round's questions answered."""
    if round.reward.exists():
        return
    if cfg.rater == "simulated":
        answer_pairs(
            dataset,
            criterion,
            rater_id=RATER_ID,
            seed=seed_of(cfg, round.number, 4),
            round=round.number,
        )
        return
    wait_for_people(cfg, round, dataset, people)


def wait_for_people(
    cfg: LoopCfg, round: Round, dataset: Dataset, people: People
) -> None:
    """Wait until every pair of the round has an answer, or patience is over.

    Either way there are answers enough to fit when this returns: where too many are
    "can't tell" or "bad clip", more pairs are asked.

    Raises:
        GaitprefError: the page is gone.
    """
    since = time.monotonic()
    title = f"round {round.number}: answers"
    with dataset.answers() as store, counting_bar(title, 0) as bar:
        console.print(f"round {round.number}: waiting for answers to {dataset.root}")
        while True:
            people.require_page()
            asked, left = _asked_and_left(store, round.number)
            bar.update(bar.task_ids[0], total=asked, completed=asked - left)
            waited_s = time.monotonic() - since
            wanted = left
            if left == 0 or waited_s >= people.patience_s:
                wanted = MIN_ANSWERS - count_evidence(store)
                if wanted <= 0:
                    break
                if wanted > left:
                    _add_pairs(cfg, round, dataset, wanted - left)
            people.tell(
                f"round {round.number + 1} of {cfg.rounds}: waiting for {wanted} more "
                f"answer{'s' * (wanted != 1)}",
                (asked - left) / asked,
            )
            time.sleep(_POLL_S)
    if left:
        console.print(
            f"round {round.number}: going on after {waited_s / 60:.1f} minutes, "
            f"{left} of {asked} pairs are still open; their answers count later"
        )


def _asked_and_left(store: AnswerStore, round: int) -> tuple[int, int]:
    """Pairs of a round, and those nobody answered; a known answer is not waited for."""
    asked = [pair for pair in store.pairs(round=round) if pair.gold is None]
    left = [pair for pair in store.unanswered(round=round) if pair.gold is None]
    return len(asked), len(left)
