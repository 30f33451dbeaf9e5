"""The network in a file of others, whatever kind of file it is."""

from __future__ import annotations

from pathlib import Path

from data.files.files import read_file
from data.files.limits import POLICY_BYTES
from policy.networks.recipe import NetworkError
from policy.training.others import writer_of_bytes

from .adapting import ACTS, GUESSES, chained, files_of
from .found import Found, checked
from .onnx_file import read_onnx
from .rsl_checkpoint import read_checkpoint
from .script_file import read_script


def read_network(path: Path, activation: str | None = None) -> Found:
    """The network in `path`: a checkpoint of rsl_rl, TorchScript or ONNX; of two
    TorchScript files where the other lies beside it.

    Raises:
        FileError: the path leads to no file.
        NetworkError: the file is something else, or a network that is not taken.
    """
    if parts := files_of(path):
        found = chained(*(_read(parts[part], None) for part in (GUESSES, ACTS)))
    else:
        found = _read(path, activation)
    try:
        return checked(found)
    except NetworkError as error:
        raise NetworkError(f"{path}: {error}") from None


def _read(path: Path, activation: str | None) -> Found:
    try:
        content = read_file(path, POLICY_BYTES)
    except FileNotFoundError:
        raise NetworkError(f"there is no file {path}") from None
    writer = writer_of_bytes(content)
    try:
        if "ONNX" in writer or path.suffix == ".onnx":
            return read_onnx(content, path.parent)
        if "TorchScript" in writer:
            return read_script(content)
        if writer:
            raise NetworkError(f"it is {writer}")
        return read_checkpoint(content, activation)
    except NetworkError as error:
        raise NetworkError(f"{path}: {error}") from None
