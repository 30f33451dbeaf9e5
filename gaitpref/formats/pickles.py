"""Reads pickles of strangers without running anything that is in them.

A pickle is a program: it names functions and calls them. Here it can name only what is
on a short list, and each entry of the list is a function of this file.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from data.errors import DatasetError, FileError
from data.files.files import read_file
from data.files.limits import PICKLE_BYTES


class Record:
    """Stands for an object of another project: its attributes, none of its code."""

    def __init__(self, *args: object) -> None:
        if args:
            raise ValueError("an object that wants arguments")

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, dict) or not all(isinstance(k, str) for k in state):
            raise ValueError("an object whose state is no plain dictionary")
        self.__dict__.update(state)


_ARRAY = object()
"""Only a name, by which arrays are told from other classes: it cannot be called, and so
makes no array of a size that somebody made up."""


def _reconstruct(kind: Any, shape: Any, code: Any) -> np.ndarray:
    if kind is not _ARRAY or shape != (0,):
        raise ValueError("an array of another kind, or made before it is filled")
    # The pickle fills it next, and numpy compares its size with the bytes there are.
    return np.ndarray((0,), dtype="b")


def _frombuffer(content: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray:
    return np.frombuffer(content, dtype=dtype).reshape(shape, order=order)


def _scalar(dtype: Any, content: Any = b"") -> Any:
    if not isinstance(dtype, np.dtype) or dtype.hasobject:
        raise ValueError("a number that is none")
    return np.frombuffer(content, dtype=dtype, count=1)[0]


def _encode(text: Any, encoding: Any) -> bytes:
    """How bytes are spelled in old pickles."""
    if not isinstance(text, str) or encoding != "latin1":
        raise ValueError("bytes that are none")
    return text.encode("latin1")


def _dtype(text: Any, *flags: Any) -> np.dtype:
    if not isinstance(text, str):
        raise ValueError("a number type that has no name")
    return np.dtype(text)


_NUMPY: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): _ARRAY,
    ("numpy", "dtype"): _dtype,
    ("_codecs", "encode"): _encode,
}
for _module in ("numpy.core", "numpy._core"):
    _NUMPY[f"{_module}.multiarray", "_reconstruct"] = _reconstruct
    _NUMPY[f"{_module}.multiarray", "scalar"] = _scalar
    _NUMPY[f"{_module}.numeric", "_frombuffer"] = _frombuffer


class _Restricted(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, records: frozenset[tuple[str, str]]) -> None:
        super().__init__(file)
        self._records = records

    def find_class(self, module: str, name: str) -> Callable[..., Any]:
        if (module, name) in self._records:
            return Record
        if (module, name) in _NUMPY:
            return _NUMPY[module, name]
        raise ValueError(f"it names {module}.{name}, which could run code")

    def persistent_load(self, pid: Any) -> Any:
        raise ValueError("it points out of the file")


def load_plain_pickle(
    path: Path, *, records: frozenset[tuple[str, str]] = frozenset()
) -> Any:
    """Lists, numbers, texts, arrays, and `Record`s in the place of listed classes.

    Args:
        path: The pickle.
        records: Module and name of the classes that may be in it.

    Raises:
        FileError: the path leads to no file, or to one that is too large.
        DatasetError: it cannot be read, is damaged, or names anything else.
    """
    try:
        content = read_file(path, PICKLE_BYTES)
        return _Restricted(io.BytesIO(content), records).load()
    except FileError:
        raise
    except Exception as error:
        found = " ".join(f"{error}".split())[:200] or type(error).__name__
        raise DatasetError(
            f"{path} is refused ({found}); only numbers, texts and arrays are taken "
            "from a pickle"
        ) from None


def load_integers(path: Path) -> list[int]:
    """A pickled list or array of whole numbers.

    Raises:
        FileError: the path leads to no file, or to one that is too large.
        DatasetError: it cannot be read, is damaged, or holds anything else.
    """
    values = load_plain_pickle(path)
    try:
        return [int(value) for value in values]
    except (TypeError, ValueError) as error:
        raise DatasetError(f"{path} is no list of whole numbers ({error})") from None
