"""Messages of a ROS 2 bag in sqlite3: one file, which may come from a stranger."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from data.files.limits import BAG_CHUNK_BYTES

MAGIC = b"SQLite format 3\0"


class Stored(NamedTuple):
    """A message as it was written."""

    topic: str
    kind: str
    definition: str | None
    """What it consists of, where the bag says so."""
    log_ns: int
    content: bytes


def stored_messages(path: Path, topics: list[str]) -> Iterator[Stored]:
    """Every message of `topics`, in the order of recording.

    Raises:
        ValueError, sqlite3.Error: the file is no bag, or damaged.
    """
    with closing(_opened(path)) as store:
        told = _topics(store)
        definitions = _definitions(store)
        wanted = {id: of for id, of in told.items() if of[0] in topics}
        marks = ", ".join("?" * len(wanted))
        rows = store.execute(
            "SELECT topic_id, timestamp, data FROM messages "
            f"WHERE topic_id IN ({marks}) ORDER BY id",
            list(wanted),
        )
        for id, log_ns, content in rows:
            topic, kind = wanted[id]
            if not isinstance(log_ns, int) or not isinstance(content, bytes):
                raise ValueError(f"a message on {topic} is no message")
            yield Stored(topic, kind, definitions.get(kind), log_ns, content)


def stored_topics(path: Path) -> list[str]:
    """Names of all topics.

    Raises:
        ValueError, sqlite3.Error: as for `stored_messages`.
    """
    with closing(_opened(path)) as store:
        return [name for name, _ in _topics(store).values()]


def _opened(path: Path) -> sqlite3.Connection:
    # Immutable: nothing is written beside it, and a journal beside it is not played.
    place = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    store = sqlite3.connect(place, uri=True)
    store.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, BAG_CHUNK_BYTES)
    # What a file brings of views, triggers and virtual tables is not run.
    store.execute("PRAGMA trusted_schema = OFF")
    store.execute("PRAGMA cell_size_check = ON")
    return store


def _topics(store: sqlite3.Connection) -> dict[int, tuple[str, str]]:
    """Name and type of each topic by its number."""
    tables = store.execute(
        "SELECT name FROM sqlite_master WHERE type = 'table' AND sql LIKE 'CREATE "
        "TABLE%' AND name IN ('messages', 'topics')"
    ).fetchall()
    if len(tables) != 2:
        raise ValueError("it has no tables of topics and messages, so it is no bag")
    found: dict[int, tuple[str, str]] = {}
    rows = store.execute("SELECT id, name, type, serialization_format FROM topics")
    for id, name, kind, form in rows:
        if not (
            isinstance(id, int) and isinstance(name, str) and isinstance(kind, str)
        ):
            raise ValueError("a topic in it is no topic")
        if form != "cdr":
            raise ValueError(f"{name} is written in {form!r}, not in cdr")
        found[id] = name, kind
    return found


def _definitions(store: sqlite3.Connection) -> dict[str, str]:
    """What types consist of; bags older than ROS 2 Iron do not say."""
    tables = store.execute(
        "SELECT 1 FROM sqlite_master WHERE type = 'table' AND sql LIKE 'CREATE TABLE%' "
        "AND name = 'message_definitions'"
    ).fetchall()
    if not tables:
        return {}
    rows = store.execute(
        "SELECT topic_type, encoded_message_definition FROM message_definitions "
        "WHERE encoding = 'ros2msg'"
    )
    return {
        kind: text
        for kind, text in rows
        if isinstance(kind, str) and isinstance(text, str) and text
    }
