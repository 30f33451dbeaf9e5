"""Questions for people while the loop trains, records and fits.

They are chosen by a process of its own, for a fit beside a training in one interpreter
would hold both up. One pipe joins it to the loop, which says for which round it may
ask; when the loop is gone, however it ended, the pipe ends, and so does the process. It
only adds: pairs, which lie in the store like all others, so that what is answered is
kept, and who asks again after a restart finds what is still open; and, once somebody
answers such pairs, episodes of checkpoints of the training that goes on. Where nobody
does, there are none, so that what was recorded does not depend on when.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import torch

from data.answers.address import Address
from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from gaitpref.console.deaf_children import beside
from gaitpref.console.progress import console
from labeling_ui.page.loop_status import LoopStatus
from rewardmodel.answers.used import count_evidence
from rewardmodel.asking.asked_meanwhile import answered_before, for_round, open_before
from rewardmodel.asking.clip_questions import ask
from rewardmodel.asking.visible import showing
from rewardmodel.models.model import RewardModel

from .loop_cfg import LoopCfg
from .people import People
from .questions_stage import doubting, episodes_asked_about, seen_apart
from .record_stage import record_on_the_way, recorded_on_the_way
from .run_dir import Round, context_of, seed_of

_POLL_S = 0.5
_OPEN_PAIRS = 2
"""Pairs that keep a person busy while the next are chosen."""
_TEACHES = (
    "Meanwhile, if you like: pairs of earlier clips, and soon of what it learns now; "
    "answers teach the next reward."
)
_KEPT = (
    "Meanwhile, if you like: pairs of earlier clips; this run has all it needs, later "
    "fits count your answers."
)


class Meanwhile:
    """The questions between two rounds as the loop sees them."""

    def __init__(self, cfg: LoopCfg, people: People, pipe: Connection | None) -> None:
        self._cfg, self._pipe, self._note = cfg, pipe, ""
        self._announce = people.announce
        self.people = replace(people, announce=self._told) if pipe else people
        """Who is told, besides, what the questions are about."""

    def before(self, number: int) -> None:
        """Ask from now on, for the round `number`."""
        self._note = _TEACHES if number < self._cfg.rounds else _KEPT
        self._send(number)

    def rest(self) -> None:
        """Ask no more: a round has questions of its own."""
        self._note = ""
        self._send(None)

    def _send(self, number: int | None) -> None:
        if self._pipe is None:
            return
        try:
            self._pipe.send(number)
        except OSError:
            self._note = ""

    def _told(self, status: LoopStatus) -> None:
        text = f"{status.text}. {self._note}" if self._note else status.text
        self._announce(replace(status, text=text))


@contextmanager
def meanwhile(
    run: Path, cfg: LoopCfg, people: People, answers: Address | None
) -> Iterator[Meanwhile]:
    """Ask people between the rounds of `run`, where its method does so; programs wait
    for nothing."""
    if cfg.rater != "human" or cfg.method.meanwhile is None:
        yield Meanwhile(cfg, people, None)
        return
    with beside(_serve, run, cfg, answers, name="meanwhile") as (_, pipe):
        yield Meanwhile(cfg, people, pipe)


def _serve(run: Path, cfg: LoopCfg, answers: Address | None, pipe: Connection) -> None:
    # It hears no Ctrl-C: that the loop is gone is what the pipe says.
    torch.set_num_threads(1)
    dataset = Dataset.open(run / "dataset", answers=answers)
    number: int | None = None
    try:
        while True:
            number = _told_last(pipe, number)
            try:
                keep_asked(run, cfg, dataset, number)
            except GaitprefError as error:
                console.print(f"nothing more is asked meanwhile: {error}")
                number = None
    except (EOFError, OSError):
        return


def _told_last(pipe: Connection, number: int | None) -> int:
    """The round to ask for by now; waits as long as there is none."""
    while number is None or pipe.poll(_POLL_S):
        number = pipe.recv()
    return number


def keep_asked(run: Path, cfg: LoopCfg, dataset: Dataset, number: int) -> int:
    """Ask for the round `number`, which has not begun, where few such pairs are open;
    gives how many.

    Half of them are about checkpoints of its training, where there are any and somebody
    answers.

    Raises:
        GaitprefError: there is nothing left to ask about.
    """
    decision = cfg.method.meanwhile
    if decision is None:
        return 0
    with dataset.answers() as store:
        people = sum(kind == "human" for kind in store.raters().values())
        if open_before(store) > max(_OPEN_PAIRS, people):
            return 0
        known = store.pairs()
        answers = count_evidence(store, dataset)
        somebody = answered_before(store, number) > 0
    if somebody:
        record_on_the_way(cfg, Round(run, number), dataset)
    seed = seed_of(cfg, number, 13, len(known))
    coming, count = Round(run, number), max(decision.batch, people)
    reward = doubting(cfg, context_of(cfg, coming), dataset, seed=seed)
    pairs = _chosen(cfg, coming, dataset, count, reward=reward, known=known, seed=seed)
    with dataset.answers() as store:
        return store.add_pairs(
            for_round(pair, number, answers=answers, reward=reward) for pair in pairs
        )


def _chosen(
    cfg: LoopCfg,
    coming: Round,
    dataset: Dataset,
    count: int,
    *,
    reward: RewardModel | None,
    known: Sequence[Pair],
    seed: int,
) -> list[Pair]:
    """`count` pairs for the round that is `coming`; those about its training first, so
    that they are shown while it goes on."""
    earlier = episodes_asked_about(cfg, coming.before, dataset)
    names = set(recorded_on_the_way(coming))
    new = [entry for entry in dataset.entries() if entry.sha256 in names]
    visible = seen_apart(cfg, dataset)
    about_new = math.ceil(count / 2) if new else 0
    plan = (
        (about_new, earlier + new, showing(names, visible)),
        (count - about_new, earlier, visible),
    )
    rng = np.random.default_rng(seed)
    chosen: list[Pair] = []
    for wanted, entries, told_apart in plan:
        if wanted:
            chosen += ask(
                dataset,
                entries,
                cfg.clips,
                wanted,
                known=[*known, *chosen],
                model=reward,
                # These wait while a round has questions of its own.
                round_number=coming.before.number,
                uniform_share=cfg.method.questions.uniform_share,
                strategy=cfg.method.questions.strategy,
                told_apart=told_apart,
                rng=rng,
            )
    return chosen
