"""The files of a ROS 2 bag: one, or a folder with several, packed or not."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from data.files.files import open_regular
from data.files.limits import BAG_FILE_BYTES
from data.files.unpacking import ZSTD_MAGIC, unpack_zstd_to
from data.files.yaml_file import read_yaml
from gaitpref.formats.logs.log_findings import Findings
from gaitpref.formats.logs.log_map import LogError

METADATA_NAME = "metadata.yaml"
_KINDS = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")


def files_of(bag: Path, findings: Findings) -> list[Path]:
    """The files of a bag in their order.

    Raises:
        LogError: there is none.
    """
    if not bag.is_dir():
        if not bag.exists():
            raise LogError(f"{bag} is missing; give a ROS 2 bag, a file or a folder")
        if not bag.is_file():
            raise LogError(f"{bag} is no file; give a ROS 2 bag, a file or a folder")
        return [bag]
    names = _listed(bag / METADATA_NAME)
    if names is None:
        # Written when a recording ends: one that was cut off has none.
        names = sorted(
            (path.name for path in bag.iterdir() if path.name.endswith(_KINDS)),
            key=_by_number,
        )
        findings.tell(
            f"{bag} has no {METADATA_NAME}, so its recording was not finished: its "
            f"{len(names)} files are taken in the order of their names"
        )
    others = [name for name in names if not name.endswith(_KINDS)]
    if others:
        raise LogError(
            f"{bag} holds {', '.join(others)}; the files of a ROS 2 bag end in "
            f"{', '.join(_KINDS)}; `ros2 bag convert` makes one of others"
        )
    if not names:
        raise LogError(f"{bag} holds no {' or '.join(_KINDS)} file; give a ROS 2 bag")
    missing = [name for name in names if not (bag / name).is_file()]
    if missing:
        raise LogError(
            f"{bag / METADATA_NAME} names {', '.join(missing)}, missing in the folder; "
            "copy the bag again, or give a single file of it"
        )
    return [bag / name for name in names]


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The file itself, or where it lies unpacked as long as this is open.

    Raises:
        LogError: it does not unpack, or to more than the limit.
    """
    with open_regular(path) as file:
        if file.read(4) != ZSTD_MAGIC:
            yield path
            return
        file.seek(0)
        with tempfile.TemporaryDirectory(prefix="gaitpref-") as folder:
            place = Path(folder) / path.name.removesuffix(".zstd")
            try:
                unpack_zstd_to(file, place, BAG_FILE_BYTES)
            except ValueError as error:
                raise LogError(
                    f"{path} is packed with zstd, and {error}; copy it again, or "
                    "unpack it with `zstd -d`"
                ) from None
            yield place


def _listed(metadata: Path) -> list[str] | None:
    """Names of the files that a bag's metadata lists; None if there is none.

    Raises:
        LogError: it does not say.
    """
    if not metadata.is_file():
        return None
    try:
        told = read_yaml(metadata)
        paths = told["rosbag2_bagfile_information"]["relative_file_paths"]
        # The files lie in the folder, wherever it was when it was written.
        return [Path(str(path)).name for path in paths]
    except (ValueError, KeyError, TypeError) as error:
        found = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise LogError(
            f"{metadata} does not list the files of the bag ({found}); give a "
            "file of it"
        ) from None


def _by_number(name: str) -> list[tuple[int, str]]:
    """Sorts walk_2.mcap before walk_10.mcap."""
    parts = re.findall(r"\d+|\D+", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]
