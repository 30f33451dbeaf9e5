"""An arena: asks about two policies at a time until their order is sure.

It can be stopped anywhere; the same call goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data.answers.answer_records import Pair, to_json
from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from data.files.files import read_json, write_atomically
from data.files.telling import Tell, silent

from .games import Answered, Player, answered, questions, record_alike
from .parts import of_command, of_rater, parts_json, parts_of
from .strengths import Ranking, least_sure, ranking_of, wins_of

SETTINGS_NAME, RANKING_NAME = "arena.json", "ranking.json"
_MEET = 3
"""Neighbours meet so often before their order can be sure."""


@dataclass(frozen=True, kw_only=True)
class ArenaCfg:
    """How an arena is held."""

    episodes: int = 20
    """Recorded of each policy, four of each command."""
    most: int = 60
    """Questions in all."""
    batch: int = 6
    """Questions that are open for people at a time."""
    seed: int = 0
    """Where all chance comes from."""


@dataclass(frozen=True, kw_only=True)
class Standing:
    """Where an arena is."""

    players: tuple[Player, ...]
    ranking: Ranking
    answers: tuple[Answered, ...]
    open_questions: int

    @property
    def wins(self) -> np.ndarray:
        """[P, P] how often each was preferred to each, the best first, ties half."""
        order = list(self.ranking.order)
        matches = [each.match for each in self.answers]
        return wins_of(matches, len(order))[np.ix_(order, order)]

    @property
    def sentence(self) -> str:
        """The order, and whether it is sure."""
        names = [self.players[number].name for number in self.ranking.order]
        told = " > ".join(names)
        asked = f"{len(self.answers)} answers"
        if self.ranking.is_sure:
            return f"{told}, sure at 95 % after {asked}"
        open_ = [
            f"{a} and {b} ({share:.0%})"
            for a, b, share in zip(names, names[1:], self.ranking.kept, strict=False)
            if share < 0.95
        ]
        return f"{told} after {asked}; open: {', '.join(open_)}"


def hold(
    folder: Path,
    players: Sequence[Player],
    cfg: ArenaCfg,
    answer: Callable[[Dataset], None] | None = None,
    tell: Tell = silent,
) -> Standing:
    """Ask until the order is sure or `cfg.most` questions are asked.

    Args:
        folder: Gets the data set and what is known.
        players: Who is compared.
        cfg: How.
        answer: Answers what is open; None leaves it to people, and returns once enough
            is open for them.
        tell: Told how many answers there are, out of how many.

    Raises:
        GaitprefError: the folder holds another arena, or clips are used up.
    """
    dataset = record_arena(folder, players, cfg)
    while True:
        standing = standing_of(dataset, tuple(players), cfg.seed)
        tell(len(standing.answers), cfg.most)
        pairs = _next(dataset, standing, cfg, 1 if answer else cfg.batch)
        if pairs:
            with dataset.answers() as store:
                store.add_pairs(pairs)
        if answer is None or not (pairs or standing.open_questions):
            now = standing_of(dataset, tuple(players), cfg.seed)
            text = to_json("ranking", as_json(now))
            write_atomically(folder / RANKING_NAME, text.encode())
            return now
        answered_before = _questions_answered(dataset)
        answer(dataset)
        if _questions_answered(dataset) == answered_before:
            raise GaitprefError(
                f"{standing.open_questions + len(pairs)} questions of {folder} are "
                f"left open by who answers; `gaitpref data verify --dataset "
                f"{dataset.root}` says whether their episodes are gone"
            )


def record_arena(
    folder: Path, players: Sequence[Player], cfg: ArenaCfg, tell: Tell = silent
) -> Dataset:
    """The clips of an arena, as far as they are not there; `tell` gets control steps.

    Raises:
        GaitprefError: the folder holds another arena.
    """
    _claim(folder, players, cfg)
    dataset = Dataset.create(folder / "dataset")
    record_alike(dataset, players, episodes=cfg.episodes, seed=cfg.seed, tell=tell)
    return dataset


def standing_of(dataset: Dataset, players: tuple[Player, ...], seed: int) -> Standing:
    """What is known so far."""
    given = answered(dataset, players)
    matches = [each.match for each in given]
    with dataset.answers() as store:
        asked = len(store.pairs())
    return Standing(
        players=players,
        ranking=ranking_of(matches, len(players), np.random.default_rng(seed)),
        answers=tuple(given),
        open_questions=asked - _questions_answered(dataset),
    )


def _questions_answered(dataset: Dataset) -> int:
    with dataset.answers() as store:
        return len({pair.pair_id for pair, _ in store.current_answers()})


def _next(
    dataset: Dataset, standing: Standing, cfg: ArenaCfg, most_open: int
) -> list[Pair]:
    """Questions to add now: about those whose order is most open."""
    matches = [each.match for each in standing.answers]
    about = least_sure(standing.ranking, matches, at_least=_MEET)
    with dataset.answers() as store:
        known = store.pairs()
    count = min(most_open - standing.open_questions, cfg.most - len(known))
    if about is None or count < 1:
        return []
    rng = np.random.default_rng([cfg.seed, len(known)])
    first, second = (standing.players[number] for number in about)
    found = []
    for pair in questions(dataset, first, second, known, rng):
        found.append(pair)
        if len(found) == count:
            break
    if not found:
        raise GaitprefError(
            f"all clips of {first.name} beside {second.name} are asked about; more "
            f"--episodes in another --out give more"
        )
    return found


def _claim(folder: Path, players: Sequence[Player], cfg: ArenaCfg) -> None:
    """Say whose arena the folder is, or see that it is this one."""
    facts = {
        "players": {player.name: player.sha256 for player in players},
        "episodes": cfg.episodes,
        "seed": cfg.seed,
    }
    file = folder / SETTINGS_NAME
    folder.mkdir(parents=True, exist_ok=True)
    if not file.exists():
        write_atomically(file, to_json("arena", facts).encode())
    elif (found := read_json(file)) != facts:
        raise GaitprefError(
            f"{folder} holds an arena of {', '.join(found.get('players', {}))} with "
            f"other settings or policies; give another --out"
        )


def as_json(standing: Standing) -> dict[str, Any]:
    """Plain values of all that is known."""
    names = [player.name for player in standing.players]
    ranking = standing.ranking
    return {
        "sentence": standing.sentence,
        "sure": ranking.is_sure,
        "players": [
            {
                "name": names[number],
                "file": str(standing.players[number].file),
                "strength": float(ranking.strengths[number]),
                "interval": [
                    float(end) if np.isfinite(end) else None
                    for end in (ranking.low[number], ranking.high[number])
                ],
            }
            for number in ranking.order
        ],
        "order_kept": list(ranking.kept),
        "wins": {
            "players": [names[number] for number in ranking.order],
            "row_preferred_to_column": standing.wins.tolist(),
        },
        "by_command": parts_json(
            parts_of(standing.answers, of_command), "command", standing.players
        ),
        "by_rater": parts_json(
            parts_of(standing.answers, of_rater), "rater", standing.players
        ),
        "answers": [
            {
                **asdict(each.match),
                "first": names[each.match.first],
                "second": names[each.match.second],
                "rater": each.rater,
                "command": list(each.command),
                "note": each.note,
            }
            for each in standing.answers
        ],
    }
