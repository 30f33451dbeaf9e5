"""What is shared behind a URL: which files there are, and what they say.

    rollouts/ab/<sha256>.mcap       episodes
    models/<sha256>.xml             large models of robots
    manifests/<sha256>.json         which of them there are
    answers/<sha256>.jsonl.zst      raters, pairs and answers, a line each

Everything is named by its content and never changed. Who pushes adds a manifest and
answers that hold all there is, and then deletes those that went into them: of two who
push at once, both stay, and the next takes them together.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import zstandard

from data.answers.lines import from_lines, to_lines
from data.answers.store import AnswerStore
from data.datasets.manifest import EpisodeEntry, decode_manifest
from data.datasets.merged_rows import Added, Rows, add_rows, rows_of
from data.errors import RemoteError
from data.files.files import sha256_bytes
from data.files.limits import ANSWERS_BYTES, MANIFEST_BYTES
from data.files.unpacking import unpack_zstd

from .place import Gone, Place

MANIFESTS, ANSWERS, ROLLOUTS = "manifests", "answers", "rollouts"
_ATTEMPTS = 5
"""Times the list is looked at again, as another pushes and deletes what it held."""


@dataclass(frozen=True)
class Listed:
    """What several who pushed have said, taken together."""

    entries: dict[str, EpisodeEntry]
    """All episodes, by hash."""
    manifests: tuple[str, ...]
    """Names of the files that say so."""
    answers: dict[str, Rows]
    """What each file of answers holds, by its name."""


def listed(place: Place) -> Listed:
    """What there is at a place; nothing where nobody has pushed.

    Raises:
        RemoteError: it cannot be read.
        DatasetError, AnswerError: somebody wrote there what no version of ours does.
    """
    for attempt in range(_ATTEMPTS):
        try:
            return _listed(place)
        except Gone:
            if attempt == _ATTEMPTS - 1:
                raise
    raise AssertionError("unreachable")


def _listed(place: Place) -> Listed:
    # Who pushes sends answers last: those that are there are about episodes that are
    # listed by now, and none is taken for one about nothing.
    answers = {name: _rows(place, name) for name in sorted(place.sizes(ANSWERS))}
    manifests = tuple(sorted(place.sizes(MANIFESTS)))
    entries: dict[str, EpisodeEntry] = {}
    for name in manifests:
        content = named(place, name, MANIFEST_BYTES)
        entries |= decode_manifest(content, f"{place.name}/{name}")
    return Listed(entries, manifests, answers)


def named(place: Place, name: str, limit: int) -> bytes:
    """A file that is named by its content, compared with its name.

    Raises:
        RemoteError: it cannot be read, or is not what its name says.
    """
    content = place.read(name, limit)
    if sha256_bytes(content) != Path(name).name.partition(".")[0]:
        raise RemoteError(
            f"{place.name}/{name} is not what its name says; delete it there, and push "
            "again from where it is whole"
        )
    return content


def name_of(folder: str, content: bytes, ending: str) -> str:
    """What a file is called for its content."""
    return f"{folder}/{sha256_bytes(content)}{ending}"


def _rows(place: Place, name: str) -> Rows:
    content = named(place, name, ANSWERS_BYTES)
    try:
        size = zstandard.frame_content_size(content)
        lines = unpack_zstd(content, size, ANSWERS_BYTES).decode().splitlines()
    except (ValueError, zstandard.ZstdError) as error:
        raise RemoteError(
            f"{place.name}/{name} holds no answers ({error}); delete it there, and "
            "push again from where they are whole"
        ) from None
    with _scratch(place) as store:
        from_lines(store, lines, f"{place.name}/{name}")
        return rows_of(store, f"{place.name}/{name}")


def _scratch(place: Place) -> AnswerStore:
    """An empty store that nothing is kept of."""
    return AnswerStore.snapshot(Path(place.name) / "answers taken together")


def together(
    place: Place, found: Listed, own: Rows, hashes: Collection[str]
) -> tuple[bytes, Added]:
    """Answers at a place and those of a data set as one file, and what of the data
    set's is new.

    Raises:
        AnswerError: two of them contradict each other.
    """
    with _scratch(place) as store:
        for rows in found.answers.values():
            add_rows(store, rows, hashes)
        added = add_rows(store, own, hashes)
        text = "".join(f"{line}\n" for line in to_lines(store))
    return zstandard.ZstdCompressor().compress(text.encode()), added
