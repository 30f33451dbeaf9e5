"""Weights of an ONNX that lie in a file beside it, as torch's exporter writes them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from data.errors import FileError
from data.files.files import read_file
from data.files.limits import POLICY_BYTES
from policy.networks.recipe import NetworkError

_INSIDE = "save it with the weights inside"


def put_inside(model: Any, onnx: Any, folder: Path | None) -> None:
    """Put what lies in files beside an ONNX into the model.

    Args:
        model: The model, which is changed.
        onnx: The package.
        folder: Where its file lies; None if it is no file.

    Raises:
        NetworkError: it names something else than a part of a file of that folder, or
            more than is taken.
    """
    apart = onnx.TensorProto.EXTERNAL
    files: dict[str, bytes] = {}
    room = POLICY_BYTES
    for tensor in _tensors(model.graph):
        if tensor.data_location != apart and not tensor.external_data:
            continue
        told = {entry.key: entry.value for entry in tensor.external_data}
        name = told.get("location", "")
        if name not in files:
            limit = POLICY_BYTES - sum(map(len, files.values()))
            files[name] = _content(folder, name, limit)
        part = _part(tensor.name, told, name, files[name])
        # Many can name the same bytes, and each becomes a copy.
        room -= len(part)
        if room < 0:
            raise NetworkError(
                f"its weights in {name!r} are more than {POLICY_BYTES:,} bytes, and "
                "more is not read; give a smaller network"
            )
        del tensor.external_data[:]
        tensor.data_location = onnx.TensorProto.DEFAULT
        tensor.raw_data = part


def _tensors(graph: Any) -> Iterator[Any]:
    yield from graph.initializer
    for node in graph.node:
        for attribute in node.attribute:
            if attribute.HasField("t"):
                yield attribute.t


def _content(folder: Path | None, name: str, limit: int) -> bytes:
    """The file `name` of the folder, which no path and no link leads out of."""
    shown = repr(name[:80])
    if folder is None:
        raise NetworkError(f"its weights lie in another file, {shown}: {_INSIDE}")
    if name in ("", ".", "..") or {*name} & {*"/\\\0"}:
        raise NetworkError(
            f"its weights lie in {shown}, which is no plain name of a file beside it, "
            f"and nothing else is read: {_INSIDE}"
        )
    try:
        if (folder / name).resolve(strict=True).parent != folder.resolve():
            raise NetworkError(
                f"its weights lie in {shown}, a link that leads elsewhere: {_INSIDE}"
            )
        return read_file(folder / name, limit)
    except FileError as error:
        raise NetworkError(f"its weights lie in another file: {error}") from None
    except (OSError, RuntimeError) as error:
        raise NetworkError(
            f"its weights lie in {shown}, which cannot be read beside it "
            f"({type(error).__name__}): copy both files together, or {_INSIDE}"
        ) from None


def _part(tensor: str, told: dict[str, str], name: str, content: bytes) -> bytes:
    """The bytes of one tensor, which must be in the file."""
    offset = _whole(tensor, told, "offset", 0)
    length = _whole(tensor, told, "length", max(0, len(content) - offset))
    if offset + length > len(content):
        raise NetworkError(
            f"its weights {tensor[:60]!r} end at byte {offset + length:,} of "
            f"{name[:80]!r}, which has {len(content):,}: copy both files together again"
        )
    return content[offset : offset + length]


def _whole(tensor: str, told: dict[str, str], key: str, default: int) -> int:
    text = told.get(key, str(default))
    if not (text.isascii() and text.isdecimal() and len(text) < 20):
        raise NetworkError(
            f"the {key} of its weights {tensor[:60]!r} must be a whole number, got "
            f"{text[:40]!r}: {_INSIDE}"
        )
    return int(text)
