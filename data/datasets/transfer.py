"""Moves episodes and answers between data sets: merge, subset and split.

Episode files are copied as they are, so an answer means the same clip everywhere.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from data.answers.answer_records import Answer, Pair
from data.errors import DatasetError
from data.files.telling import Tell, silent

from .dataset import Dataset
from .merged_rows import add_rows, rows_of


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
    tell: Tell = silent,
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
        tell: Gets the episodes that are copied.

    Raises:
        DatasetError, EpisodeError, AnswerError: a file is damaged, or not writable.
    """
    hashes = {e.sha256 for e in source.entries()} if episodes is None else set(episodes)
    before = {entry.sha256 for entry in target.entries()}
    with source.answers_copy() as store:
        rows = rows_of(store, str(source.root))
    target.add_from(source, sorted(hashes - before), tell=tell)
    with target.answers() as store:
        added = add_rows(
            store, rows, hashes, wanted=wanted, keep_open_pairs=keep_open_pairs
        )
    return Transferred(
        episodes=len(hashes - before),
        pairs=added.pairs,
        answers=added.answers,
        left_out=added.left_out,
        renamed=added.renamed,
    )


def split(
    source: Dataset,
    shares: Mapping[str, float],
    root: Path,
    *,
    seed: int,
    tell: Tell = silent,
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
        tell: Gets the episodes of all parts that are copied.

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
    entries, copied = source.entries(), 0
    for entry in entries:
        parts[part_of(entry.sha256, shares, seed)].append(entry.sha256)
    made: dict[str, Transferred] = {}
    for name, hashes in parts.items():
        made[name] = transfer(
            source,
            Dataset.create(root / name),
            episodes=hashes,
            tell=_after(copied, len(entries), tell),
        )
        copied += len(hashes)
    return made


def _after(before: int, of: int, tell: Tell) -> Tell:
    """Tells of a part that begins after `before`, of as much as there is in all."""
    return lambda done, _: tell(before + done, of)


def part_of(sha256: str, shares: Mapping[str, float], seed: int) -> str:
    """The part an episode belongs to, on every machine."""
    digest = hashlib.sha256(f"{seed} {sha256}".encode()).digest()
    position = int.from_bytes(digest[:8]) / 2**64
    for name, share in shares.items():
        position -= share
        if position < 0:
            return name
    return list(shares)[-1]
