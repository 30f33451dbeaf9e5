"""Hostile files of every kind, given to the real commands: which of them get through?

`python -m benchmarks.attack_files` prints a table; `--every N` tries each Nth only. An
input is held where the command ends with exit code 2 and one line, or rightly with 0 or
1, without a traceback, in seconds, within the memory below, and leaves its data set as
it was.
"""

from __future__ import annotations

import json
import os
import signal
import struct
import sys
import tempfile
import traceback
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
import zstandard

from gaitpref.cli import main as cli
from gaitpref.cli.commands import label as label_command
from gaitpref.cli.commands.looking import play as play_command
from tests.helpers.command_table import Typed, make_world
from tests.helpers.hostile_policies import ALONE

MEMORY_BYTES = 1_500 * 2**20
"""What a command may take in all; torch alone takes 0.4 GB."""
LIMIT_S = 60
EVIL = Path("/tmp/evil")
"""What code in an attack would make."""
Make = Callable[[Path, bytes], None]
"""Puts the hostile file where the sound one was, whose bytes it is given."""


@dataclass(frozen=True)
class Attack:
    """One hostile input."""

    kind: str
    name: str
    place: str
    """File of the world that is replaced."""
    make: Make
    line: str
    """The command, as in the table of commands."""


@dataclass(frozen=True)
class Result:
    """What became of it."""

    attack: Attack
    held: bool
    why: str


# Ways to spoil any file.


def _write(content: bytes) -> Make:
    return lambda path, sound: _put(path, content)


def _of(change: Callable[[bytes], bytes]) -> Make:
    return lambda path, sound: _put(path, change(sound))


