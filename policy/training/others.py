"""Which other program wrote a file that was given as a policy."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Any

_STARTS = (
    (b"\x89HDF", "an HDF5 file"),
    (b"\x93NUMPY", "a NumPy array"),
    (b"\x89MCAP", "an MCAP recording"),
    (b"SQLite format 3", "an SQLite database"),
    (b"%PDF", "a PDF"),
    (b"<", "a text in XML"),
)


def writer_of_bytes(content: bytes) -> str:
    """What the content of a file is, where it is plainly no file of ours; else empty.

    TorchScript is told before torch looks at it, which warns and names its own options.
    """
    for start, told in _STARTS:
        if content.startswith(start):
            return told
    if content[8:10] == b'{"':
        return "a safetensors file"
    # Field 1 of an ONNX model is its version, a small number, and field 2 its producer.
    if content[:1] == b"\x08" and content[2:3] in (b"\x12", b"\x1a", b"\x3a"):
        return "an ONNX model"
    try:
        names = zipfile.ZipFile(io.BytesIO(content)).namelist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError):
        return ""
    if any(name.endswith("/constants.pkl") for name in names):
        return "TorchScript, as of an exported policy"
    if any(name.endswith(".npy") for name in names):
        return "an archive of NumPy arrays"
    if not any(name.endswith("data.pkl") for name in names):
        return "an archive of other files"
    return ""


def writer_of_payload(payload: Any) -> str:
    """Who wrote what torch has read, where it was not us; else empty."""
    if not isinstance(payload, Mapping):
        return f"torch's file of a {type(payload).__name__}"
    if "model_state_dict" in payload:
        return "a checkpoint of an older RSL-RL, or of a project that uses it"
    if "actor_state_dict" not in payload:
        named = ", ".join(sorted(map(str, payload))[:4])
        return f"torch's file of something else ({named or 'nothing'})"
    return ""


def writer_without_description(payload: Mapping[str, Any]) -> str:
    """Who wrote networks like ours that say nothing of themselves."""
    if "identity" in payload:
        return "the state that a training goes on from"
    return "a checkpoint of RSL-RL without gaitpref's description"
