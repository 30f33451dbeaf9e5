"""The manifest of a data set on disk, read as little as needed, replaced as a whole."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from data.errors import DatasetError
from data.files.faults import cause
from data.files.files import locked, open_regular, read_bounded, write_atomically
from data.files.limits import MANIFEST_BYTES

from .manifest import EpisodeEntry, decode_manifest, encode_manifest
from .manifest_lookup import look_up, require_manifest

MANIFEST_NAME = "manifest.json"
LOCK_NAME = ".lock"

Entries = dict[str, EpisodeEntry]
"""Episodes by hash, sorted."""


class ManifestFile:
    """`manifest.json` of a data set; several processes may read and replace it."""

    def __init__(self, root: Path) -> None:
        """Look at its first line only.

        Raises:
            DatasetError: `root` is no data set, or of another version.
        """
        self._root = root
        self._path = root / MANIFEST_NAME
        self._mutex = threading.Lock()
        self._stamp: tuple[int, int, int] | None = None
        self._entries: Entries = {}
        self._looked_up: Entries = {}
        with self._expected():
            require_manifest(self._path)

    @staticmethod
    def create(root: Path) -> None:
        """Write an empty manifest to `root` unless there is one.

        Raises:
            DatasetError: the directory is not writable.
        """
        with writable(root), locked(root / LOCK_NAME):
            if not (root / MANIFEST_NAME).exists():
                write_atomically(root / MANIFEST_NAME, encode_manifest([]))

    def entries(self) -> Entries:
        """All entries; read again if the file was replaced.

        Raises:
            DatasetError, FileError: the manifest is damaged, or no file.
        """
        with self._mutex, self._expected(), open_regular(self._path) as file:
            stat = os.fstat(file.fileno())
            stamp = (stat.st_ino, stat.st_size, stat.st_mtime_ns)
            if stamp != self._stamp:
                content = read_bounded(file, self._path, MANIFEST_BYTES)
                self._entries = decode_manifest(content, str(self._path))
                self._stamp = stamp
                self._looked_up.clear()
            return self._entries

    def entry(self, sha256: str) -> EpisodeEntry:
        """One entry, found without reading the whole file.

        Raises:
            DatasetError: there is none, or the manifest is damaged.
        """
        found = self.find(sha256)
        if found is None:
            raise DatasetError(
                f"{self._root} has no episode {sha256[:64]!r} among its "
                f"{len(self._entries)}; add the data set it was recorded in"
            )
        return found

    def find(self, sha256: str) -> EpisodeEntry | None:
        """The entry of an episode; None if there is none.

        Raises:
            DatasetError: the manifest is damaged.
        """
        known = self._entries.get(sha256) or self._looked_up.get(sha256)
        if known is not None:
            return known
        with self._expected():
            found = look_up(self._path, sha256)
        found = found or self.entries().get(sha256)
        if found is not None:
            self._looked_up[sha256] = found
        return found

    def change(self, change: Callable[[Entries], Entries]) -> None:
        """Replace the entries by changed ones, against all other writers.

        Raises:
            DatasetError: the manifest is damaged, or not writable.
        """
        with writable(self._root), locked(self._root / LOCK_NAME):
            known = self.entries()
            changed = change(known)
            if changed.keys() != known.keys():
                write_atomically(self._path, encode_manifest(changed.values()))
                self._looked_up.clear()

    @contextmanager
    def _expected(self) -> Iterator[None]:
        try:
            yield
        except (FileNotFoundError, NotADirectoryError):
            inside = self._root / "dataset"
            is_run = (inside / MANIFEST_NAME).is_file()
            raise DatasetError(
                f"{self._root} is no data set, it has no {MANIFEST_NAME}; "
                + (
                    f"it is a run, whose data set is {inside}"
                    if is_run
                    else f"make one with `gaitpref record --policy POLICY --dataset "
                    f"{self._root}`"
                )
            ) from None


@contextmanager
def writable(root: Path) -> Iterator[None]:
    """Say in one line why a data set cannot be written.

    Raises:
        DatasetError: the disk is full, read-only, or not ours to write.
    """
    try:
        yield
    except OSError as error:
        reason = cause(error)
        if reason is None:
            raise
        raise DatasetError(
            f"{root} cannot be written: {reason}; nothing that was there is lost, make "
            "room or give another directory and run this again"
        ) from error
