"""The manifest of a data set: which files there are, and what each one is.

It is JSON with a line for every episode, sorted by hash. So one episode is found in a
file of any length by a few small reads, and version control shows what was added. Every
line carries a checksum of itself, the first one that of all others.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from data.episodes.episode_records import END_REASONS, EndReason, EpisodeMeta
from data.episodes.schema import schema_sha256
from data.errors import DatasetError
from data.features import features_sha256

FORMAT_VERSION = 2
"""1 had no checksums and no `tail_sha256`; it is still read."""
READABLE_VERSIONS = (1, 2)
_SHA256 = re.compile(r"[0-9a-f]{64}")
_LINE_START = b'{"sha256": "'
_CHECK_CHARS = 16


@dataclass(frozen=True)
class EpisodeEntry:
    """What the manifest says of one episode."""

    sha256: str
    """Hash of the file; also its name."""
    path: str
    """Relative to the data set, with forward slashes."""
    bytes: int
    num_steps: int
    end_reason: EndReason
    meta: EpisodeMeta
    tail_sha256: str = ""
    """Hash of the file's end, which holds the checksum of the rest: enough to trust a
    part of the file without hashing all of it. Empty in what version 1 wrote."""
    mjcf_sha256: str = ""
    """Hash of the robot's model that lies beside; empty where it is in the file."""


def rollout_path(sha256: str) -> str:
    """Where the episode with this hash lies in a data set."""
    return f"rollouts/{sha256[:2]}/{sha256}.mcap"


def encode_manifest(entries: Iterable[EpisodeEntry]) -> bytes:
    """The manifest's bytes; the same entries in any order give the same bytes."""
    lines = [
        _encode_line(entry) for entry in sorted(entries, key=lambda entry: entry.sha256)
    ]
    body = b",\n".join(lines)
    header = {
        "format_version": FORMAT_VERSION,
        "schema_sha256": schema_sha256(),
        "features_sha256": features_sha256(),
        "num_files": len(lines),
        "files_sha256": hashlib.sha256(body).hexdigest(),
    }
    return json.dumps(header)[:-1].encode() + b', "files": [\n' + body + b"\n]}\n"


def _encode_line(entry: EpisodeEntry) -> bytes:
    facts = {
        "sha256": entry.sha256,
        "path": entry.path,
        "bytes": entry.bytes,
        "num_steps": entry.num_steps,
        "end_reason": entry.end_reason,
        "meta": entry.meta.to_strings(),
        "tail_sha256": entry.tail_sha256,
    }
    if entry.mjcf_sha256:
        facts["mjcf_sha256"] = entry.mjcf_sha256
    return json.dumps(facts | {"check": _check(facts)}).encode()


def _check(facts: dict[str, Any]) -> str:
    """Checksum of what a line says, however it is spelled."""
    text = json.dumps(facts, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_CHECK_CHARS]


def decode_manifest(content: bytes, name: str) -> dict[str, EpisodeEntry]:
    """Entries by hash, sorted; `name` is what errors call the manifest.

    Raises:
        DatasetError: it is damaged, unsafe, or of another version.
    """
    try:
        manifest = json.loads(content)
        require_readable(manifest, name)
        entries = [_decode_entry(file, name) for file in manifest["files"]]
        if manifest["format_version"] != 1:
            _require_whole(manifest, content)
    except DatasetError:
        raise
    except Exception as error:
        raise damaged(name, error) from error
    return {e.sha256: e for e in sorted(entries, key=lambda e: e.sha256)}


def damaged(name: str, error: Exception) -> DatasetError:
    """What to say of a manifest that `error` happened to."""
    found = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    return DatasetError(
        f"{name} is damaged ({found}); restore it from a copy of the data set, or "
        "build it anew from the files with `gaitpref data recover`"
    )


