"""A whole data set as one file: an uncompressed zip with the manifest first.

Uncompressed, because noisy floats do not shrink, and because an archive can then not
unpack to more than its own size. The answers travel as lines of JSON, never as a data
base file that somebody else wrote.
"""

from __future__ import annotations

import re
import secrets
import shutil
import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from data.answers.lines import from_lines, to_lines
from data.answers.store import AnswerStore
from data.episodes.model_store import MODELS, ModelStore, model_path
from data.errors import DatasetError, GaitprefError
from data.files.files import (
    BoundedFile,
    fsync_directory,
    open_regular,
    read_file,
    replace_directory,
    require_replaceable,
    sha256_bytes,
)
from data.files.limits import (
    ANSWERS_BYTES,
    ARCHIVE_DIRECTORY_BYTES,
    EPISODE_BYTES,
    MANIFEST_BYTES,
    MODEL_BYTES,
    TEXT_BYTES,
)
from data.files.telling import Tell, silent

from .dataset import ANSWERS_NAME, Dataset
from .manifest import EpisodeEntry, decode_manifest, encode_manifest, models_of
from .manifest_file import MANIFEST_NAME, writable

LINES_NAME = "answers.jsonl"
CARD_NAME = "README.md"
_TIME = (1980, 1, 1, 0, 0, 0)
"""The earliest a zip knows: equal data sets give equal archives."""
_PIECE_BYTES = 2**20
_LIMITS = {
    MANIFEST_NAME: MANIFEST_BYTES,
    LINES_NAME: ANSWERS_BYTES,
    CARD_NAME: TEXT_BYTES,
}
"""Limits of the files that are no episodes."""
_ALLOWED = re.compile(
    r"manifest\.json|answers\.jsonl|README\.md|models/[0-9a-f]{64}\.xml"
    r"|rollouts/[0-9a-f]{2}/[0-9a-f]{64}\.mcap"
)


def pack(dataset: Dataset, archive: Path, *, tell: Tell = silent) -> int:
    """Write a data set to one file; gives its bytes. `tell` gets the episodes in it.

    Raises:
        DatasetError: the disk is full or not writable.
        FileError: something else than a file is there.
        EpisodeError, AnswerError: something in the data set is damaged.
    """
    require_replaceable(archive)
    entries = dataset.entries()
    with dataset.answers_copy() as store:
        lines = "".join(f"{line}\n" for line in to_lines(store))
    partial = archive.with_name(f".{archive.name}.{secrets.token_hex(8)}.tmp")
    with writable(archive.parent):
        try:
            with zipfile.ZipFile(partial, "x") as file:
                _put(file, MANIFEST_NAME, encode_manifest(entries))
                _put(file, LINES_NAME, lines.encode())
                card = dataset.root / CARD_NAME
                if card.exists():
                    _put(file, CARD_NAME, read_file(card, TEXT_BYTES))
                for model in models_of(entries):
                    _put(file, model_path(model), dataset.models.content(model))
                for done, entry in enumerate(entries, start=1):
                    _put(file, entry.path, dataset.content(entry))
                    tell(done, len(entries))
            partial.replace(archive)
            fsync_directory(archive.parent)
        finally:
            partial.unlink(missing_ok=True)
    return archive.stat().st_size


def _put(file: zipfile.ZipFile, name: str, content: bytes) -> None:
    file.writestr(zipfile.ZipInfo(name, _TIME), content)


def unpack(archive: Path, root: Path, *, tell: Tell = silent) -> Dataset:
    """Make a data set out of an archive, checked file by file; `root` must be new.

    `tell` gets the episodes that are there.

    Raises:
        DatasetError: `root` exists, or the archive is damaged, incomplete, or holds
            what no archive of a data set may.
        AnswerError: its answers are damaged.
        FileError: the path of the archive leads to something else.
    """
    if root.exists():
        raise DatasetError(f"{root} is there already; give a new directory, then merge")
    partial = root.with_name(f".{root.name}.{secrets.token_hex(8)}.tmp")
    try:
        with open_regular(archive) as file, writable(root.parent):
            _unpack_into(partial, file, archive, tell)
            replace_directory(partial, root)
    except FileNotFoundError as error:
        raise DatasetError(f"{error.filename} is missing; give the archive") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return Dataset.open(root)