def _put(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _sparse(path: Path, sound: bytes) -> None:
    with path.open("wb") as file:
        file.write(sound)
        file.truncate(10 * 2**30)


def _device(path: Path, sound: bytes) -> None:
    path.symlink_to("/dev/zero")


def _circle(path: Path, sound: bytes) -> None:
    path.symlink_to(path.name)


def _pipe(path: Path, sound: bytes) -> None:
    os.mkfifo(path)


def _folder(path: Path, sound: bytes) -> None:
    path.mkdir()


ANY: dict[str, Make] = {
    "nothing in it": _write(b""),
    "half of it": _of(lambda sound: sound[: len(sound) // 2]),
    "its last byte is gone": _of(lambda sound: sound[:-1]),
    "twice": _of(lambda sound: sound * 2),
    "a bit turned": _of(lambda s: s[: len(s) // 3] + b"\xff" + s[len(s) // 3 + 1 :]),
    "zeros": _of(lambda sound: bytes(len(sound))),
    "noise": _write(bytes(range(256)) * 64),
    "10 GB of nothing behind it": _sparse,
    "/dev/zero": _device,
    "a link to itself": _circle,
    "a pipe": _pipe,
    "a directory": _folder,
}
"""What can be done to any file."""

DEEP = 100_000
TEXTS: dict[str, bytes] = {
    "nested lists": b"[" * DEEP,
    "nested objects": b'{"a":' * DEEP,
    "null": b"null",
    "a number of 10,000 digits": b"9" * 10_000,
    "NaN": b"NaN",
    "half a letter of UTF-16": b'{"a": "\\ud800"}',
    "no UTF-8": b'{"a": "\xff\xfe"}',
    "UTF-16": '{"a": 1}'.encode("utf-16"),
    "keys twice": b'{"format_version": 2, "format_version": 99}',
    "marks of direction": '{"a": "\u202e\u2066"}'.encode(),
}
"""What can stand in a file of JSON, YAML or TOML."""


def _changed(change: Callable[[dict[str, Any]], None]) -> Make:
    def make(path: Path, sound: bytes) -> None:
        values = json.loads(sound)
        change(values)
        _put(path, json.dumps(values).encode())

    return make


def _file(**changes: Any) -> Make:
    """A manifest whose first line says something else."""
    return _changed(lambda manifest: manifest["files"][0].update(changes))


MANIFESTS: dict[str, Make] = {
    "a path out of the data set": _file(path="../../../etc/passwd"),
    "an absolute path": _file(path="/etc/passwd"),
    "a hash that is a path": _file(sha256="../" * 21 + "a"),
    "bytes below 0": _file(bytes=-1),
    "10^30 bytes": _file(bytes=10**30),
    "true steps": _file(num_steps=True),
    "10^30 steps": _file(num_steps=10**30),
    "steps that are no number": _file(num_steps="many"),
    "an end that does not exist": _file(end_reason="\x1b[31mred"),
    "no meta": _file(meta=None),
    "a list for meta": _file(meta=[]),
    "an infinite command": _file(meta={"command": "[1e999, 0, 0]"}),
    "files that are an object": _changed(lambda m: m.update(files={})),
    "files that are numbers": _changed(lambda m: m.update(files=[1, 2])),
    "a version from the future": _changed(lambda m: m.update(format_version=10**30)),
    "a version that is a list": _changed(lambda m: m.update(format_version=[2])),
    "a line of 2 MB": _file(padding="x" * 2**21),
}


# Archives.


def _zip_with(**changes: bytes) -> Make:
    """The archive with other members, or more of them."""

    def make(path: Path, sound: bytes) -> None:
        aside = path.with_name("sound.zip")
        aside.write_bytes(sound)
        with zipfile.ZipFile(aside) as old, zipfile.ZipFile(path, "w") as new:
            for member in old.infolist():
                new.writestr(member, changes.pop(member.filename, old.read(member)))
            for name, content in changes.items():
                new.writestr(name, content)

    return make


def _answers(**fields: Any) -> Make:
    """The archive with one field of an answer, a pair or a rater changed."""

    def make(path: Path, sound: bytes) -> None:
        record = fields.get("record", "answer")
        aside = path.with_name("sound.zip")
        aside.write_bytes(sound)
        with zipfile.ZipFile(aside) as old:
            lines = [
                json.loads(line) for line in old.read("answers.jsonl").splitlines()
            ]
        changed = next(line for line in lines if line["record"] == record)
        changed.update({k: v for k, v in fields.items() if k != "record"})
        if "now" in fields:
            changed["record"] = changed.pop("now")
        content = "".join(json.dumps(line) + "\n" for line in lines).encode()
        _zip_with(**{"answers.jsonl": content})(path, sound)

    return make


def _directory_at(offset: int) -> Make:
    def make(path: Path, sound: bytes) -> None:
        end = sound.rfind(b"PK\x05\x06")
        head = struct.pack("<I", offset)
        _put(path, sound[: end + 16] + head + sound[end + 20 :])

    return make


def _linked(path: Path, sound: bytes) -> None:
    _zip_with()(path, sound)
    with zipfile.ZipFile(path, "a") as file:
        member = zipfile.ZipInfo("README.md")
        member.external_attr = 0o120777 << 16
        file.writestr(member, "/etc/passwd")


def _squeezed(path: Path, sound: bytes) -> None:
    _zip_with()(path, sound)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as file:
        file.writestr("README.md", bytes(2**28))


_LONG = 10**30
ARCHIVES: dict[str, Make] = {
    "a member that climbs": _zip_with(**{"../../evil": b"x"}),
    "a member with a root": _zip_with(**{"/tmp/evil": b"x"}),
    "a member of Windows": _zip_with(**{"..\\evil": b"x"}),
    "an episode too many": _zip_with(**{f"rollouts/aa/{'a' * 64}.mcap": b"x"}),
    "a link": _linked,
    "256 MB in 260 kB": _squeezed,
    "a directory beyond its end": _directory_at(2**32 - 2),
    "a directory at its beginning": _directory_at(0),
    "a manifest of another": _zip_with(**{"manifest.json": b"{}"}),
    "answers that are none": _zip_with(**{"answers.jsonl": b"[" * DEEP}),
    "answers in no UTF-8": _zip_with(**{"answers.jsonl": b"\xff\n"}),
    "an unknown record": _answers(now="wish"),
    "a record that is a list": _answers(now=[1]),
} | {
    f"{name} {value!r:.20}": _answers(**{name: value})
    for name, value in (
        ("client", [1]),
        ("client", "text"),
        ("client", {"a": float("nan")}),
        ("note", 5),
        ("note", None),
        ("note", "\ud800"),
        ("reason", ["x"]),
        ("shown_ms", True),
        ("shown_ms", _LONG),
        ("shown_ms", -1),
        ("shown_ms", 1.5),
        ("watched_ms", "12"),
        ("response_ms", 2**63),
        ("p_a", True),
        ("p_a", "0.5"),
        ("p_a", float("nan")),
        ("confidence", 2),
        ("confidence", False),
        ("choice", "c"),
        ("choice", ["a"]),
        ("shown_left", 0),
        ("role", "king"),
        ("answer_id", ""),
        ("answer_id", 7),
        ("pair_id", "none"),
        ("rater_id", "nobody"),
        ("supersedes", "nothing"),
        ("supersedes", 3),
        ("created_utc", "yesterday"),
        ("created_utc", 0),
        ("created_utc", "0001-01-01T00:00:00+23:59"),
        ("created_utc", "9999-12-31T23:59:59-23:59"),
        ("favourite", "blue"),
    )
}
PAIRS: dict[str, Make] = {
    f"{name} {value!r:.20}": _answers(record="pair", **{name: value})
    for name, value in (
        ("round", _LONG),
        ("round", True),
        ("round", -1),
        ("round", "0"),
        ("strategy", 1),
        ("info", []),
        ("info", {"gold": "x"}),
        ("a", {}),
        ("a", {"rollout": 1, "start": 0, "steps": 1}),
        ("b", {"rollout": "x", "start": _LONG, "steps": 1}),
        ("b", {"rollout": "x", "start": 0, "steps": True}),
        ("pair_id", "other"),
    )
} | {
    f"{name} {value!r:.20}": _answers(record="rater", **{name: value})
    for name, value in (
        ("kind", "god"),
        ("kind", None),
        ("rater_id", ""),
        ("rater_id", 1),
        ("info", "x"),
    )
}


# Episodes and bags.


def first_chunk(sound: bytes) -> tuple[int, int]:
    """Where the first chunk of an MCAP file begins and ends."""
    position = 8
    while sound[position] != 6:
        position += 9 + struct.unpack_from("<Q", sound, position + 1)[0]
    length = struct.unpack_from("<Q", sound, position + 1)[0]
    return position, position + 9 + length


def chunk(compression: bytes, content: bytes, claimed: int, crc: int = 0) -> bytes:
    """A chunk record that says anything about what is in it."""
    head = struct.pack("<QQQII", 0, 10, claimed, crc, len(compression))
    body = head + compression + struct.pack("<Q", len(content)) + content
    return struct.pack("<BQ", 6, len(body)) + body


def bombed(compression: bytes, claimed: int, *, told: bool = True) -> Make:
    """The first chunk replaced by one that unpacks to 3 GB."""

    def make(path: Path, sound: bytes) -> None:
        start, end = first_chunk(sound)
        content = bomb(compression, told=told)
        block = chunk(compression, content, claimed)
        _put(path, sound[:start] + block + sound[end:])

    return make


def bomb(compression: bytes, *, told: bool) -> bytes:
    """3 GB of zeros; `told` says whether the frame tells its own size."""
    if compression == b"lz4":
        import lz4.frame

        packer = lz4.frame.LZ4FrameCompressor()
        parts = [packer.begin()]
        parts += [packer.compress(bytes(2**26)) for _ in range(48)]
        return b"".join([*parts, packer.flush()])
    packed = zstandard.ZstdCompressor(write_content_size=told).compressobj(
        size=3 * 2**30 if told else -1
    )
    parts = [packed.compress(bytes(2**26)) for _ in range(48)]
    return b"".join([*parts, packed.flush()])


def _many_chunks(path: Path, sound: bytes) -> None:
    """2,000 chunks in 5 MB, each of which keeps to the limit of one: 60 GB."""
    start, end = first_chunk(sound)
    content = bytes(32 * 2**20)
    packed = zstandard.ZstdCompressor().compress(content)
    block = chunk(b"zstd", packed, len(content), zlib.crc32(content))
    _put(path, sound[:start] + block * 2000 + sound[end:])


def _chunk_in_summary(path: Path, sound: bytes) -> None:
    """A bomb where the index should be, which a library would unpack by itself."""
    (start,) = struct.unpack_from("<Q", sound, len(sound) - 8 - 20)
    block = chunk(b"zstd", bomb(b"zstd", told=True), 1000)
    footer = struct.pack("<BQQQ", 2, 20, start, 0)
    summary = block + footer
    whole = summary + struct.pack("<I", zlib.crc32(summary))
    _put(path, sound[:start] + whole + sound[-8:])


def _length(value: int) -> Make:
    def make(path: Path, sound: bytes) -> None:
        start, _ = first_chunk(sound)
        head = struct.pack("<Q", value)
        _put(path, sound[: start + 1] + head + sound[start + 9 :])

    return make


EPISODES: dict[str, Make] = {
    "3 GB of zstd that tells its size": bombed(b"zstd", 1000),
    "3 GB of zstd that claims them": bombed(b"zstd", 3 * 2**30),
    "3 GB of zstd that tells nothing": bombed(b"zstd", 1000, told=False),
    "3 GB of lz4": bombed(b"lz4", 1000),
    "60 GB in 2,000 chunks": _many_chunks,
    "a bomb in the summary": _chunk_in_summary,
    "a chunk without an end": _length(2**63),
    "a chunk of 0 bytes": _length(0),
    "a compression nobody knows": bombed(b"zstd", 2**64 - 1),
}


# Files that people write, and those of torch.

YAMLS: dict[str, bytes] = {
    "a billion laughs": b"a: &a [x,x,x,x,x,x,x,x,x]\n"
    + b"".join(
        b"%c: &%c [*%c,*%c,*%c,*%c,*%c,*%c,*%c,*%c]\n" % (n, n, *([n - 1] * 8))
        for n in range(ord("b"), ord("k"))
    ),
    "an object of Python": b"!!python/object/apply:os.system ['touch /tmp/evil']",
    "a list": b"- 1\n- 2\n",
    "a key that is a list": b"? [1, 2]\n: 3\n",
    "infinite rounds": b"rounds: .inf\n",
    "rounds that are text": b"rounds: many\n",
}
TOMLS: dict[str, bytes] = {
    "nested tables": b"a = " + b"[" * DEEP,
    "a table twice": b"[joints]\n[joints]\n",
    "NaN": b"control_hz = nan\n",
    "an infinite rate": b"control_hz = inf\n",
    "a rate of 10^30": b"control_hz = 1e30\n",
    "an unknown field": b"colour = 'red'\n",
    "a robot elsewhere": b"robot = '/dev/zero'\n",
}
ROBOTS: dict[str, bytes] = {
    "no end": b"<mujoco><worldbody>",
    "no robot": b"<mujoco/>",
    "an entity": b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><mujoco>&x;',
    "nested bodies": b"<mujoco><worldbody>" + b"<body>" * 20_000,
    "a file that includes itself": b'<mujoco><include file="go1.xml"/></mujoco>',
    "a mesh that is a device": b'<mujoco><asset><mesh file="/dev/full"/></asset>'
    b"</mujoco>",
    "letters that act": b'<mujoco model="\x1b[31m"/>',
}


def _torch(content: bytes) -> Make:
    def make(path: Path, sound: bytes) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr("archive/data.pkl", content)
            file.writestr("archive/data/0", bytes(2**30))
            file.writestr("archive/version", "3\n")

    return make


POLICIES: dict[str, Make] = {
    "1 GB of weights in 1 MB": _torch(b"\x80\x02}q\x00."),
    "a pickle that runs": _write(b"cos\nsystem\n(S'touch /tmp/evil'\ntR."),
    "a pickle in a zip": _torch(b"cos\nsystem\n(S'touch /tmp/evil'\ntR."),
    "a list as large as it says": _write(b"\x80\x02X\xff\xff\xff\x7f"),
}

OTHERS: dict[str, Make] = {
    name: lambda path, sound, make=make: make(path) for name, (make, _) in ALONE.items()
}
"""Policies of others; what lies beside them is attacked in the tests."""


def attacks() -> Iterator[Attack]:
    """All of them."""
    info = "data info --dataset {dataset}"
    unpack = "data unpack --dataset {out} --archive {archive}"
    recover = "data recover --dataset {out} --file {episode}"
    bag = "data import ros2 {bag} --map {map} --dataset {out}"
    evaluate = "evaluate --policy {policy} --episodes 1"
    trust = "trust --reward {reward} --dataset {dataset}"
    inspect = "robot inspect {xml}"
    label = "label --dataset {dataset} --port 0 --guidelines {guidelines}"
    places = {
        "manifest": ("set/manifest.json", info),
        "answers in SQLite": ("set/preferences.sqlite", info),
        "raters": ("set/raters.json", "raters --dataset {dataset} list"),
        "archive": ("set.zip", unpack),
        "episode": ("cut.mcap", recover),
        "bag": ("walk.mcap", bag),
        "map": ("map.toml", bag),
        "policy": ("train/policy.pt", evaluate),
        "reward": ("reward/reward.json", trust),
        "weights of a reward": ("reward/reward.safetensors", trust),
        "configuration": ("run/config.yaml", "report --run {run}"),
        "report": ("run/rounds/00/report.json", "report --run {run}"),
        "robot": ("go1.xml", inspect),
        "guidelines": ("guidelines.md", label),
        "policy of others": (
            "theirs/policy.onnx",
            "policy import {theirs} --explain",
        ),
        "queries": (
            "queries/episodes.json",
            "data import uni-rlhf {queries} --dataset {dataset}",
        ),
    }
    own: dict[str, dict[str, Make]] = {
        "manifest": MANIFESTS,
        "archive": ARCHIVES | PAIRS,
        "episode": EPISODES,
        "bag": EPISODES,
        "policy": POLICIES,
        "policy of others": OTHERS,
        "configuration": {name: _write(text) for name, text in YAMLS.items()},
        "map": {name: _write(text) for name, text in TOMLS.items()},
        "robot": {name: _write(text) for name, text in ROBOTS.items()},
    }
    of_text = (
        "manifest",
        "raters",
        "map",
        "reward",
        "configuration",
        "report",
        "queries",
    )
    for kind, (place, line) in places.items():
        texts = TEXTS if kind in of_text else {}
        every = ANY | own.get(kind, {}) | {n: _write(t) for n, t in texts.items()}
        for name, make in every.items():
            yield Attack(kind, name, place, make, line)


def attempt(attack: Attack, world: Path, scratch: Path) -> Result:
    """Let one attack loose in `world`, which is mended afterwards."""
    place = world / attack.place
    sound = place.read_bytes()
    place.unlink()
    before = _names(world)
    try:
        attack.make(place, sound)
        ended = _in_child(Typed(attack.line).args(world, scratch / "out"), scratch)
        why = _why(ended, before - {str(place)}, world)
        return Result(attack, not why, why)
    finally:
        if place.is_dir() and not place.is_symlink():
            place.rmdir()
        else:
            place.unlink(missing_ok=True)
        place.with_name("sound.zip").unlink(missing_ok=True)
        place.write_bytes(sound)


@dataclass(frozen=True)
class _Ended:
    code: int
    out: str
    err: str
    bytes: int
    """Most memory the command took."""


def _in_child(args: list[str], scratch: Path) -> _Ended:
    """Run a command in a process that is made of this one: all is imported already."""
    files = [scratch / "out.txt", scratch / "err.txt"]
    child = os.fork()
    if child == 0:
        for number, path in enumerate(files, 1):
            os.dup2(os.open(path, os.O_CREAT | os.O_WRONLY), number)
        signal.alarm(LIMIT_S)
        os.chdir(scratch)
        code = 1
        try:
            code = cli.main(args)
            sys.stdout.flush()
        except SystemExit as left:
            code = int(left.code or 0)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    out, err = (path.read_text(errors="replace") for path in files)
    return _Ended(os.waitstatus_to_exitcode(status), out, err, used.ru_maxrss * 1024)


def _names(world: Path) -> set[str]:
    return {str(path) for path in world.rglob("*") if "preferences" not in path.name}


def _why(ended: _Ended, before: set[str], world: Path) -> str:
    """Why it got through; empty where it was held."""
    said = ended.err + ended.out
    if "Traceback" in said:
        return ended.err.strip().splitlines()[-1][:200]
    if ended.code == -signal.SIGALRM:
        return f"longer than {LIMIT_S} s"
    if ended.code not in (0, 1, 2):
        return f"exit code {ended.code}"
    if ended.code == 2 and len(ended.err.splitlines()) != 1:
        return f"{len(ended.err.splitlines())} lines: {ended.err[:200]}"
    if any(ord(c) < 32 and c != "\n" for c in said):
        return "it says what acts"
    if ended.bytes > MEMORY_BYTES:
        return f"{ended.bytes / 2**30:.1f} GB of memory"
    if EVIL.exists():
        return "it ran something"
    gone = before - _names(world)
    return f"{sorted(gone)[0]} is gone" if gone else ""


def main(every: int = 1) -> int:
    """Try them all; print counts by kind; the exit code says whether all were held.

    Args:
        every: Try only each so many.
    """
    for module in (label_command, play_command):
        module.wait_until_stopped = lambda _: None  # type: ignore[attr-defined]
    tried: Counter[str] = Counter()
    through: list[Result] = []
    with tempfile.TemporaryDirectory() as folder:
        world = Path(folder, "world")
        world.mkdir()
        make_world(world)
        for number, attack in enumerate(attacks()):
            if number % every:
                continue
            scratch = Path(folder, str(number))
            scratch.mkdir()
            result = attempt(attack, world, scratch)
            tried[attack.kind] += 1
            if not result.held:
                through.append(result)
    failed = Counter(result.attack.kind for result in through)
    print(f"{'kind':<22}{'held':>6}{'through':>9}")
    for kind, count in tried.items():
        print(f"{kind:<22}{count - failed[kind]:>6}{failed[kind]:>9}")
    print(f"{'all':<22}{tried.total() - len(through):>6}{len(through):>9}")
    for result in through:
        print(f"{result.attack.kind}, {result.attack.name}: {result.why}")
    return 1 if through else 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