def require_readable(manifest: dict[str, Any], name: str) -> None:
    """Refuse a manifest of another version by name.

    Raises:
        DatasetError: this version does not read it.
    """
    for key, expected in (
        ("format_version", READABLE_VERSIONS),
        ("schema_sha256", (schema_sha256(),)),
        ("features_sha256", (features_sha256(),)),
    ):
        if manifest[key] not in expected:
            versions = " and ".join(str(value) for value in expected)
            raise DatasetError(
                f"{name} has {key} {str(manifest[key])[:64]}, this version reads "
                f"{versions}; read it with the version of gaitpref that wrote it"
            )


def _require_whole(manifest: dict[str, Any], content: bytes) -> None:
    """Compare the header with the lines behind it."""
    if manifest["num_files"] != len(manifest["files"]):
        raise ValueError(
            f"{len(manifest['files'])} files, {manifest['num_files']} promised"
        )
    _, _, body = content.partition(b"\n")
    body, end, rest = body.rpartition(b"\n]}\n")
    if not end or rest:
        raise ValueError("it was written by another program")
    if hashlib.sha256(body).hexdigest() != manifest["files_sha256"]:
        raise ValueError("the checksum of its lines is wrong")


def decode_line(line: bytes, name: str) -> EpisodeEntry:
    """One line of a manifest of the present version, compared with its checksum.

    Raises:
        DatasetError: its path leads elsewhere.
        ValueError, KeyError, TypeError: it is damaged.
    """
    file = json.loads(line.rstrip(b","))
    facts = {key: value for key, value in file.items() if key != "check"}
    if file["check"] != _check(facts):
        raise ValueError(
            f"the line of {str(file['path'])[:120]} is not what was written"
        )
    return _decode_entry(file, name)


def _decode_entry(file: dict[str, Any], name: str) -> EpisodeEntry:
    """One element of `files`; its checksum is not compared.

    Raises:
        DatasetError: its path leads elsewhere.
        ValueError, KeyError, TypeError: it is damaged.
    """
    if not isinstance(file, dict):
        raise TypeError(f"a file is described by {file!r}")
    sha256, path, end_reason = file["sha256"], file["path"], file["end_reason"]
    if not _SHA256.fullmatch(sha256):
        raise ValueError(f"{sha256!r} is no sha256")
    # One allowed path leaves no room for absolute ones or for "..".
    if path != rollout_path(sha256):
        raise DatasetError(
            f"{name} lists the file {str(path)[:120]!r}, which may only be "
            f"{rollout_path(sha256)!r}; do not use a manifest from a stranger"
        )
    num_bytes, num_steps = file["bytes"], file["num_steps"]
    counts = (num_bytes, num_steps)
    if not all(type(count) is int and count > 0 for count in counts):
        raise ValueError(f"{path} has {num_bytes!r} bytes and {num_steps!r} steps")
    if end_reason not in END_REASONS:
        raise ValueError(f"{path} has the end_reason {end_reason!r}")
    meta = EpisodeMeta.from_strings(file["meta"])
    model = file.get("mjcf_sha256", "")
    if model and not _SHA256.fullmatch(model):
        raise ValueError(f"{path} has the model {model!r}")
    return EpisodeEntry(
        sha256=sha256,
        path=path,
        bytes=num_bytes,
        num_steps=num_steps,
        end_reason=end_reason,
        meta=meta,
        tail_sha256=file.get("tail_sha256", ""),
        mjcf_sha256=model,
    )


def models_of(entries: Iterable[EpisodeEntry]) -> list[str]:
    """Hashes of the models that lie beside `entries`, each once, sorted."""
    return sorted({entry.mjcf_sha256 for entry in entries} - {""})


def line_hash(line: bytes) -> str | None:
    """The hash a line is about; None if it is no line of an episode."""
    found = line[len(_LINE_START) : len(_LINE_START) + 64].decode("ascii", "replace")
    return found if line.startswith(_LINE_START) and _SHA256.fullmatch(found) else None
