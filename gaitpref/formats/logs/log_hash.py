"""The hash by which a log is known."""

from __future__ import annotations

from pathlib import Path

from data.files.files import sha256_bytes, sha256_file


def sha256_of(files: list[Path]) -> str:
    """Hash of a log: of its file, or of the hashes of its files."""
    hashes = [sha256_file(path) for path in files]
    return hashes[0] if len(hashes) == 1 else sha256_bytes("\n".join(hashes).encode())
