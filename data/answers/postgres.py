"""PostgreSQL as the data base of answers, for labs where several hosts serve the page.

Needs the extra `postgres`. One data base, or one schema of it, holds the answers of one
data set.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import resources
from typing import Any

# The driver; imported here so that its absence is told at once.
import psycopg as psycopg
from sqlalchemy import Connection, Engine, create_engine, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, OperationalError, SQLAlchemyError

from data.errors import AnswerError, AnswersUnreachable

from .address import Address, Values, failure
from .rows import ANSWER_COLUMNS, PAIR_COLUMNS, RATER_COLUMNS
from .sqlite_file import APPLICATION_ID, BUSY_TIMEOUT_MS, SCHEMA_VERSION

OLDEST_VERSION = 3
"""Version of the first schema that was written for PostgreSQL."""
_COPIED = {
    "rater": (RATER_COLUMNS, "rowid"),
    "pair": (PAIR_COLUMNS, "position"),
    "answer": (ANSWER_COLUMNS, "position"),
}


class PostgresBackend:
    """Connections of a pool: one for each reader, one for the transaction."""

    def __init__(self, engine: Engine, address: str) -> None:
        self.address: Address = address
        self.name = engine.url.render_as_string(hide_password=True).replace(
            "+psycopg", ""
        )
        self._engine = engine
        # One statement needs no transaction around it, whose begin and end take a way
        # to the server each.
        self._single = engine.execution_options(isolation_level="AUTOCOMMIT")
        self._lock = threading.RLock()
        self._open: Connection | None = None
        """Connection of the open transaction; only for who holds the lock."""
        self._waits = True
        """Whether a commit waits for the disk; only for who holds the lock."""

    @staticmethod
    def open(address: str) -> PostgresBackend:
        """Connect, and make the tables if there are none.

        Raises:
            AnswersUnreachable: no server is there, or it does not let us in.
            AnswerError: the tables are of a newer version.
        """
        try:
            url = make_url(address).set(drivername="postgresql+psycopg")
            # A connection the server ended meanwhile is replaced before it is used.
            engine = create_engine(
                url, pool_pre_ping=True, connect_args={"connect_timeout": 10}
            )
        except (ArgumentError, ValueError) as error:
            raise AnswerError(
                f"--answers is no URL of PostgreSQL ({error}); write "
                "postgresql://USER@HOST/DATABASE"
            ) from None
        backend = PostgresBackend(engine, address)
        try:
            backend._reach()
            with backend.transaction():
                backend._bring_up_to_date()
        except BaseException:
            backend.close()
            raise
        return backend

    def execute(self, query: str, values: Values) -> list[Any]:
        try:
            with self._lock:
                if self._open is not None:
                    return _rows(self._open, query, values)
            with self._single.connect() as connection:
                return _rows(connection, query, values)
        except (SQLAlchemyError, UnicodeError) as error:
            raise self._failure(error) from error

    def execute_many(self, query: str, rows: Sequence[Values]) -> None:
        if rows and self._open is not None:
            self._open.execute(text(query), rows)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        with self._lock:
            if self._open is not None:
                yield
                return
            try:
                with self._engine.begin() as connection:
                    # One writer at a time, as with a file; released with the commit.
                    connection.execute(
                        text(f"SET LOCAL lock_timeout = {BUSY_TIMEOUT_MS}")
                    )
                    connection.execute(
                        text("SELECT pg_advisory_xact_lock(:key)"),
                        {"key": APPLICATION_ID},
                    )
                    if not self._waits:
                        connection.execute(text("SET LOCAL synchronous_commit = off"))
                    self._open = connection
                    try:
                        yield
                    finally:
                        self._open = None
            except (SQLAlchemyError, UnicodeError) as error:
                raise self._failure(error) from error

    @property
    def in_transaction(self) -> bool:
        # Who gets the lock while there is a transaction is the thread it is of.
        with self._lock:
            return self._open is not None

    @contextmanager
    def together(self) -> Iterator[None]:
        with self._lock:
            if self._open is not None or not self._waits:
                yield
                return
            self._waits = False
            try:
                yield
            finally:
                self._waits = True
                # The log is one stream: a commit that waits for it, and has written to
                # it, takes along what was written before.
                with self.transaction():
                    self.execute("UPDATE gaitpref_store SET version = version", {})

    def copy_to(self, copy: sqlite3.Connection) -> None:
        """Put raters, pairs and answers, as of one moment, into an empty SQLite store.

        Raises:
            AnswerError: the data base fails.
        """
        try:
            with self._engine.connect() as connection:
                connection = connection.execution_options(
                    isolation_level="REPEATABLE READ", postgresql_readonly=True
                )
                copy.execute("BEGIN")
                for table, (columns, order) in _COPIED.items():
                    marks = ", ".join("?" * len(columns.split(", ")))
                    query = f"SELECT {columns} FROM {table} ORDER BY {order}"
                    copy.executemany(
                        f"INSERT INTO {table} ({columns}) VALUES ({marks})",
                        map(tuple, connection.execute(text(query))),
                    )
                copy.execute("COMMIT")
        except SQLAlchemyError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        self._engine.dispose()

    def _reach(self) -> None:
        try:
            self._engine.connect().close()
        except OperationalError as error:
            found = " ".join(str(error.orig or error).split())
            raise AnswersUnreachable(
                f"{self.name} cannot be reached: {found}; start the server, or mend "
                "the address, and try again"
            ) from error

    def _bring_up_to_date(self) -> None:
        """Make what is missing; part of a transaction, and nobody else writes."""
        self.execute("CREATE TABLE IF NOT EXISTS gaitpref_store (version BIGINT)", {})
        rows = self.execute("SELECT max(version) FROM gaitpref_store", {})
        version = rows[0][0] or 0
        if version > SCHEMA_VERSION:
            raise AnswerError(
                f"{self.name} has version {version}, this gaitpref reads up to "
                f"{SCHEMA_VERSION}; install a newer gaitpref"
            )
        for number in range(max(version + 1, OLDEST_VERSION), SCHEMA_VERSION + 1):
            for statement in _statements(number):
                self.execute(statement, {})
            self.execute(
                "INSERT INTO gaitpref_store (version) VALUES (:version)",
                {"version": number},
            )

    def _failure(self, error: Exception) -> AnswerError:
        # SQLAlchemy adds the statement and a link; the driver's own words are enough.
        return failure(self.name, getattr(error, "orig", None) or error)


def _rows(connection: Connection, query: str, values: Values) -> list[Any]:
    result = connection.execute(text(query), dict(values))
    return [tuple(row) for row in result] if result.returns_rows else []


def _statements(number: int) -> list[str]:
    """The statements of a migration: functions hold semicolons of their own."""
    file = resources.files("data") / "migrations" / "postgres" / f"{number:04d}.sql"
    # A colon in front of a word would be a parameter.
    content = file.read_text(encoding="utf-8").replace(":", "\\:")
    return content.split("\n--;\n")
