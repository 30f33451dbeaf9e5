"""Puts a data set in order after a crash or damage, without deleting anything.

What is replaced moves to `damaged/` of the data set.
"""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from data.episodes.model_store import MODELS
from data.errors import DatasetError, EpisodeError, FileError
from data.files.files import open_regular, read_file, sha256_bytes, sha256_file
from data.files.limits import EPISODE_BYTES
from data.files.telling import Tell, silent

from .dataset import Dataset
from .manifest import EpisodeEntry
from .manifest_file import MANIFEST_NAME, ManifestFile, writable
from .salvage import Salvage, salvage

DAMAGED_NAME = "damaged"


@dataclass(frozen=True)
class RecoveredFile:
    """What became of one file."""

    file: str
    """Relative to the data set where it lay in it."""
    episodes: tuple[str, ...]
    """Hashes of the episodes it gave."""
    kept_steps: int
    lost_steps: int | None
    """Steps that are gone; None if nobody knows how many there were."""
    problem: str
    """Why nothing could be saved; empty if something was."""


def recover(root: Path, *, tell: Tell = silent) -> list[RecoveredFile]:
    """Save what can be saved of a data set, and list every sound file again.

    Looks at files a killed writer left under a temporary name, at files whose bytes are
    not what the manifest promises, and at sound files the manifest does not know. A
    manifest that is damaged itself is built anew. Models that are not what their names
    say are taken away. Files that still have a writer are left alone. `tell` gets the
    files that were looked at.

    Raises:
        DatasetError: the directory is missing or not writable.
    """
    if not (root / "rollouts").is_dir():
        raise DatasetError(
            f"{root} is no data set, it has no rollouts/; give --file to save a single "
            "episode file"
        )
    dataset = _opened(root)
    found = list(_set_models_aside(root))
    entries = dataset.entries()
    partial = sorted((root / "rollouts").rglob(".*.tmp"))
    for done, entry in enumerate(entries):
        tell(done, len(entries) + len(partial))
        if _is_damaged(dataset, entry):
            found.append(_recover_listed(dataset, entry))
    for path in partial:
        if path.is_file() and not _has_writer(path):
            found.append(_recover_file(dataset, path))
    listed = {entry.sha256 for entry in dataset.entries()}
    whole = sorted((root / "rollouts").glob("??/*.mcap"))
    unknown = [path for path in whole if path.stem not in listed]
    looked_at = len(entries) + len(partial)
    for done, path in enumerate(unknown, start=looked_at):
        tell(done, looked_at + len(unknown))
        if path.is_file() and not path.is_symlink():
            found.append(_recover_file(dataset, path))
    return found


def recover_file(dataset: Dataset, path: Path) -> RecoveredFile:
    """Add what can be saved of any episode file to a data set; the file stays.

    Raises:
        DatasetError: the data set is not writable.
        FileError, OSError: the file cannot be read.
    """
    content, name = read_file(path, EPISODE_BYTES), path.name
    return _add(dataset, salvage(content, name, model_of=dataset.models.text), name)


def _opened(root: Path) -> Dataset:
    """The data set, with an empty manifest in the place of one that is damaged."""
    try:
        dataset = Dataset.open(root)
        dataset.entries()
    except (DatasetError, FileError) as error:
        if "this version reads" in str(error):
            raise
        if (root / MANIFEST_NAME).exists():
            _set_aside(root, root / MANIFEST_NAME)
        ManifestFile.create(root)
        dataset = Dataset.open(root)
    return dataset


def _is_damaged(dataset: Dataset, entry: EpisodeEntry) -> bool:
    path = dataset.path_of(entry)
    return not path.is_file() or sha256_file(path) != entry.sha256


def _recover_listed(dataset: Dataset, entry: EpisodeEntry) -> RecoveredFile:
    path = dataset.path_of(entry)
    content = read_file(path, EPISODE_BYTES) if path.is_file() else b""
    mjcf = _robot_of(dataset, entry)
    model_of = dataset.models.text
    saved = salvage(content, entry.sha256, entry=entry, mjcf=mjcf, model_of=model_of)
    if path.is_file():
        _set_aside(dataset.root, path)
    dataset.unlist([entry.sha256])
    return _add(dataset, saved, entry.path)


def _recover_file(dataset: Dataset, path: Path) -> RecoveredFile:
    """A file the manifest does not know: whole, or the beginning of one."""
    name = str(path.relative_to(dataset.root))
    content = read_file(path, EPISODE_BYTES)
    if path.stem == sha256_bytes(content):
        try:
            (entry,) = dataset.adopt([path])
        except EpisodeError as error:
            return RecoveredFile(name, (), 0, None, str(error))
        return RecoveredFile(name, (entry.sha256,), entry.num_steps, 0, "")
    saved = salvage(content, path.name, model_of=dataset.models.text)
    result = _add(dataset, saved, name)
    _set_aside(dataset.root, path)
    return result


def _robot_of(dataset: Dataset, lost: EpisodeEntry) -> str | None:
    """The robot model, out of a sound episode of the same robot."""
    for entry in dataset.entries():
        same = entry.meta.model_sha256 == lost.meta.model_sha256
        if same and entry.sha256 != lost.sha256:
            try:
                return dataset.read(entry.sha256).mjcf
            except EpisodeError:
                continue
    return None


def _add(dataset: Dataset, saved: Salvage, name: str) -> RecoveredFile:
    # A whole file is made again to the letter, so that answers stay valid.
    added = dataset.add_episodes(saved.episodes, models_apart=saved.models_apart)
    hashes = tuple(entry.sha256 for entry in added)
    return RecoveredFile(
        name, hashes, saved.kept_steps, saved.lost_steps, saved.problem
    )


def _set_models_aside(root: Path) -> Iterator[RecoveredFile]:
    """Take away models that are not what their names say, and those a writer left."""
    folder = root / MODELS
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if not path.is_file() or _has_writer(path):
            continue
        if path.name != f"{sha256_file(path)}.xml":
            _set_aside(root, path)
            problem = "no model; put it back from a copy, or record the robot again"
            yield RecoveredFile(f"{MODELS}/{path.name}", (), 0, 0, problem)


def _set_aside(root: Path, path: Path) -> None:
    with writable(root):
        (root / DAMAGED_NAME).mkdir(exist_ok=True)
        target = root / DAMAGED_NAME / path.name.removeprefix(".")
        while target.exists():
            target = target.with_name(target.name + "~")
        path.rename(target)


def _has_writer(path: Path) -> bool:
    with open_regular(path) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        return False
