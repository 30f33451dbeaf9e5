"""A data set: a plain directory of immutable episode files, a manifest and answers.

    manifest.json                     the files, their hashes and their facts
    rollouts/ab/<sha256>.mcap         episodes, named by their content
    models/<sha256>.xml               large models of robots, each once
    preferences.sqlite                pairs and answers

Shapes: T steps of an episode, F columns of the feature row.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from data.answers.address import Address
from data.answers.store import AnswerStore
from data.episodes.chunks import Compression
from data.episodes.clips import Clip
from data.episodes.episode import (
    Episode,
    decode_episode,
    decode_features,
    model_apart,
)
from data.episodes.mcap_records import tail_start
from data.episodes.model_store import INSIDE_BYTES, ModelStore
from data.episodes.writer import encode_episode
from data.errors import CorruptEpisode, DatasetError
from data.features import FEATURE_DIM
from data.files.files import (
    fsync_directory,
    read_file,
    sha256_bytes,
    sha256_file,
    write_atomically,
)
from data.files.limits import EPISODE_BYTES
from data.files.telling import Tell, silent

from .episode_window import read_feature_window
from .feature_cache import FEATURE_CACHE_BYTES, FeatureCache
from .manifest import EpisodeEntry as EpisodeEntry
from .manifest import models_of, rollout_path
from .manifest_file import LOCK_NAME as LOCK_NAME
from .manifest_file import ManifestFile, writable

_WRITERS = 8
_AHEAD = 64
"""Episodes that wait in memory to be written, 0.3 MB each where they take 6 s."""
ANSWERS_NAME = "preferences.sqlite"


class Dataset:
    """A data set directory; several processes may read and add at once."""

    def __init__(self, root: Path, *, answers: Address | None = None) -> None:
        """Open `root`; prefer `Dataset.open` and `Dataset.create`.

        Args:
            root: The directory.
            answers: Where pairs and answers are, if not in a file of the directory.

        Raises:
            DatasetError: `root` is no data set, or of another version.
        """
        self.root = root
        self.answers_address = root / ANSWERS_NAME if answers is None else answers
        self.models = ModelStore(root)
        self._manifest = ManifestFile(root)
        self._verified: set[str] = set()
        self._touched: set[str] = set()
        self._features = FeatureCache()

    @staticmethod
    def create(root: Path, *, answers: Address | None = None) -> Dataset:
        """Make `root` a data set, or open it if it is one; `answers` as for `open`.

        Raises:
            DatasetError: the manifest there cannot be used, or the directory cannot be
                made.
        """
        with writable(root):
            (root / "rollouts").mkdir(parents=True, exist_ok=True)
        ManifestFile.create(root)
        return Dataset(root, answers=answers)

    @staticmethod
    def open(root: Path, *, answers: Address | None = None) -> Dataset:
        """Open the data set at `root`.

        Args:
            root: The directory.
            answers: Where pairs and answers are, if not in a file of the directory.

        Raises:
            DatasetError: `root` is no data set, or of another version.
        """
        return Dataset(root, answers=answers)

    def entries(self) -> tuple[EpisodeEntry, ...]:
        """All episodes, sorted by hash; what others added meanwhile is included.

        Raises:
            DatasetError: the manifest is damaged.
        """
        return tuple(self._manifest.entries().values())

    def entry(self, sha256: str) -> EpisodeEntry:
        """The episode with this hash, found without reading the whole manifest.

        Raises:
            DatasetError: there is none, or the manifest is damaged.
        """
        return self._manifest.entry(sha256)

    def holds(self, sha256: str) -> bool:
        """Whether the episode with this hash is listed.

        Raises:
            DatasetError: the manifest is damaged.
        """
        return self._manifest.find(sha256) is not None

    def add_episodes(
        self,
        episodes: Iterable[Episode],
        *,
        compression: Compression = "",
        models_apart: bool | None = None,
    ) -> list[EpisodeEntry]:
        """Add episodes, one entry each in their order; one already there is left alone.

        The manifest is replaced once, after all files are on the disk: killed before
        that, the files lie there unlisted, and adding them again finds them.

        Args:
            episodes: What is added.
            compression: Of the steps.
            models_apart: Keep models beside the episodes, each once; by default large
                ones.

        Raises:
            DatasetError: the manifest is damaged, or the disk is full or not writable.
        """
        added: list[EpisodeEntry] = []

        def stored(episode: Episode) -> tuple[EpisodeEntry, Future[None]]:
            apart = models_apart
            if apart is None:
                apart = len(episode.mjcf) > INSIDE_BYTES
            mjcf_sha256 = ""
            if apart:
                with writable(self.root):
                    mjcf_sha256 = self.models.add(episode.mjcf)
            content = encode_episode(
                episode, compression=compression, model_apart=apart
            )
            entry = _entry_of(content, episode, mjcf_sha256)
            return entry, writers.submit(self._store, entry, content)

        def listed(waiting: Future[tuple[EpisodeEntry, Future[None]]]) -> None:
            entry, written = waiting.result()
            written.result()
            added.append(entry)

        # Beside whatever makes the episodes, such as physics. One thread encodes: it
        # holds the interpreter's lock, and several would lose a fifth waiting for it.
        with (
            ThreadPoolExecutor(_WRITERS, "write") as writers,
            ThreadPoolExecutor(1, "encode") as encoder,
        ):
            ahead: deque[Future[tuple[EpisodeEntry, Future[None]]]] = deque()
            for episode in episodes:
                ahead.append(encoder.submit(stored, episode))
                if len(ahead) > _AHEAD:
                    listed(ahead.popleft())
            while ahead:
                listed(ahead.popleft())
        self._list(added)
        return added

    def add_from(
        self, source: Dataset, hashes: Iterable[str], *, tell: Tell = silent
    ) -> list[EpisodeEntry]:
        """Copy episode files as they are, so that answers about them stay valid.

        `tell` gets the files that are copied.

        Raises:
            DatasetError, CorruptEpisode: as for `add_episodes` and `read`.
        """
        added: list[EpisodeEntry] = []
        entries = [source.entry(sha256) for sha256 in hashes]
        for model in models_of(entries):
            with writable(self.root):
                self.models.put(model, source.models.content(model))
        tell(0, len(entries))
        for entry in entries:
            self._store(entry, source.content(entry))
            added.append(entry)
            tell(len(added), len(entries))
        self._list(added)
        return added

    def put(self, entry: EpisodeEntry, content: bytes) -> None:
        """Write the file of an episode that `add_stored` will list; from any thread.

        Raises:
            DatasetError: the disk is full or not writable.
        """
        path = self.path_of(entry)
        with writable(self.root):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, content, sync_name=False)

    def has_stored(self, entry: EpisodeEntry) -> bool:
        """Whether the whole file of an episode lies in its place, listed or not."""
        path = self.path_of(entry)
        return path.is_file() and sha256_file(path) == entry.sha256

    def add_stored(self, entries: Iterable[EpisodeEntry]) -> None:
        """List episodes whose files were put in their places.

        Raises:
            DatasetError: as for `add_episodes`.
        """
        self._list(entries)

    def adopt(self, paths: Iterable[Path]) -> list[EpisodeEntry]:
        """List files that lie in their place already, as after a crash.

        Raises:
            EpisodeError: one cannot be read.
            DatasetError: as for `add_episodes`.
        """
        added: list[EpisodeEntry] = []
        for path in paths:
            content, name = read_file(path, EPISODE_BYTES), str(path)
            episode = decode_episode(content, name, self.models.text)
            added.append(_entry_of(content, episode, model_apart(content, name)))
        self._list(added)
        return added

    def unlist(self, hashes: Iterable[str]) -> None:
        """Take episodes out of the manifest; their files stay.

        Raises:
            DatasetError: as for `add_episodes`.
        """
        gone = frozenset(hashes)
        self._manifest.change(
            lambda known: {k: e for k, e in known.items() if k not in gone}
        )

    def read(self, sha256: str) -> Episode:
        """Read a whole episode.

        Raises:
            DatasetError: there is no such episode, or its file is a link.
            CorruptEpisode: the file is missing, or not what the manifest promises.
            EpisodeError: the file cannot be read by this version.
        """
        entry = self.entry(sha256)
        name = str(self.root / entry.path)
        return decode_episode(self.content(entry), name, self.models.text)

    def features(self, sha256: str, *, keep: bool = True) -> np.ndarray:
        """The feature rows [T, F] of an episode, float32, read-only.

        Args:
            sha256: The episode.
            keep: Keep them in memory, for those who ask again.

        Raises:
            DatasetError, EpisodeError: as for `read`.
        """
        cached = self._features.get(sha256)
        if cached is not None:
            return cached
        entry = self.entry(sha256)
        content = self.content(entry)
        features = decode_features(content, str(self.root / entry.path))
        if keep:
            self._features.put(sha256, features)
        return features

    def clip_features(self, clip: Clip) -> np.ndarray:
        """The feature rows [clip.steps, F] of a clip.

        The first clip of an episode is read alone, the second brings the whole file.

        Raises:
            DatasetError: the clip reaches beyond its episode; else as for `read`.
        """
        entry = self.entry(clip.rollout)
        _require_within(clip, entry.num_steps)
        if entry.tail_sha256 and clip.rollout not in self._touched:
            self._touched.add(clip.rollout)
            with self._file_expected(entry) as path:
                return read_feature_window(path, entry, clip)
        return self.features(clip.rollout)[clip.rows]

    def each_clip_features(
        self, clips: Sequence[Clip]
    ) -> Iterator[tuple[int, np.ndarray]]:
        """The position in `clips` and the feature rows of each, episode by episode.

        Every file is read once, however many clips it holds and however few episodes
        fit into memory.

        Raises:
            DatasetError, EpisodeError: as for `clip_features`.
        """
        positions: dict[str, list[int]] = defaultdict(list)
        for position, clip in enumerate(clips):
            positions[clip.rollout].append(position)
        self._touched.update(positions)
        # Of more than is kept, the first are gone before they are asked for again.
        steps = sum(self.entry(rollout).num_steps for rollout in positions)
        kept = 4 * FEATURE_DIM * steps <= FEATURE_CACHE_BYTES // 2
        for rollout in sorted(positions):
            features = self.features(rollout, keep=kept)
            for position in positions[rollout]:
                _require_within(clips[position], len(features))
                yield position, features[clips[position].rows]

    def content(self, entry: EpisodeEntry) -> bytes:
        """The bytes of an episode file, compared with the manifest on first use.

        Raises:
            DatasetError: the file is a link.
            CorruptEpisode: it is missing, or not what the manifest promises.
        """
        with self._file_expected(entry) as path:
            content = read_file(path, EPISODE_BYTES)
        if entry.sha256 not in self._verified:
            found = sha256_bytes(content)
            if found != entry.sha256:
                raise CorruptEpisode(
                    f"{path} has sha256 {found}, the manifest promises {entry.sha256}; "
                    "restore it from a copy of the data set"
                )
            self._verified.add(entry.sha256)
        return content

    def answers(self) -> AnswerStore:
        """Open the data set's pairs and answers; close it after use.

        Raises:
            AnswerError: the data base cannot be used.
        """
        return AnswerStore.open(self.answers_address)

    def answers_copy(self) -> AnswerStore:
        """A copy of them in memory, as they are now; for those who only read.

        Raises:
            AnswerError: the data base cannot be used.
        """
        return AnswerStore.snapshot(self.answers_address)

    def _list(self, added: Iterable[EpisodeEntry]) -> None:
        """Name episodes in the manifest, once their files cannot be lost any more."""
        new = {entry.sha256: entry for entry in added}
        # Files share directories: one wait for each, not one for every file.
        folders = {(self.root / entry.path).parent for entry in new.values()}
        with writable(self.root):
            for folder in sorted(folders | {folder.parent for folder in folders}):
                fsync_directory(folder)
        self._manifest.change(lambda known: known | new)

    def path_of(self, entry: EpisodeEntry) -> Path:
        """Where the episode's file lies.

        Raises:
            DatasetError: it is, or lies behind, a link.
        """
        path = self.root
        for part in Path(entry.path).parts:
            path = path / part
            if path.is_symlink():
                raise DatasetError(
                    f"{path} is a link, which could lead out of the data set; "
                    "replace it by the file itself"
                )
        return path

    def _store(self, entry: EpisodeEntry, content: bytes) -> None:
        """Put the episode's file in its place; `_list` makes its name lasting."""
        path = self.root / entry.path
        # A file of another length was damaged after it was renamed into place.
        if not path.is_file() or path.stat().st_size != len(content):
            with writable(self.root):
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomically(path, content, sync_name=False)

    @contextmanager
    def _file_expected(self, entry: EpisodeEntry) -> Iterator[Path]:
        path = self.path_of(entry)
        try:
            yield path
        except FileNotFoundError:
            raise CorruptEpisode(
                f"{path} is missing, the manifest promises {entry.bytes} bytes; "
                "restore it from a copy of the data set, or go on without it after "
                f"`gaitpref data recover --dataset {self.root}`"
            ) from None


def _require_within(clip: Clip, num_steps: int) -> None:
    if clip.stop > num_steps:
        raise DatasetError(
            f"clip {clip.key} ends at step {clip.stop}, its episode has {num_steps}; "
            "the answers belong to another data set"
        )


def _entry_of(content: bytes, episode: Episode, mjcf_sha256: str) -> EpisodeEntry:
    sha256 = sha256_bytes(content)
    tail = content[tail_start(content, len(content), sha256) :]
    return EpisodeEntry(
        sha256=sha256,
        path=rollout_path(sha256),
        bytes=len(content),
        num_steps=episode.num_steps,
        end_reason=episode.end_reason,
        meta=episode.meta,
        tail_sha256=sha256_bytes(tail),
        mjcf_sha256=mjcf_sha256,
    )
