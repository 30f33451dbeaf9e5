"""Opens the SQLite file of answers: recognises it, brings it up to date, sets it up."""

from __future__ import annotations

import os
import secrets
import shutil
import sqlite3
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from importlib import resources
from pathlib import Path
from urllib.parse import quote

from data.errors import AnswerError
from data.files.files import fsync_directory, require_regular

from .rows import row_crc32

SCHEMA_VERSION = 4
APPLICATION_ID = 0x50524546
""""PREF" in ASCII."""
_OLDEST_SQLITE = (3, 37, 0)
_NOT_WRITABLE = (
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_PERM,
)
_NO_ROOM = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR)
_DAMAGED = "restore it from a copy"
_ADVICE = dict.fromkeys(
    _NOT_WRITABLE,
    "it cannot be written there, as on a disk that is read-only; the answers in it are "
    "safe: commands that only read go on working, to add answers copy the data set to "
    "where you may write",
) | {
    sqlite3.SQLITE_FULL: "the answers in it are safe; make room and try again",
    sqlite3.SQLITE_IOERR: "the disk is full or failed, what was stored is kept; see to "
    "the disk and try again",
    sqlite3.SQLITE_NOMEM: "the answers in it are safe; close other programs",
}
"""What to do about an error that says nothing against the file itself."""
BUSY_TIMEOUT_MS = 30_000
"""SQLite is not fair: one of several writers waits while the others take turns."""


def backup_path(path: Path, version: int) -> Path:
    """Where the store at `path` is kept as it was in an older version."""
    return path.with_name(f"{path.name}.v{version}.backup")


def connect(path: Path) -> sqlite3.Connection:
    """A connection in autocommit mode to an up-to-date store, made if it is missing.

    Raises:
        AnswerError: the file is no store of answers, or of a newer version, or held
            by another program, or cannot be written; or SQLite is too old.
        FileError: the path leads to something else than a file.
    """
    if sqlite3.sqlite_version_info < _OLDEST_SQLITE:
        raise AnswerError(
            f"SQLite {sqlite3.sqlite_version} is too old for {path}, it takes 3.37 or "
            "newer; use a newer Python build"
        )
    if not path.parent.is_dir():
        raise AnswerError(f"{path} cannot be made, its directory is missing; make it")
    if path.exists():
        require_regular(path)
    deadline = time.monotonic() + BUSY_TIMEOUT_MS / 1000
    while True:
        try:
            return _connect_once(path)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            if _code(error) != sqlite3.SQLITE_BUSY:
                raise AnswerError(
                    f"{path} cannot be used as a store of answers ({error}); "
                    f"{advice(error, _DAMAGED)}"
                ) from error
            if time.monotonic() > deadline:
                raise AnswerError(
                    f"{path} is held by another program ({error}); close that and try "
                    "again"
                ) from error
        # SQLite does not wait when two connections turn a new file to WAL at once.
        time.sleep(0.01)


def connect_copy(path: Path) -> sqlite3.Connection:
    """A connection to an up-to-date copy in memory; an empty one if there is no file.

    Raises:
        AnswerError: the file is no store of answers, damaged, or of a newer version.
    """
    copy = sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False)
    try:
        if path.exists():
            with closing(open_unchanged(path)) as source:
                _version(source, path)
                source.backup(copy)
        _set_up(copy, path)
    except BaseException as error:
        copy.close()
        if isinstance(error, sqlite3.Error | UnicodeDecodeError):
            raise AnswerError(
                f"{path} cannot be read as a store of answers ({error}); "
                f"{advice(error, _DAMAGED)}"
            ) from error
        raise
    return copy


def open_unchanged(path: Path) -> sqlite3.Connection:
    """A connection that can only read, even where nobody may write.

    Raises:
        FileError: the path leads to something else than a file.
        sqlite3.Error: the file cannot be read.
    """
    require_regular(path)
    uri = f"file:{quote(str(path.resolve()))}?mode=ro"
    # Without a log beside it the file is all there is, and no lock has to be made.
    log = path.with_name(path.name + "-wal")
    if not log.exists():
        return sqlite3.connect(f"{uri}&immutable=1", uri=True, isolation_level=None)
    connection = sqlite3.connect(uri, uri=True, isolation_level=None)
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.Error as error:
        connection.close()
        if _code(error) not in (*_NOT_WRITABLE, *_NO_ROOM):
            raise
        if not log.stat().st_size:
            return sqlite3.connect(f"{uri}&immutable=1", uri=True, isolation_level=None)
        # A log is read with a file beside it that cannot be made here.
        return _copy_with_log(path, log)
    return connection


