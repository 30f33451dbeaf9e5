"""Having the questions of a round answered: at once, or by people who need time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from data.datasets.dataset import Dataset
from gaitpref.console.progress import console, counting_bar
from gaitpref.programs.program_answers import answer_by_program
from gaitpref.programs.program_cfg import ProgramCfg, ProgramError
from gaitpref.raters.criteria import Criterion
from gaitpref.raters.simulated import answer_pairs
from rewardmodel.answers.answered_pairs import MIN_ANSWERS, count_evidence
from rewardmodel.asking.asked_meanwhile import asked_and_left

from .loop_cfg import LoopCfg
from .people import People
from .run_dir import Round, place_of, seed_of

RATER_ID = "simulated"
_POLL_S = 0.5
_MOST_MORE = 40
"""Questions beyond its own that a round puts to a program which prefers nothing."""
_OPEN_PAIRS = 2
"""Pairs that keep people busy while the next are chosen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Collector:
    """Who answers the questions of a round, and since when they are waited for."""

    cfg: LoopCfg
    round: Round
    dataset: Dataset
    criterion: Criterion
    people: People
    ask_more: Callable[[int], None] | None = None
    """Chooses so many more pairs, where too many answers prefer nothing; None: none
    are."""
    since_s: float = field(default_factory=time.monotonic)

    @property
    def waited_s(self) -> float:
        """Since the first question."""
        return time.monotonic() - self.since_s

    def answered(self, count: int, *, last: bool) -> bool:
        """Have the pairs of the round, `count` in all, answered; False where patience
        is over.

        Raises:
            GaitprefError: the page is gone.
        """
        if self.cfg.rater == "human":
            return self._wait(count, open_pairs=0 if last else _OPEN_PAIRS)
        if self.cfg.program is not None:
            return self._by_program(self.cfg.program, last=last)
        answer_pairs(
            self.dataset,
            self.criterion,
            rater_id=RATER_ID,
            seed=seed_of(self.cfg, self.round.number, 4),
            cfg=self.cfg.simulated,
            round=self.round.number,
        )
        return True

    def _by_program(self, cfg: ProgramCfg, *, last: bool) -> bool:
        """Have the program answer; after the last, as many more as it takes until
        enough answers prefer a clip."""
        if self.people.program is None:
            raise ValueError(f"nobody said how {cfg.name} is asked")
        seed, asked_more = seed_of(self.cfg, self.round.number, 4), 0
        while True:
            answer_by_program(
                self.dataset,
                self.people.program,
                cfg,
                seed=seed,
                round=self.round.number,
            )
            with self.dataset.answers() as store:
                evidence = count_evidence(store, self.dataset, unchecked=True)
            wanted = MIN_ANSWERS - evidence
            if not last or wanted <= 0 or self.ask_more is None:
                return True
            if asked_more >= _MOST_MORE:
                raise ProgramError(
                    f"{cfg.rater_id} prefers a clip in {evidence} of its answers, and "
                    f"{asked_more} more questions did not help: a reward needs "
                    f"{MIN_ANSWERS}; `gaitpref raters compare --dataset "
                    f"{self.dataset.root}` shows what it said"
                )
            self.ask_more(wanted)
            asked_more += wanted

    def _wait(self, count: int, *, open_pairs: int) -> bool:
        """Wait until at most `open_pairs` of the round, `count` in all, are open, or
        patience is over; whether it lasted.

        Either way enough answers prefer a clip when the round's last pairs were waited
        for: where too many are "equally good", "can't tell" or "bad clip", more pairs
        are asked.
        """
        number = self.round.number
        title = f"round {number}: answers"
        with self.dataset.answers() as store, counting_bar(title, count) as bar:
            while True:
                self.people.require_page()
                asked, left = asked_and_left(store, number, by_people=True)
                bar.update(bar.task_ids[0], completed=asked - left)
                done = left <= open_pairs
                if done and open_pairs:
                    return True
                wanted = count - (asked - left)
                if done or self.waited_s >= self.people.patience_s:
                    wanted = MIN_ANSWERS - count_evidence(store, self.dataset)
                    if wanted <= 0 or self.ask_more is None:
                        break
                    if wanted > left:
                        self.ask_more(wanted - left)
                self.people.tell(
                    f"{place_of(self.cfg, self.round)}: waiting for {wanted} more "
                    f"answer{'s' * (wanted != 1)}",
                    min(1.0, (asked - left) / count),
                )
                time.sleep(_POLL_S)
        if left:
            console.print(
                f"round {number}: going on after {self.waited_s / 60:.1f} minutes, "
                f"{left} of {asked} pairs are still open; their answers count later"
            )
        return done
