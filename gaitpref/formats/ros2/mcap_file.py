"""Messages of a ROS 2 bag in MCAP: one file, or a folder with several.

A file whose recording was not finished is read as far as it goes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO, NamedTuple, cast

import mcap.records
from mcap.data_stream import ReadDataStream
from mcap.decoder import DecoderFactory
from mcap.records import Channel, Chunk
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from data.files.files import BoundedFile, open_regular, sha256_bytes, sha256_file
from data.files.limits import BAG_CHUNK_BYTES
from data.files.yaml_file import read_yaml
from gaitpref.console.extras import require

from .bag_findings import Findings
from .bag_map import BagError
from .bag_records import Undecoded, in_order, messages_in, records_of, summary_of

METADATA_NAME = "metadata.yaml"
_OTHERS = {
    b"SQLite format 3\0": "a ROS 2 bag in sqlite3; `ros2 bag convert` makes one in "
    "MCAP of it",
    b"\x28\xb5\x2f\xfd": "compressed as a whole with zstd; `zstd -d` unpacks it",
    b"\x04\x22\x4d\x18": "compressed as a whole with lz4; `lz4 -d` unpacks it",
    b"#ROSBAG V": "a bag of ROS 1; `rosbags-convert` makes a ROS 2 bag of it",
}
"""How files begin that are bags, but none in MCAP."""
_SUFFIXES = {".db3": "sqlite3", ".zstd": "MCAP compressed with zstd", ".bag": "ROS 1"}
_ADVICE = "`ros2 bag convert` turns other bags into MCAP"


class Message(NamedTuple):
    """A message of a topic that was asked for."""

    topic: str
    kind: str
    """`sensor_msgs/msg/JointState` and the like."""
    log_s: float
    """When it was recorded."""
    content: Any
    """Decoded; its members are the message's fields."""


def files_of(bag: Path, findings: Findings) -> list[Path]:
    """The files of a bag in their order.

    Raises:
        BagError: there is none, or they are not in MCAP.
    """
    if not bag.is_dir():
        if not bag.exists():
            raise BagError(f"{bag} is missing; give a bag in MCAP")
        if not bag.is_file():
            raise BagError(f"{bag} is no file; give a bag in MCAP")
        return [bag]
    names = _listed(bag / METADATA_NAME)
    if names is None:
        # Written when a recording ends: one that was cut off has none.
        found = sorted((path.name for path in bag.glob("*.mcap")), key=_by_number)
        names = found
        findings.tell(
            f"{bag} has no {METADATA_NAME}, so its recording was not finished: its "
            f"{len(found)} .mcap files are taken in the order of their names"
        )
    others = [name for name in names if not name.endswith(".mcap")]
    if others:
        what = _SUFFIXES.get(Path(others[0]).suffix, "another form")
        raise BagError(f"{bag} is a bag in {what} ({', '.join(others)}); {_ADVICE}")
    if not names:
        raise BagError(f"{bag} holds no .mcap file; give a bag in MCAP")
    missing = [name for name in names if not (bag / name).is_file()]
    if missing:
        raise BagError(
            f"{bag / METADATA_NAME} names {', '.join(missing)}, missing in the folder; "
            "copy the bag again, or give a single .mcap file of it"
        )
    return [bag / name for name in names]


def sha256_of(files: list[Path]) -> str:
    """Hash of a bag: of its file, or of the hashes of its files."""
    hashes = [sha256_file(path) for path in files]
    return hashes[0] if len(hashes) == 1 else sha256_bytes("\n".join(hashes).encode())


def messages(
    files: list[Path], topics: list[str], findings: Findings
) -> Iterator[Message]:
    """Every message of `topics`, file after file, as they were written.

    Raises:
        BagError: a file is no bag in MCAP, or cannot be read at all.
    """
    decoders = require("mcap_ros2.decoder", "view")
    for path in files:
        with open_regular(path) as opened:
            file = _in_pieces(opened)
            _require_mcap(path, file.read(16))
            # It remembers messages by a number that means another one in each file.
            factory = decoders.DecoderFactory()
            yield from _of_file(path, file, topics, factory, findings)


def _in_pieces(file: BinaryIO) -> IO[bytes]:
    # It does all that an open file does.
    return cast(IO[bytes], BoundedFile(file, BAG_CHUNK_BYTES))


