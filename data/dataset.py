"""A data set: a plain directory of immutable episode files, a manifest and answers.

    manifest.json                     the files, their hashes and their facts
    rollouts/ab/<sha256>.mcap         episodes, named by their content
    preferences.sqlite                pairs and answers

Shapes: T steps of an episode, F columns of the feature row.
"""

from __future__ import annotations

import fcntl
import os
import threading
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from data.answers import AnswerStore
from data.clips import Clip
from data.episode import Episode, decode_episode, decode_features
from data.episode_writer import encode_episode
from data.errors import CorruptEpisode, DatasetError
from data.files import fsync_directory, sha256_bytes, write_atomically
from data.manifest import EpisodeEntry as EpisodeEntry
from data.manifest import decode_manifest, encode_manifest, rollout_path

MANIFEST_NAME = "manifest.json"
ANSWERS_NAME = "preferences.sqlite"
LOCK_NAME = ".lock"
FEATURE_CACHE_BYTES = 256 * 2**20
"""Feature rows kept in memory; about 1,400 episodes of 500 steps."""


class Dataset:
    """A data set directory; several processes may read and add at once."""

    def __init__(self, root: Path) -> None:
        """Open `root`; prefer `Dataset.open` and `Dataset.create`.

        Raises:
            DatasetError: `root` is no data set, or its manifest cannot be used.
        """
        self.root = root
        self._mutex = threading.Lock()
        self._manifest_stamp: tuple[int, int, int] | None = None
        self._entries: dict[str, EpisodeEntry] = {}
        self._verified: set[str] = set()
        self._features: OrderedDict[str, np.ndarray] = OrderedDict()
        self._features_bytes = 0
        self._refresh()

    @staticmethod
    def create(root: Path) -> Dataset:
        """Make `root` a data set, or open it if it is one.

        Raises:
            DatasetError: the manifest there cannot be used.
            OSError: the directory cannot be made.
        """
        (root / "rollouts").mkdir(parents=True, exist_ok=True)
        with _locked(root):
            if not (root / MANIFEST_NAME).exists():
                write_atomically(root / MANIFEST_NAME, encode_manifest([]))
        return Dataset(root)

    @staticmethod
    def open(root: Path) -> Dataset:
        """Open the data set at `root`.

        Raises:
            DatasetError: `root` is no data set, or its manifest cannot be used.
        """
        return Dataset(root)

    def entries(self) -> tuple[EpisodeEntry, ...]:
        """All episodes, sorted by hash; what others added meanwhile is included.

        Raises:
            DatasetError: the manifest cannot be used any more.
        """
        return tuple(self._refresh().values())

    def entry(self, sha256: str) -> EpisodeEntry:
        """The episode with this hash.

        Raises:
            DatasetError: there is none.
        """
        entry = self._entries.get(sha256) or self._refresh().get(sha256)
        if entry is None:
            raise DatasetError(
                f"{self.root} has no episode {sha256[:64]!r} among its "
                f"{len(self._entries)}; add the data set it was recorded in"
            )
        return entry

    def add_episodes(self, episodes: Iterable[Episode]) -> list[EpisodeEntry]:
        """Add episodes, one entry each in their order; one already there is left alone.

        The manifest is replaced once, after all files are on the disk: killed before
        that, the files lie there unlisted, and adding them again finds them.

        Raises:
            DatasetError: the manifest cannot be used.
            OSError: the disk is full or not writable.
        """
        added = [self._store(episode) for episode in episodes]
        with _locked(self.root):
            known = self._refresh()
            merged = known | {entry.sha256: entry for entry in added}
            if len(merged) > len(known):
                manifest = encode_manifest(merged.values())
                write_atomically(self.root / MANIFEST_NAME, manifest)
        return added

    def read(self, sha256: str) -> Episode:
        """Read a whole episode.

        Raises:
            DatasetError: there is no such episode, or its file is a link.
            CorruptEpisode: the file is missing, or not what the manifest promises.
            EpisodeError: the file cannot be read by this version.
        """
        return decode_episode(*self._content(self.entry(sha256)))

    def features(self, sha256: str) -> np.ndarray:
        """The feature rows [T, F] of an episode, float32, read-only and cached.

        Raises:
            DatasetError, EpisodeError: as for `read`.
        """
        with self._mutex:
            if sha256 in self._features:
                self._features.move_to_end(sha256)
                return self._features[sha256]
        features = decode_features(*self._content(self.entry(sha256)))
        with self._mutex:
            if sha256 not in self._features:
                self._features[sha256] = features
                self._features_bytes += features.nbytes
            while self._features_bytes > FEATURE_CACHE_BYTES:
                _, oldest = self._features.popitem(last=False)
                self._features_bytes -= oldest.nbytes
        return features

    def clip_features(self, clip: Clip) -> np.ndarray:
        """The feature rows [clip.steps, F] of a clip.

        Raises:
            DatasetError: the clip reaches beyond its episode; else as for `read`.
        """
        features = self.features(clip.rollout)
        if clip.stop > len(features):
            raise DatasetError(
                f"clip {clip.key} ends at step {clip.stop}, its episode has "
                f"{len(features)}; the answers belong to another data set"
            )
        return features[clip.rows]

    def answers(self) -> AnswerStore:
        """Open the data set's pairs and answers; close it after use.

        Raises:
            AnswerError: the data base cannot be used.
        """
        return AnswerStore.open(self.root / ANSWERS_NAME)

    def _refresh(self) -> dict[str, EpisodeEntry]:
        """The manifest's entries by hash, read again if the file was replaced."""
        path = self.root / MANIFEST_NAME
        with self._mutex:
            try:
                with path.open("rb") as file:
                    stat = os.fstat(file.fileno())
                    stamp = (stat.st_ino, stat.st_size, stat.st_mtime_ns)
                    if stamp != self._manifest_stamp:
                        self._entries = decode_manifest(file.read(), str(path))
                        self._manifest_stamp = stamp
            except (FileNotFoundError, NotADirectoryError):
                raise DatasetError(
                    f"{self.root} is no data set, it has no {MANIFEST_NAME}; make one "
                    f"with `gaitpref record --policy POLICY --dataset {self.root}`"
                ) from None
            return self._entries

    def _store(self, episode: Episode) -> EpisodeEntry:
        """Put the episode's file in its place; the manifest does not know it yet."""
        content = encode_episode(episode)
        sha256 = sha256_bytes(content)
        path = self.root / rollout_path(sha256)
        # A file of another length was damaged after it was renamed into place.
        if not path.is_file() or path.stat().st_size != len(content):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, content)
            fsync_directory(path.parent.parent)
        return EpisodeEntry(
            sha256=sha256,
            path=rollout_path(sha256),
            bytes=len(content),
            num_steps=episode.num_steps,
            end_reason=episode.end_reason,
            meta=episode.meta,
        )

    def _content(self, entry: EpisodeEntry) -> tuple[bytes, str]:
        """The bytes of an episode file, checked on first use, and its name."""
        path = self.root
        for part in Path(entry.path).parts:
            path = path / part
            if path.is_symlink():
                raise DatasetError(
                    f"{path} is a link, which could lead out of the data set; "
                    "replace it by the file itself"
                )
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            raise CorruptEpisode(
                f"{path} is missing, the manifest promises {entry.bytes} bytes; "
                "restore it from a copy of the data set"
            ) from None
        if entry.sha256 not in self._verified:
            found = sha256_bytes(content)
            if found != entry.sha256:
                raise CorruptEpisode(
                    f"{path} has sha256 {found}, the manifest promises {entry.sha256}; "
                    "restore it from a copy of the data set"
                )
            self._verified.add(entry.sha256)
        return content, str(path)


@contextmanager
def _locked(root: Path) -> Iterator[None]:
    """Hold the data set's lock against other processes and threads."""
    with (root / LOCK_NAME).open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
