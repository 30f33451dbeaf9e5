"""The manifest of a data set: which files there are, and what each one is."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from data.episode_records import END_REASONS, EndReason, EpisodeMeta
from data.errors import DatasetError
from data.features import features_sha256
from data.schema import schema_sha256

FORMAT_VERSION = 1
_SHA256 = re.compile(r"[0-9a-f]{64}")


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


def rollout_path(sha256: str) -> str:
    """Where the episode with this hash lies in a data set."""
    return f"rollouts/{sha256[:2]}/{sha256}.mcap"


def encode_manifest(entries: Iterable[EpisodeEntry]) -> bytes:
    """The manifest's bytes; the same entries in any order give the same bytes."""
    files = [
        {
            "path": entry.path,
            "bytes": entry.bytes,
            "sha256": entry.sha256,
            "num_steps": entry.num_steps,
            "end_reason": entry.end_reason,
            "meta": entry.meta.to_strings(),
        }
        for entry in sorted(entries, key=lambda entry: entry.sha256)
    ]
    manifest = {
        "format_version": FORMAT_VERSION,
        "schema_sha256": schema_sha256(),
        "features_sha256": features_sha256(),
        "files": files,
    }
    return (json.dumps(manifest, indent=1) + "\n").encode()


def decode_manifest(content: bytes, name: str) -> dict[str, EpisodeEntry]:
    """Entries by hash, sorted; `name` is what errors call the manifest.

    Raises:
        DatasetError: it is damaged, unsafe, or of another version.
    """
    try:
        manifest = json.loads(content)
        for key, expected in (
            ("format_version", FORMAT_VERSION),
            ("schema_sha256", schema_sha256()),
            ("features_sha256", features_sha256()),
        ):
            if manifest[key] != expected:
                raise DatasetError(
                    f"{name} has {key} {str(manifest[key])[:64]}, this version reads "
                    f"{expected}; read it with the version of gaitpref that wrote it"
                )
        entries = [_entry(file, name) for file in manifest["files"]]
    except DatasetError:
        raise
    except Exception as error:
        found = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise DatasetError(
            f"{name} is damaged ({found}); restore it from a copy of the data set"
        ) from error
    return {e.sha256: e for e in sorted(entries, key=lambda e: e.sha256)}


def _entry(file: dict[str, Any], name: str) -> EpisodeEntry:
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
    if not (type(num_bytes) is int and type(num_steps) is int and num_steps > 0):
        raise ValueError(f"{path} has {num_bytes!r} bytes and {num_steps!r} steps")
    if end_reason not in END_REASONS:
        raise ValueError(f"{path} has the end_reason {end_reason!r}")
    meta = EpisodeMeta.from_strings(file["meta"])
    return EpisodeEntry(sha256, path, num_bytes, num_steps, end_reason, meta)