def topics_in(files: list[Path]) -> list[str]:
    """Names of all topics, as far as the files can be read."""
    names: set[str] = set()
    for path in files:
        with open_regular(path) as opened:
            try:
                for record in in_order(_in_pieces(opened)):
                    if isinstance(record, Channel):
                        names.add(record.topic)
            except Exception:
                # What breaks off was told when it was read.
                continue
    return sorted(names)


def _of_file(
    path: Path,
    file: IO[bytes],
    topics: list[str],
    decoders: DecoderFactory,
    findings: Findings,
) -> Iterator[Message]:
    count = 0
    try:
        for schema, channel, message in _undecoded(file, topics):
            decode = decoders.decoder_for(channel.message_encoding, schema)
            if decode is None or schema is None:
                raise BagError(
                    f"{path}: {channel.topic} is not in CDR with a ros2msg definition, "
                    f"but in {channel.message_encoding!r}; {_ADVICE}"
                )
            content = decode(message.data)
            yield Message(channel.topic, schema.name, message.log_time / 1e9, content)
            count += 1
    except BagError:
        raise
    except Exception as error:
        # Cut or damaged bytes fail in any way.
        size = path.stat().st_size
        broken = f"{path} breaks off or is damaged within its {size:,} bytes"
        if not count:
            raise BagError(
                f"{broken}, before any message that is asked for ({_short(error)}); "
                "its recording was not finished, or it was not copied whole: copy it "
                "again"
            ) from error
        findings.tell(
            f"{broken}, so its recording was not finished or it was not copied whole: "
            f"the {count:,} messages before that are taken ({_short(error)})"
        )


def _undecoded(file: IO[bytes], topics: list[str]) -> Iterator[Undecoded]:
    """Messages of `topics` as they were written.

    Found by the index where there is one, so that pictures are not unpacked, else by
    reading everything from the first byte on.
    """
    summary = _summary(file)
    if summary is None or not summary.chunk_indexes:
        yield from messages_in(in_order(file), topics)
        return
    wanted = {id for id, c in summary.channels.items() if c.topic in topics}
    # One chunk at a time: mcap's own reader would hold all of them.
    for index in sorted(summary.chunk_indexes, key=lambda i: i.chunk_start_offset):
        held = index.message_index_offsets
        if held and wanted.isdisjoint(held):
            continue
        file.seek(index.chunk_start_offset + 9)
        chunk = Chunk.read(ReadDataStream(file))
        for record in records_of(chunk):
            if isinstance(record, mcap.records.Message) and record.channel_id in wanted:
                channel = summary.channels[record.channel_id]
                yield summary.schemas.get(channel.schema_id), channel, record


def _summary(file: IO[bytes]) -> Summary | None:
    try:
        return summary_of(file)
    except Exception:
        # Without an end, the bytes where the index should be are anything.
        return None


def _require_mcap(path: Path, head: bytes) -> None:
    if not head:
        raise BagError(
            f"{path} is empty, 0 bytes: nothing was recorded into it; give another bag"
        )
    for magic, what in _OTHERS.items():
        if head.startswith(magic):
            raise BagError(f"{path} is {what}")
    if head[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
        raise BagError(
            f"{path} cannot be read as a ROS 2 bag in MCAP, since it begins with "
            f"{head[:8]!r}; {_ADVICE}"
        )


def _listed(metadata: Path) -> list[str] | None:
    """Names of the files that a bag's metadata lists; None if there is none.

    Raises:
        BagError: it does not say.
    """
    if not metadata.is_file():
        return None
    try:
        told = read_yaml(metadata)
        paths = told["rosbag2_bagfile_information"]["relative_file_paths"]
        # The files lie in the folder, wherever it was when it was written.
        return [Path(str(path)).name for path in paths]
    except (ValueError, KeyError, TypeError) as error:
        raise BagError(
            f"{metadata} does not list the files of the bag ({_short(error)}); give a "
            ".mcap file of it"
        ) from None


def _by_number(name: str) -> list[tuple[int, str]]:
    """Sorts walk_2.mcap before walk_10.mcap."""
    parts = re.findall(r"\d+|\D+", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _short(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:120].strip(": ")
