"""Sends a data set to a place, and takes one from there.

What is there already is not sent twice, so that what was killed goes on where it was.
Nothing is deleted but lists that a longer one holds.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from data.answers.address import Address
from data.datasets.dataset import Dataset, EpisodeEntry
from data.datasets.manifest import encode_manifest, models_of
from data.datasets.merged_rows import add_rows, rows_of
from data.episodes.model_store import MODELS, model_path
from data.errors import RemoteError
from data.files.limits import EPISODE_BYTES, MODEL_BYTES
from data.files.telling import Tell, silent

from .listed import ANSWERS, MANIFESTS, ROLLOUTS, listed, name_of, named, together
from .place import Place

T = TypeVar("T")


@dataclass(frozen=True)
class Shared:
    """What a push or a pull did."""

    episodes: int
    """Episodes of the data set that were not there yet."""
    files: int
    """Episode files that were sent; the others had arrived before."""
    bytes: int
    """What they hold."""
    pairs: int
    answers: int
    """What was new of them."""
    left_out: int
    """Answers about episodes that nobody has any more."""
    renamed: Mapping[str, str]
    """Raters who got another id, because theirs belongs to somebody else."""


def push(dataset: Dataset, place: Place, *, tell: Tell = silent) -> Shared:
    """Send what `place` lacks of `dataset`: files, then the list of them, then answers.

    Answers are taken together with those that are there, as `transfer` does.

    Raises:
        RemoteError: the place cannot be read or written.
        DatasetError, EpisodeError, AnswerError: a file is damaged, here or there.
    """
    own = {entry.sha256: entry for entry in dataset.entries()}
    with dataset.answers_copy() as store:
        rows = rows_of(store, str(dataset.root))
    sizes = place.sizes(ROLLOUTS)
    missing = [e for e in own.values() if sizes.get(e.path) != e.bytes]
    _send_models(dataset, place, own.values())

    def send(entry: EpisodeEntry) -> None:
        place.send(entry.path, dataset.content(entry))

    _each(send, missing, place.at_once, tell)
    found = listed(place)
    entries = found.entries | own
    manifest = encode_manifest(entries.values())
    _replace(place, MANIFESTS, manifest, ".json", found.manifests)
    answers, added = together(place, found, rows, entries)
    # Packed by another version, the same answers are other bytes.
    if added.pairs or added.answers or len(found.answers) != 1:
        _replace(place, ANSWERS, answers, ".jsonl.zst", found.answers)
    return Shared(
        episodes=len(own.keys() - found.entries.keys()),
        files=len(missing),
        bytes=sum(entry.bytes for entry in missing),
        pairs=added.pairs,
        answers=added.answers,
        left_out=added.left_out,
        renamed=added.renamed,
    )


def pull(
    place: Place, root: Path, *, answers: Address | None = None, tell: Tell = silent
) -> Shared:
    """Take what the data set at `root` lacks from `place`; every file is compared with
    its name before it is there under it.

    Args:
        place: Where from.
        root: The data set, made if it is missing.
        answers: Where its answers are, as for `Dataset.open`.
        tell: Gets how far it is.

    Raises:
        RemoteError: nobody has pushed there, it cannot be read, or a file is damaged.
        DatasetError, AnswerError: as for `push`, or the disk is full.
    """
    found = listed(place)
    if not found.manifests:
        raise RemoteError(
            f"{place.name} holds no data set; `gaitpref data push DATASET "
            f"{place.name}` puts one there"
        )
    dataset = Dataset.create(root, answers=answers)
    new = [e for e in found.entries.values() if not dataset.holds(e.sha256)]
    missing = [entry for entry in new if not dataset.has_stored(entry)]

    def take(entry: EpisodeEntry) -> None:
        limit = min(entry.bytes, EPISODE_BYTES)
        dataset.put(entry, named(place, entry.path, limit))

    for model in models_of(new):
        if not dataset.models.holds(model):
            content = named(place, model_path(model), MODEL_BYTES)
            dataset.models.put(model, content)
    _each(take, missing, place.at_once, tell)
    dataset.add_stored(new)
    hashes = {entry.sha256 for entry in dataset.entries()}
    with dataset.answers() as store:
        added = [add_rows(store, rows, hashes) for rows in found.answers.values()]
    return Shared(
        episodes=len(new),
        files=len(missing),
        bytes=sum(entry.bytes for entry in missing),
        pairs=sum(part.pairs for part in added),
        answers=sum(part.answers for part in added),
        left_out=sum(part.left_out for part in added),
        renamed={old: new for part in added for old, new in part.renamed.items()},
    )


def _send_models(
    dataset: Dataset, place: Place, entries: Iterable[EpisodeEntry]
) -> None:
    """Send the models that lie beside `entries` and that the place lacks."""
    models = models_of(entries)
    sizes = place.sizes(MODELS) if models else {}
    for model in models:
        content = dataset.models.content(model)
        if sizes.get(model_path(model)) != len(content):
            place.send(model_path(model), content)


def _replace(
    place: Place, folder: str, content: bytes, ending: str, old: Iterable[str]
) -> None:
    """Add a file that holds all that `old` do, then take these away."""
    name = name_of(folder, content, ending)
    if name not in old:
        place.send(name, content)
    for other in old:
        if other != name:
            place.remove(other)


def _each(work: Callable[[T], None], items: list[T], workers: int, tell: Tell) -> None:
    """Do `work` for all items, some at once; the first fault ends it."""
    done, mutex = 0, threading.Lock()
    tell(done, len(items))

    def counted(item: T) -> None:
        nonlocal done
        work(item)
        with mutex:
            done += 1
            tell(done, len(items))

    pool = ThreadPoolExecutor(workers, "share")
    try:
        running = [pool.submit(counted, item) for item in items]
        for future in wait(running, return_when=FIRST_EXCEPTION).done:
            future.result()
    finally:
        # Also where somebody pressed Ctrl-C: what is under way ends, nothing else.
        pool.shutdown(wait=True, cancel_futures=True)
