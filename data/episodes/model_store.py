"""Robots' models that lie beside episodes: each once, named by its hash.

A robot with meshes is a text of megabytes, the same in every episode of it.

    models/<sha256>.xml
"""

from __future__ import annotations

import threading
from functools import lru_cache
from pathlib import Path

from data.errors import CorruptEpisode, DatasetError
from data.files.files import read_file, sha256_bytes, write_atomically
from data.files.limits import MODEL_BYTES

MODELS = "models"
INSIDE_BYTES = 64 * 2**10
"""A model up to this size goes into every episode, which is then read alone."""


def model_path(sha256: str) -> str:
    """Where the model with this hash lies in a data set."""
    return f"{MODELS}/{sha256}.xml"


class ModelStore:
    """The models of one data set; several threads and processes may read and add."""

    def __init__(self, root: Path) -> None:
        """The models in the data set at `root`, which need not have any."""
        self.root = root
        self._texts: dict[str, str] = {}
        self._mutex = threading.Lock()

    def path_of(self, sha256: str) -> Path:
        """Where a model lies.

        Raises:
            DatasetError: it is, or lies behind, a link.
        """
        path = self.root / model_path(sha256)
        for part in (path.parent, path):
            if part.is_symlink():
                raise DatasetError(
                    f"{part} is a link, which could lead out of the data set; replace "
                    "it by what it leads to"
                )
        return path

    def add(self, mjcf: str) -> str:
        """Keep the text `mjcf`, which is on the disk then; gives its hash.

        Raises:
            DatasetError: as for `path_of`.
            OSError: the disk is full or not writable.
        """
        sha256 = model_sha256(mjcf)
        with self._mutex:
            if sha256 not in self._texts:
                self.put(sha256, mjcf.encode())
                self._texts[sha256] = mjcf
        return sha256

    def put(self, sha256: str, content: bytes) -> None:
        """Keep `content`, whose hash is `sha256`; what is there already stays.

        Raises:
            DatasetError, OSError: as for `add`.
        """
        path = self.path_of(sha256)
        # A file of another length was damaged after it was renamed into place.
        if not path.is_file() or path.stat().st_size != len(content):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, content)

    def holds(self, sha256: str) -> bool:
        """Whether the whole model with this hash lies in its place."""
        path = self.path_of(sha256)
        return path.is_file() and sha256_bytes(read_file(path, MODEL_BYTES)) == sha256

    def size(self, sha256: str) -> int:
        """Bytes of a model; 0 where it is missing."""
        path = self.path_of(sha256)
        return path.stat().st_size if path.is_file() else 0

    def content(self, sha256: str) -> bytes:
        """The bytes of a model, compared with its name.

        Raises:
            DatasetError: as for `path_of`.
            CorruptEpisode: it is missing, or not what its name says.
        """
        path = self.path_of(sha256)
        try:
            content = read_file(path, MODEL_BYTES)
        except FileNotFoundError:
            raise CorruptEpisode(
                f"{path} is missing, the model of the robot that an episode was "
                "recorded with; put it back from a copy of the data set, or keep "
                "episode files in the rollouts/ of their data set"
            ) from None
        if sha256_bytes(content) != sha256:
            raise CorruptEpisode(
                f"{path} is not the model that its name says; put it back from a copy "
                "of the data set"
            )
        return content

    def text(self, sha256: str) -> str:
        """The text of a model, kept in memory.

        Raises:
            DatasetError, CorruptEpisode: as for `content`.
        """
        with self._mutex:
            if sha256 not in self._texts:
                self._texts[sha256] = self.content(sha256).decode()
            return self._texts[sha256]


@lru_cache(maxsize=8)
def model_sha256(mjcf: str) -> str:
    """Hash of a model, which most episodes share."""
    return sha256_bytes(mjcf.encode())
