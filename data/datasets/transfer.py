"""Moves episodes and answers between data sets: merge, subset and split.

Episode files are copied as they are, so an answer means the same clip everywhere.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from data.answers.answer_records import Answer, Pair, RaterKind
from data.answers.fields import require_sound
from data.answers.store import AnswerStore
from data.errors import DatasetError

from .dataset import Dataset


@dataclass(frozen=True)
class Transferred:
    """What was new in the data set that was written to."""

    episodes: int
    pairs: int
    answers: int
    left_out: int
    """Answers about episodes that did not come along."""
    renamed: Mapping[str, str]
    """Raters who got another id, because theirs belongs to somebody else."""


def transfer(
    source: Dataset,
    target: Dataset,
    *,
    episodes: Iterable[str] | None = None,
    wanted: Callable[[Pair, Answer], bool] = lambda pair, answer: True,
    keep_open_pairs: bool = True,
) -> Transferred:
    """Copy episodes with the pairs and answers about them; what is there stays.

    Two people of one name are kept apart: a human of the source whose id is another's
    in the target is renamed, unless an answer that both have shows them to be the same.

    Args:
        source: Where from.
        target: Where to.
        episodes: Hashes; all by default.
        wanted: Which answers; a correction goes with what it corrects.
        keep_open_pairs: Also copy pairs nobody answered.

    Raises:
        DatasetError, EpisodeError, AnswerError: a file is damaged, or not writable.
    """
    hashes = {e.sha256 for e in source.entries()} if episodes is None else set(episodes)
    before = {entry.sha256 for entry in target.entries()}
    with source.answers_copy() as store:
        raters, pairs, answered = store.rater_rows(), store.pairs(), store.all_answers()
    require_sound(str(source.root), raters, pairs, (answer for _, answer in answered))
    here = {p.pair_id for p in pairs if {p.a.rollout, p.b.rollout} <= hashes}
    chosen = [(p, a) for p, a in answered if p.pair_id in here and wanted(p, a)]
    chosen = _with_corrected(chosen, answered)
    used = {pair.pair_id for pair, _ in chosen} | (here if keep_open_pairs else set())
    target.add_from(source, sorted(hashes - before))
    with target.answers() as store:
        names = _names(store, raters, answered)
        num_pairs = store.add_pairs(pair for pair in pairs if pair.pair_id in used)
        raters_used = {answer.rater_id for _, answer in chosen}
        for rater_id, kind, info in raters:
            if rater_id in raters_used:
                store.add_rater(names[rater_id], kind, info, copied=True)
        num_answers = sum(
            _add(store, replace(answer, rater_id=names[answer.rater_id]))
            for _, answer in chosen
        )
    return Transferred(
        episodes=len(hashes - before),
        pairs=num_pairs,
        answers=num_answers,
        left_out=len(answered) - len(chosen),
        renamed={k: v for k, v in names.items() if k != v and k in raters_used},
    )


def split(
    source: Dataset, shares: Mapping[str, float], root: Path, *, seed: int
) -> dict[str, Transferred]:
    """Make one data set per part of `source`, by episode: `root/<part>`.

    Both clips of a pair have to be in one part, else the pair is left out: it would
    carry what one part knows into another. An episode stays in its part when others
    are added to the source.

    Args:
        source: What is split.
        shares: Part and its share of the episodes; together 1.
        root: Directory the parts are made in.
        seed: Which episodes go where.

    Raises:
        DatasetError: the shares are impossible, or a part is there already.
    """
    if any(share <= 0 for share in shares.values()) or not 0.999 < sum(
        shares.values()
    ) < (1.001):
        raise DatasetError(
            f"the parts need shares above 0 that make 1 together, got {dict(shares)}"
        )
    for name in shares:
        if (root / name).exists():
            raise DatasetError(f"{root / name} is there already; give another --out")
    parts: dict[str, list[str]] = {name: [] for name in shares}
    for entry in source.entries():
        parts[part_of(entry.sha256, shares, seed)].append(entry.sha256)
    return {
        name: transfer(source, Dataset.create(root / name), episodes=hashes)
        for name, hashes in parts.items()
    }


def part_of(sha256: str, shares: Mapping[str, float], seed: int) -> str:
    """The part an episode belongs to, on every machine."""
    digest = hashlib.sha256(f"{seed} {sha256}".encode()).digest()
    position = int.from_bytes(digest[:8]) / 2**64
    for name, share in shares.items():
        position -= share
        if position < 0:
            return name
    return list(shares)[-1]


def _with_corrected(
    chosen: list[tuple[Pair, Answer]], answered: list[tuple[Pair, Answer]]
) -> list[tuple[Pair, Answer]]:
    """Add what the chosen answers correct, in the order of all answers."""
    earlier = {answer.answer_id: answer.supersedes for _, answer in answered}
    wanted: set[str] = set()
    for _, answer in chosen:
        current: str | None = answer.answer_id
        while current is not None and current not in wanted:
            wanted.add(current)
            current = earlier[current]
    return [(p, a) for p, a in answered if a.answer_id in wanted]


def _names(
    store: AnswerStore,
    raters: list[tuple[str, RaterKind, dict]],
    answered: list[tuple[Pair, Answer]],
) -> dict[str, str]:
    """What each rater of the source is called in the target."""
    rater_of = {answer.answer_id: answer.rater_id for _, answer in store.all_answers()}
    names = {
        answer.rater_id: rater_of[answer.answer_id]
        for _, answer in answered
        if answer.answer_id in rater_of
    }
    taken = store.raters()
    for rater_id, kind, _ in raters:
        name = rater_id
        number = 2
        # A scripted rater is a function: equal names are equal raters.
        while rater_id not in names and name in taken:
            if kind != "human" and taken[name] == kind:
                break
            name, number = f"{rater_id}~{number}", number + 1
        names.setdefault(rater_id, name)
        taken[names[rater_id]] = kind
    return names


def _add(store: AnswerStore, answer: Answer) -> bool:
    """Add an answer unless it is known; a scripted rater repeats itself later."""
    known = store.find_answer(answer.answer_id)
    if known is not None and replace(known, created_utc=answer.created_utc) == answer:
        return False
    return store.add_answer(answer, copied=True)
