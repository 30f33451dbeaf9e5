"""Messages of a ROS 2 bag in MCAP: one file, or a folder with several.

A file whose recording was not finished is read as far as it goes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

import yaml
from mcap.decoder import DecoderFactory
from mcap.exceptions import DecoderNotFoundError
from mcap.reader import McapReader, NonSeekingReader, make_reader
from mcap.records import Channel
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from data.files import sha256_bytes, sha256_file
from gaitpref.extras import require

from .bag_map import BagError
from .findings import Findings

METADATA_NAME = "metadata.yaml"
_OTHERS = {
    b"SQLite format 3\0": "a ROS 2 bag in sqlite3; `ros2 bag convert` makes one in "
    "MCAP of it",
    b"\x28\xb5\x2f\xfd": "compressed as a whole with zstd; `zstd -d` unpacks it",
    b"\x04\x22\x4d\x18": "compressed as a whole with lz4; `lz4 -d` unpacks it",
    b"#ROSBAG V": "a bag of ROS 1; `rosbags-convert` makes a ROS 2 bag of it",
}
"""How files begin that are bags, but none in MCAP."""
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
    if others or not names:
        raise BagError(
            f"{bag} holds {', '.join(others) or 'no file'} where a bag in MCAP has "
            f".mcap files; {_ADVICE}"
        )
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
    decoder = require("mcap_ros2.decoder", "view").DecoderFactory()
    for path in files:
        with path.open("rb") as file:
            _require_mcap(path, file.read(16))
            yield from _of_file(path, file, topics, decoder, findings)


def topics_in(files: list[Path]) -> list[str]:
    """Names of all topics, as far as the files can be read."""
    names: set[str] = set()
    for path in files:
        with path.open("rb") as file:
            try:
                for record in StreamReader(file).records:
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
    decoder: DecoderFactory,
    findings: Findings,
) -> Iterator[Message]:
    count, last_s = 0, 0.0
    try:
        reader = _reader(file, decoder)
        for schema, channel, message, content in reader.iter_decoded_messages(
            topics, log_time_order=False
        ):
            last_s = message.log_time / 1e9
            kind = schema.name if schema else ""
            yield Message(channel.topic, kind, last_s, content)
            count += 1
    except DecoderNotFoundError as error:
        raise BagError(
            f"{path} holds messages in another form than CDR with a ros2msg "
            f"definition ({_short(error)}); {_ADVICE}"
        ) from None
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


def _reader(file: IO[bytes], decoder: DecoderFactory) -> McapReader:
    """Reads by the index where there is one, else from the first byte on."""
    try:
        file.seek(0)
        reader = make_reader(file, validate_crcs=True, decoder_factories=[decoder])
        if reader.get_summary() is not None:
            return reader
    except Exception:
        # Without an end, the bytes where the index should be are anything.
        pass
    file.seek(0)
    return NonSeekingReader(file, validate_crcs=True, decoder_factories=[decoder])


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
        told = yaml.safe_load(metadata.read_text(encoding="utf-8"))
        paths = told["rosbag2_bagfile_information"]["relative_file_paths"]
        # The files lie in the folder, wherever it was when it was written.
        return [Path(str(path)).name for path in paths]
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise BagError(
            f"{metadata} does not list the files of the bag ({_short(error)}); give a "
            ".mcap file of it"
        ) from None


def _by_number(name: str) -> list[tuple[int, str]]:
    """Sorts walk_2.mcap before walk_10.mcap."""
    parts = re.findall(r"\d+|\D+", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _short(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:120]
