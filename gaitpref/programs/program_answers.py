"""A program answers the open pairs of a data set."""

from __future__ import annotations

import time
import uuid

import numpy as np

from data.answers.answer_records import Answer, Choice, Pair, Side, now_utc
from data.answers.typed_text import plain_text
from data.datasets.dataset import Dataset
from data.datasets.gone import listed_in
from data.files.limits import NOTE_CHARS
from gaitpref.console.progress import counting_bar
from gaitpref.raters.simulated import RATER_NAMESPACE

from .function_rater import function_of, function_rater
from .program_cfg import ProgramCfg, ReachCfg
from .seen_pair import ProgramRater, Verdict, seen_pair
from .vision_rater import vision_rater

FACTS = "program"
"""Where an answer's `client` has what a program's answer took."""


def program_rater(cfg: ProgramCfg, reach: ReachCfg) -> ProgramRater:
    """The program that its user named; a function's module is imported, which runs it.

    Raises:
        ProgramError: there is none, or it may not be reached.
    """
    if cfg.url is None:
        return function_rater(cfg.name, function_of(cfg.name))
    return vision_rater(cfg, reach)


def answer_by_program(
    dataset: Dataset,
    rate: ProgramRater,
    cfg: ProgramCfg,
    *,
    seed: int,
    round: int | None = None,
    most: int | None = None,
) -> int:
    """Have every pair answered that the program has not answered yet; gives how many.

    Each answer is on the disk before the next question, so that nothing is asked twice
    after a kill. Pairs whose episode is gone are left open.

    Args:
        dataset: Holds the pairs.
        rate: The program.
        cfg: What it is called.
        seed: Which clip of a pair is on the left.
        round: Only pairs of this round.
        most: Not more than so many.

    Raises:
        GaitprefError: it cannot be asked on; what it answered is kept.
    """
    with dataset.answers() as store:
        store.add_rater(cfg.rater_id, "model", _info(cfg))
        listed = listed_in([dataset])
        pairs = [p for p in store.unanswered(cfg.rater_id, round=round) if listed(p)]
        pairs = pairs[:most]
        with counting_bar("answers", len(pairs)) as bar:
            for pair in pairs:
                store.add_answer(_answer(dataset, rate, cfg, pair, seed))
                bar.advance(bar.task_ids[0])
        return len(pairs)


def _info(cfg: ProgramCfg) -> dict[str, str]:
    told = {"program": cfg.name, "model": cfg.model, "wish": cfg.wish}
    return {name: value for name, value in told.items() if value}


def _answer(
    dataset: Dataset, rate: ProgramRater, cfg: ProgramCfg, pair: Pair, seed: int
) -> Answer:
    answer_id = uuid.uuid5(RATER_NAMESPACE, f"{pair.pair_id} {cfg.rater_id}")
    rng = np.random.default_rng([seed, answer_id.int % 2**32])
    shown_left: Side = "a" if rng.random() < 0.5 else "b"
    began_s = time.monotonic()
    verdict = rate(seen_pair(dataset, pair, shown_left))
    took_s = time.monotonic() - began_s
    return Answer(
        answer_id=str(answer_id),
        pair_id=pair.pair_id,
        rater_id=cfg.rater_id,
        choice=_choice(verdict, shown_left),
        shown_left=shown_left,
        response_ms=round(1000 * took_s),
        note=plain_text(verdict.reason)[:NOTE_CHARS],
        client={FACTS: {"questions": 1, "seconds": round(took_s, 3)} | verdict.facts},
        created_utc=now_utc(),
    )


def _choice(verdict: Verdict, shown_left: Side) -> Choice:
    match verdict.word:
        case "left":
            return shown_left
        case "right":
            return "b" if shown_left == "a" else "a"
        case word:
            return word
