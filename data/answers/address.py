"""Where answers are, as a file or as a URL, and what to say when it fails."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from data.errors import AnswerError

from .sqlite_file import advice

Values = Mapping[str, Any]


Address = Path | str
"""A SQLite file, or the URL of a PostgreSQL data base."""


POSTGRES_SCHEMES = ("postgresql://", "postgres://")


def parse_address(text: str) -> Address:
    """What `--answers` means.

    Raises:
        AnswerError: it is no URL of PostgreSQL.
    """
    if not text.startswith(POSTGRES_SCHEMES):
        raise AnswerError(
            "--answers takes postgresql://USER@HOST/DATABASE, got "
            f"{text.partition('://')[0]!r}; answers in a file are those of the data "
            "set, and need no option"
        )
    return text


def failure(name: str, error: Exception) -> AnswerError:
    """What to say of a data base that `error` happened to."""
    found = " ".join(str(error).split())
    return AnswerError(
        f"{name} failed: {found}; nothing of this was stored; "
        f"{advice(error, 'try again when the cause is gone')}"
    )
