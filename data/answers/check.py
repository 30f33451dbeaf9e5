"""Compares a store of answers with its checksums, row by row."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from .address import Address
from .backend import SqliteBackend, copy_backend
from .rows import ANSWER_COLUMNS, PAIR_COLUMNS, RATER_COLUMNS, row_crc32
from .sqlite_file import SCHEMA_VERSION, connect_copy, open_unchanged

_SCHEMA = "SELECT type, name, tbl_name, sql FROM sqlite_master ORDER BY type, name"

_TABLES = {"rater": RATER_COLUMNS, "pair": PAIR_COLUMNS, "answer": ANSWER_COLUMNS}


@dataclass(frozen=True)
class DamagedRow:
    """Something of the store that is not as it was written."""

    message: str
    answers: tuple[str, ...] = ()
    """Ids of the answers that are touched, where they can be told."""


@dataclass(frozen=True)
class Asked:
    """What an answer is about, without what it says."""

    answer_id: str
    clips: tuple[tuple[str, int], tuple[str, int]]
    """Episode and first step behind the clip, of both."""


def asked(address: Address) -> list[Asked]:
    """What every answer of the store is about, corrected ones too.

    Raises:
        AnswerError, sqlite3.Error: it cannot be read.
    """
    with closing(copy_backend(address)) as copy:
        rows = copy.execute(
            "SELECT answer_id, a_rollout, a_start + a_steps, b_rollout, "
            "b_start + b_steps FROM answer JOIN pair USING (pair_id) "
            "ORDER BY answer.position",
            {},
        )
        return [Asked(row[0], (row[1:3], row[3:5])) for row in rows]


def damaged_rows(address: Address) -> list[DamagedRow]:
    """Everything that is wrong with the store; nothing in it is changed.

    Of PostgreSQL a copy is looked at: its own pages are the server's business.

    Raises:
        AnswerError, sqlite3.Error: it cannot be opened.
    """
    try:
        return _damaged_rows(address)
    except UnicodeDecodeError:
        # SQLite names what is wrong in the words of the file, and those are damaged.
        return [DamagedRow("the data base is damaged: a text in it is no UTF-8")]


def _opened(address: Address) -> sqlite3.Connection:
    if isinstance(address, Path):
        return open_unchanged(address)
    copy = copy_backend(address)
    assert isinstance(copy, SqliteBackend)
    return copy.connection


def _damaged_rows(address: Address) -> list[DamagedRow]:
    with closing(_opened(address)) as connection:
        found = [
            DamagedRow(f"the data base is damaged: {row[0]}")
            for row in connection.execute("PRAGMA integrity_check")
            if row[0] != "ok"
        ]
        found += [
            DamagedRow(f"a row of {row[0]} points to a missing row of {row[2]}")
            for row in connection.execute("PRAGMA foreign_key_check")
        ]
        (version,) = connection.execute("PRAGMA user_version").fetchone()
        if version == SCHEMA_VERSION and not found:
            found += _changed_schema(connection)
            found += [
                DamagedRow(
                    f"the {table} {row[0]!r} is not as it was written",
                    (str(row[0]),) if table == "answer" else (),
                )
                for table, columns in _TABLES.items()
                for row in connection.execute(f"SELECT {columns} FROM {table}")
                if row_crc32(*row[:-1]) != row[-1]
            ]
    return found


def _changed_schema(connection: sqlite3.Connection) -> list[DamagedRow]:
    """Tables, views and triggers that are not those of a new store."""
    with closing(connect_copy(Path("no such file"))) as new:
        expected = set(new.execute(_SCHEMA).fetchall())
    found = set(connection.execute(_SCHEMA).fetchall())
    # What ANALYZE leaves behind says nothing about the answers.
    changed = {row for row in expected ^ found if not row[1].startswith("sqlite_stat")}
    return [
        DamagedRow(f"the definition of {kind} {name} is not that of this version")
        for kind, name in sorted({(row[0], row[1]) for row in changed})
    ]
