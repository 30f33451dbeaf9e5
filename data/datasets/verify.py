"""Finds everything in a data set that is not as it was written."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar

from data.answers.address import Address
from data.answers.check import Asked, asked, damaged_rows
from data.episodes.model_store import MODELS, model_path
from data.errors import (
    AnswerError,
    AnswersUnreachable,
    DatasetError,
    EpisodeError,
    FileError,
)
from data.files.files import sha256_file
from data.files.telling import Tell, silent

from .dataset import ANSWERS_NAME, Dataset
from .manifest import EpisodeEntry, models_of
from .manifest_file import MANIFEST_NAME

Item = TypeVar("Item")
Found = TypeVar("Found")
DamageKind = Literal["manifest", "missing", "changed", "link", "answers", "dangling"]


@dataclass(frozen=True)
class Damage:
    """One thing that is wrong."""

    kind: DamageKind
    what: str
    """The file, relative to the data set, or the answer."""
    message: str
    episode: str = ""
    """Hash of the episode that is touched."""
    answers: tuple[str, ...] = ()
    """Ids of the answers that are touched."""


@dataclass(frozen=True)
class Verified:
    """What was looked at, and what was found."""

    episodes: int
    bytes: int
    answers: int
    damages: tuple[Damage, ...]
    left_over: tuple[str, ...]
    """Files nobody knows, left by a killed writer: harmless, `recover` takes them."""


def verify(
    root: Path, *, answers: Address | None = None, tell: Tell = silent
) -> Verified:
    """Compare every file with its hash and every answer with its checksum.

    Args:
        root: The data set.
        answers: Where its answers are, if not in its own file.
        tell: Gets the episode files that were looked at, from several threads.

    Raises:
        DatasetError: `root` is no data set, or of another version.
        AnswersUnreachable: the server of its answers is not there.
    """
    damages: list[Damage] = []
    dataset = Dataset.open(root)
    entries: dict[str, EpisodeEntry] = {}
    try:
        entries = {entry.sha256: entry for entry in dataset.entries()}
    except DatasetError as error:
        damages.append(Damage("manifest", MANIFEST_NAME, str(error)))
    # Hashing holds no lock of the interpreter.
    with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as pool:
        look = _telling(partial(_file_damage, dataset), len(entries), tell)
        files = pool.map(look, entries.values())
        answered, answer_damages = _answers(answers or root / ANSWERS_NAME)
        touched = _answers_by_episode(answered)
        damages += _files(entries.values(), files, touched)
    damages += _models(dataset, entries.values(), touched)
    damages += answer_damages
    if entries:
        damages += _dangling(answered, entries)
    return Verified(
        episodes=len(entries),
        bytes=sum(entry.bytes for entry in entries.values()),
        answers=len(answered),
        damages=tuple(damages),
        left_over=tuple(_left_over(root, entries)),
    )


def _telling(
    work: Callable[[Item], Found], of: int, tell: Tell
) -> Callable[[Item], Found]:
    """`work`, done by several threads, each of which tells what all have done."""
    done, mutex = 0, threading.Lock()

    def counted(item: Item) -> Found:
        nonlocal done
        result = work(item)
        with mutex:
            done += 1
            tell(done, of)
        return result

    return counted


def _files(
    entries: Iterable[EpisodeEntry],
    found: Iterable[tuple[DamageKind, str] | None],
    touched: Mapping[str, tuple[str, ...]],
) -> list[Damage]:
    """Episode files that are not what the manifest promises."""
    return [
        Damage(damage[0], e.path, damage[1], e.sha256, touched.get(e.sha256, ()))
        for e, damage in zip(entries, found, strict=True)
        if damage is not None
    ]


def _models(
    dataset: Dataset,
    entries: Iterable[EpisodeEntry],
    touched: Mapping[str, tuple[str, ...]],
) -> list[Damage]:
    """Models that are not what episodes were recorded with."""
    damages: list[Damage] = []
    for model in models_of(entries):
        try:
            dataset.models.content(model)
        except (DatasetError, EpisodeError, FileError, OSError) as error:
            there = (dataset.root / model_path(model)).exists()
            kind = "changed" if there else "missing"
            answers = [
                answer
                for entry in entries
                if entry.mjcf_sha256 == model
                for answer in touched.get(entry.sha256, ())
            ]
            unique = tuple(dict.fromkeys(answers))
            damage = Damage(kind, model_path(model), str(error), answers=unique)
            damages.append(damage)
    return damages


def _file_damage(
    dataset: Dataset, entry: EpisodeEntry
) -> tuple[DamageKind, str] | None:
    try:
        path = dataset.path_of(entry)
    except DatasetError as error:
        return "link", str(error)
    try:
        size = path.stat().st_size
        if size != entry.bytes:
            return "changed", f"it has {size} bytes instead of {entry.bytes}"
        sha256 = sha256_file(path)
    except FileNotFoundError:
        return "missing", f"the file is gone, it had {entry.bytes} bytes"
    except OSError as error:
        return "changed", f"it cannot be read: {error.strerror}"
    if sha256 != entry.sha256:
        return "changed", f"its sha256 is {sha256}"
    return None


def _answers(address: Address) -> tuple[list[Asked], list[Damage]]:
    """What the answers are about as far as it can be read, and what is wrong."""
    if isinstance(address, Path) and not address.exists():
        return [], []
    damages: list[Damage] = []
    try:
        damages += [
            Damage("answers", ANSWERS_NAME, row.message, answers=row.answers)
            for row in damaged_rows(address)
        ]
        return asked(address), damages
    except AnswersUnreachable:
        raise
    except (AnswerError, FileError, sqlite3.Error, UnicodeDecodeError) as error:
        message = f"it cannot be read: {' '.join(str(error).split())}"
        return [], [*damages, Damage("answers", ANSWERS_NAME, message)]


def _answers_by_episode(answered: Iterable[Asked]) -> dict[str, tuple[str, ...]]:
    """Ids of the answers about each episode."""
    found: dict[str, list[str]] = defaultdict(list)
    for answer in answered:
        for rollout in {rollout for rollout, _ in answer.clips}:
            found[rollout].append(answer.answer_id)
    return {rollout: tuple(answers) for rollout, answers in found.items()}


def _dangling(
    answered: Iterable[Asked], entries: Mapping[str, EpisodeEntry]
) -> list[Damage]:
    """Answers about what the data set does not have."""
    found: list[Damage] = []
    for answer in answered:
        for rollout, stop in answer.clips:
            entry = entries.get(rollout)
            if entry is None:
                message = f"it is about the episode {rollout}, which is not here"
            elif stop > entry.num_steps:
                message = (
                    f"it is about steps up to {stop} of {rollout}, which has "
                    f"{entry.num_steps}"
                )
            else:
                continue
            name = f"answer {answer.answer_id}"
            found.append(
                Damage("dangling", name, message, rollout, (answer.answer_id,))
            )
    return found


def _left_over(root: Path, entries: Mapping[str, EpisodeEntry]) -> list[str]:
    files = [
        *(root / "rollouts").rglob(".*.tmp"),
        *root.glob(".*.tmp"),
        *(root / MODELS).glob(".*.tmp"),
        *(p for p in (root / "rollouts").glob("??/*.mcap") if p.stem not in entries),
    ]
    return sorted(str(path.relative_to(root)) for path in files)
