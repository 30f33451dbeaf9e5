"""What the store of answers asks of a data base, and SQLite as one."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from data.errors import AnswerError

from .address import Address, Values, failure
from .sqlite_file import SCHEMA_VERSION, connect, connect_copy


class Backend(Protocol):
    """A data base that holds the tables of the store.

    The statements are the same for all: named parameters, and SQL that SQLite and
    PostgreSQL read alike. One backend may be shared by the threads of a process.
    """

    @property
    def address(self) -> Address:
        """What opens it again."""
        ...

    @property
    def name(self) -> str:
        """What errors call it; without passwords."""
        ...

    def execute(self, query: str, values: Values) -> list[Any]:
        """The rows of one statement. Raises AnswerError if the data base fails."""
        ...

    def execute_many(self, query: str, rows: Sequence[Values]) -> None:
        """One statement for each of `rows`, inside a transaction."""
        ...

    def transaction(self) -> Any:
        """A context that is on the disk when it ends, or never was.

        No other process or thread writes meanwhile. Inside another one it is a part of
        that one. Raises AnswerError if the data base fails.
        """
        ...

    @property
    def in_transaction(self) -> bool:
        """Whether this thread is inside `transaction`."""
        ...

    def together(self) -> Any:
        """A context whose transactions are on the disk when it ends, not before.

        Each is whole by itself, and one that fails takes none of the others along; the
        disk is waited for once. Inside a transaction it changes nothing. Raises
        AnswerError if the data base fails.
        """
        ...

    def close(self) -> None:
        """Let go of it; nothing is pending."""
        ...


def open_backend(address: Address) -> Backend:
    """The data base at `address`, brought up to date, made if it is missing.

    Raises:
        AnswerError: it cannot be used, or is of a newer version.
    """
    if isinstance(address, Path):
        return SqliteBackend(connect(address), address)
    return _postgres(address)


def copy_backend(address: Address) -> Backend:
    """A copy in memory of the data base at `address`; empty if there is no file.

    Raises:
        AnswerError: it cannot be used, or is of a newer version.
    """
    if isinstance(address, Path):
        return SqliteBackend(connect_copy(address), address)
    postgres = _postgres(address)
    try:
        # A file that is not there gives an empty store.
        copy = connect_copy(Path(postgres.name))
        postgres.copy_to(copy)
        return SqliteBackend(copy, address, postgres.name)
    finally:
        postgres.close()


def _postgres(url: str) -> Any:
    # Imported here: few have a server, and it takes two packages of its own.
    try:
        from .postgres import PostgresBackend
    except ModuleNotFoundError as error:
        raise AnswerError(
            f"answers in PostgreSQL need the package {error.name}, which is not "
            "installed: pip install -e '.[postgres]' -c constraints.txt"
        ) from None
    return PostgresBackend.open(url)


class SqliteBackend:
    """A connection in autocommit mode, shared by threads one after the other."""

    def __init__(
        self, connection: sqlite3.Connection, address: Address, name: str = ""
    ) -> None:
        self.connection = connection
        self.address: Address = address
        self.name = name or str(address)
        self._lock = threading.RLock()

    def execute(self, query: str, values: Values) -> list[Any]:
        try:
            with self._lock:
                return self.connection.execute(query, values).fetchall()
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise failure(self.name, error) from error

    def execute_many(self, query: str, rows: Sequence[Values]) -> None:
        self.connection.executemany(query, rows)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        with self._lock:
            if self.connection.in_transaction:
                yield
                return
            try:
                # Taking the write lock at once cannot fail half-way through.
                self.connection.execute("BEGIN IMMEDIATE")
                try:
                    yield
                    self.connection.execute("COMMIT")
                except BaseException:
                    if self.connection.in_transaction:
                        self.connection.execute("ROLLBACK")
                    raise
            except (sqlite3.Error, UnicodeDecodeError) as error:
                raise failure(self.name, error) from error

    @property
    def in_transaction(self) -> bool:
        # Who gets the lock while there is a transaction is the thread it is of.
        with self._lock:
            return self.connection.in_transaction

    @contextmanager
    def together(self) -> Iterator[None]:
        with self._lock:
            if self.connection.in_transaction:
                yield
                return
            (waits,) = self.execute("PRAGMA synchronous", {})[0]
            before = self.connection.total_changes
            self.execute("PRAGMA synchronous = NORMAL", {})
            try:
                yield
            finally:
                self.execute(f"PRAGMA synchronous = {waits}", {})
                if self.connection.total_changes != before:
                    # The log is one file: a commit that waits for it takes along what
                    # was written to it before.
                    with self.transaction():
                        self.execute(f"PRAGMA user_version = {SCHEMA_VERSION}", {})

    def close(self) -> None:
        with self._lock:
            self.connection.close()