def _copy_with_log(path: Path, log: Path) -> sqlite3.Connection:
    """A connection to a copy in memory of a store and of the log beside it."""
    copy = sqlite3.connect(":memory:", isolation_level=None)
    with tempfile.TemporaryDirectory() as folder:
        for file in (path, log):
            shutil.copyfile(file, Path(folder, file.name))
        with closing(sqlite3.connect(Path(folder, path.name))) as source:
            source.backup(copy)
    return copy


def _connect_once(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(
        path,
        timeout=BUSY_TIMEOUT_MS / 1000,
        isolation_level=None,
        check_same_thread=False,
    )
    try:
        _set_up(connection, path)
    except BaseException:
        connection.close()
        raise
    return connection


def _set_up(connection: sqlite3.Connection, path: Path) -> None:
    connection.execute("PRAGMA foreign_keys = ON")
    # One transaction, so that all is asked of one state of the file.
    connection.execute("BEGIN")
    version = _version(connection, path)
    connection.execute("COMMIT")
    connection.execute("PRAGMA synchronous = FULL")
    if version < SCHEMA_VERSION:
        _migrate(connection, path)
    # Readers then never wait for the writer. The mode stays with the file.
    connection.execute("PRAGMA journal_mode = WAL")


def _version(connection: sqlite3.Connection, path: Path) -> int:
    """Schema version of the file, 0 if it is new; nothing in it is changed."""
    application = _pragma(connection, "application_id")
    version = _pragma(connection, "user_version")
    with closing(connection.execute("SELECT count(*) FROM sqlite_master")) as cursor:
        num_objects = cursor.fetchone()[0]
    if application != APPLICATION_ID and (application or version or num_objects):
        raise AnswerError(
            f"{path} is another program's data base (application id {application:#x}, "
            f"not {APPLICATION_ID:#x}); give another path"
        )
    if version > SCHEMA_VERSION:
        raise AnswerError(
            f"{path} has version {version}, this gaitpref reads up to "
            f"{SCHEMA_VERSION}; install a newer gaitpref"
        )
    return version


def _migrate(connection: sqlite3.Connection, path: Path) -> None:
    """Apply the missing migrations, each in a transaction of its own.

    A file is copied before each one, so that an older gaitpref can still be used. A new
    one has nothing to lose, and is made in one go.
    """
    connection.create_function("row_crc32", -1, row_crc32, deterministic=True)
    in_memory = not connection.execute("PRAGMA database_list").fetchone()[2]
    while True:
        # From here on no other process changes the file, which can be copied then.
        connection.execute("BEGIN IMMEDIATE")
        try:
            # Asked again: another process may have been faster.
            version = _version(connection, path)
            if version < SCHEMA_VERSION:
                if version and not in_memory:
                    _back_up(path, backup_path(path, version))
                reached = version + 1 if version else SCHEMA_VERSION
                for number in range(version + 1, reached + 1):
                    for statement in _statements(number):
                        connection.execute(statement)
                connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                connection.execute(f"PRAGMA user_version = {reached}")
            connection.execute("COMMIT")
        except BaseException:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise
        if version >= SCHEMA_VERSION:
            return


def _back_up(path: Path, copy: Path) -> None:
    """Copy a store through SQLite, log and all; whole under its name, or not there."""
    partial = copy.with_name(f".{copy.name}.{secrets.token_hex(8)}.tmp")
    try:
        with (
            closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as a,
            closing(sqlite3.connect(partial)) as b,
        ):
            a.backup(b)
        with partial.open("rb") as file:
            os.fsync(file.fileno())
        partial.replace(copy)
        fsync_directory(copy.parent)
    except OSError as error:
        raise AnswerError(
            f"{path} is of an older version and cannot be copied before it is brought "
            f"up to date ({error.strerror}); make room or give rights, then try again"
        ) from error
    finally:
        partial.unlink(missing_ok=True)


def _statements(number: int) -> Iterator[str]:
    """The statements of a migration, one by one: `executescript` would commit."""
    file = resources.files("data") / "migrations" / f"{number:04d}.sql"
    statement = ""
    for line in file.read_text(encoding="utf-8").splitlines(keepends=True):
        statement += line
        if sqlite3.complete_statement(statement):
            yield statement
            statement = ""


def advice(error: Exception, otherwise: str) -> str:
    """What to do about an error of SQLite; `otherwise` where its kind does not tell."""
    return _ADVICE.get(_code(error), otherwise)


def _code(error: Exception) -> int:
    """The kind of an error of SQLite; its other bytes say more exactly what it was."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    with closing(connection.execute(f"PRAGMA {name}")) as cursor:
        return int(cursor.fetchone()[0])
