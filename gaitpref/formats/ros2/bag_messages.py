"""Messages of a ROS 2 bag, decoded, whatever its files are stored as."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mcap.records import Schema

from data.files.files import open_regular
from data.files.limits import BAG_CHUNK_BYTES
from data.files.unpacking import ZSTD_MAGIC, unpack_zstd_frame
from gaitpref.console.extras import require
from gaitpref.formats.logs.log_findings import Findings
from gaitpref.formats.logs.log_map import LogError

from . import bag_sqlite, mcap_file
from .bag_files import unpacked
from .bag_sqlite import Stored
from .definitions import definition_of

_OTHERS = {
    b"\x04\x22\x4d\x18": "compressed as a whole with lz4; `lz4 -d` unpacks it",
    b"#ROSBAG V": "a bag of ROS 1; `rosbags-convert` makes a ROS 2 bag of it",
}
"""How files begin that are bags, but none of ROS 2."""
_ADVICE = "`ros2 bag convert` makes a bag in MCAP of others"


class Message(NamedTuple):
    """A message of a topic that was asked for."""

    topic: str
    kind: str
    """`sensor_msgs/msg/JointState` and the like."""
    log_s: float
    """When it was recorded."""
    content: Any
    """Decoded; its members are the message's fields."""


def messages(
    files: list[Path], topics: list[str], findings: Findings
) -> Iterator[Message]:
    """Every message of `topics`, file after file, as they were written.

    Raises:
        LogError: a file is no bag, or cannot be read at all.
    """
    for path in files:
        # It remembers messages by a number that means another one in each file.
        decoder = _Decoder()
        with unpacked(path) as place:
            yield from _of_file(path, place, topics, decoder, findings)


def topics_in(files: list[Path]) -> list[str]:
    """Names of all topics, as far as the files can be read."""
    names: set[str] = set()
    for path in files:
        with unpacked(path) as place:
            in_sqlite = _is_sqlite(path, place)
            found = bag_sqlite.stored_topics if in_sqlite else mcap_file.mcap_topics
            names.update(found(place))
    return sorted(names)


class _Decoder:
    """Decodes messages by what they consist of."""

    def __init__(self) -> None:
        self._factory = require("mcap_ros2.decoder", "logs").DecoderFactory()
        self._known: dict[tuple[str, str | None], Callable[[bytes], Any]] = {}

    def __call__(self, stored: Stored) -> Any:
        """The message.

        Raises:
            LogError: nobody says what it consists of.
            Exception: of any kind, where its bytes are something else.
        """
        content = stored.content
        if content[:4] == ZSTD_MAGIC:
            # No message in CDR begins so: rosbag2 packed each by itself.
            content = unpack_zstd_frame(content, BAG_CHUNK_BYTES)
        key = stored.kind, stored.definition
        if key not in self._known:
            text = stored.definition or definition_of(stored.kind)
            if text is None:
                raise LogError(
                    f"{stored.topic} holds {stored.kind}, and the bag does not say "
                    f"what that consists of; {_ADVICE}, which does"
                )
            number = len(self._known) + 1
            schema = Schema(
                id=number, data=text.encode(), encoding="ros2msg", name=stored.kind
            )
            found = self._factory.decoder_for("cdr", schema)
            if found is None:
                raise LogError(f"{stored.topic} holds {stored.kind}, which is no type")
            self._known[key] = found
        return self._known[key](content)


def _of_file(
    path: Path, place: Path, topics: list[str], decoder: _Decoder, findings: Findings
) -> Iterator[Message]:
    stored_in = (
        bag_sqlite.stored_messages
        if _is_sqlite(path, place)
        else mcap_file.mcap_messages
    )
    count = 0
    try:
        for stored in stored_in(place, topics):
            content = decoder(stored)
            yield Message(stored.topic, stored.kind, stored.log_ns / 1e9, content)
            count += 1
    except LogError:
        raise
    except Exception as error:
        # Cut or damaged bytes fail in any way.
        size = path.stat().st_size
        broken = f"{path} breaks off or is damaged within its {size:,} bytes"
        if not count:
            raise LogError(
                f"{broken}, before any message that is asked for ({_short(error)}); "
                "its recording was not finished, or it was not copied whole: copy it "
                "again"
            ) from error
        findings.tell(
            f"{broken}, so its recording was not finished or it was not copied whole: "
            f"the {count:,} messages before that are taken ({_short(error)})"
        )


def _is_sqlite(path: Path, place: Path) -> bool:
    """Whether the file, unpacked in `place`, is in sqlite3, and not in MCAP.

    Raises:
        LogError: it is neither.
    """
    with open_regular(place) as file:
        head = file.read(16)
    if not head:
        raise LogError(
            f"{path} is empty, 0 bytes: nothing was recorded into it; give another bag"
        )
    for magic, what in _OTHERS.items():
        if head.startswith(magic):
            raise LogError(f"{path} is {what}")
    if head == bag_sqlite.MAGIC:
        return True
    if head[: len(mcap_file.MAGIC)] == mcap_file.MAGIC:
        return False
    raise LogError(
        f"{path} cannot be read as a ROS 2 bag, since it begins with {head[:8]!r}; "
        f"{_ADVICE}"
    )


def _short(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:120].strip(": ")