def _unpack_into(partial: Path, stream: BinaryIO, archive: Path, tell: Tell) -> None:
    """Write everything that is in an archive to a new directory."""
    with _foreign(archive):
        bounded = BoundedFile(stream, ARCHIVE_DIRECTORY_BYTES)
        file = zipfile.ZipFile(cast(BinaryIO, bounded))
    members = _members(file, archive)
    content = _get(file, members[MANIFEST_NAME], archive)
    entries = decode_manifest(content, f"{archive}/{MANIFEST_NAME}")
    _require_promised(entries, members, archive)
    content = _get(file, members[LINES_NAME], archive)
    with _foreign(archive):
        lines = content.decode().splitlines()
    partial.mkdir(parents=True)
    if lines:
        # Before anything large: what is wrong shows here as soon as there.
        with AnswerStore.open(partial / ANSWERS_NAME) as store:
            from_lines(store, lines, f"{archive}/{LINES_NAME}")
    models = ModelStore(partial)
    for model in models_of(entries.values()):
        content = _get(file, members[model_path(model)], archive)
        if sha256_bytes(content) != model:
            raise _bad(archive, f"{model_path(model)} is not what its name says")
        models.put(model, content)
    for done, entry in enumerate(entries.values(), start=1):
        content = _get(file, members[entry.path], archive)
        if sha256_bytes(content) != entry.sha256:
            raise _bad(archive, f"{entry.path} is not what its name says")
        (partial / entry.path).parent.mkdir(parents=True, exist_ok=True)
        (partial / entry.path).write_bytes(content)
        tell(done, len(entries))
    (partial / "rollouts").mkdir(exist_ok=True)
    (partial / MANIFEST_NAME).write_bytes(encode_manifest(entries.values()))
    if CARD_NAME in members:
        card = _get(file, members[CARD_NAME], archive)
        (partial / CARD_NAME).write_bytes(card)


@contextmanager
def _foreign(archive: Path) -> Iterator[None]:
    """Whatever parsing foreign bytes raises is one thing to a caller."""
    try:
        yield
    except GaitprefError:
        raise
    except Exception as error:
        told = " ".join(str(error).split())[:200] or type(error).__name__
        raise _bad(archive, told) from error


def _members(file: zipfile.ZipFile, archive: Path) -> dict[str, zipfile.ZipInfo]:
    """The archive's files by name, none of which leads or grows anywhere."""
    members: dict[str, zipfile.ZipInfo] = {}
    room = archive.stat().st_size
    for member in file.infolist():
        name = member.filename
        mode = member.external_attr >> 16
        if not _ALLOWED.fullmatch(name) or name in members:
            raise _bad(archive, f"it may not hold {name[:120]!r}")
        if stat.S_IFMT(mode) not in (0, stat.S_IFREG):
            raise _bad(archive, f"{name} is a link or a device")
        if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & 1:
            raise _bad(archive, f"{name} is compressed or encrypted")
        largest = MODEL_BYTES if name.startswith(MODELS) else EPISODE_BYTES
        if member.file_size > _LIMITS.get(name, largest):
            raise _bad(archive, f"{name} claims to have {member.file_size} bytes")
        room -= member.file_size
        if room < 0:
            raise _bad(archive, "it claims to hold more than its own size")
        members[name] = member
    for name in (MANIFEST_NAME, LINES_NAME):
        if name not in members:
            raise _bad(archive, f"it has no {name}")
    return members


def _require_promised(
    entries: dict[str, EpisodeEntry],
    members: dict[str, zipfile.ZipInfo],
    archive: Path,
) -> None:
    """Make sure that what the archive's manifest promises is there, and no more."""
    promised = {entry.path for entry in entries.values()}
    promised |= {model_path(model) for model in models_of(entries.values())}
    found = {name for name in members if name.endswith((".mcap", ".xml"))}
    for name in sorted(promised ^ found)[:1]:
        reason = "is missing" if name in promised else "is not in the manifest"
        raise _bad(archive, f"{name} {reason}")


def _get(file: zipfile.ZipFile, member: zipfile.ZipInfo, archive: Path) -> bytes:
    """A member's bytes; their checksum is compared by `zipfile`."""
    with _foreign(archive), file.open(member) as stream:
        content = b"".join(iter(lambda: stream.read(_PIECE_BYTES), b""))
        if len(content) != member.file_size:
            raise ValueError(f"{member.filename} has another size than promised")
        return content


def _bad(archive: Path, reason: str) -> DatasetError:
    return DatasetError(
        f"{archive} is no sound archive of a data set: {reason}; nothing was unpacked, "
        "get it again from one you trust"
    )
