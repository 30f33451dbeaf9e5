"""One writer a directory: processes that meet, die, and find no locks."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from data.errors import FileError
from data.files.lock import LOCK_NAME, Busy, only_writer

HOLDER = """
import sys, time
from pathlib import Path
from data.errors import FileError
from data.files.lock import only_writer
with only_writer(Path(sys.argv[1]), print):
    print("held", flush=True)
    time.sleep(60)
"""


def holder(directory: Path) -> subprocess.Popen[str]:
    """A process that holds the directory."""
    command = [sys.executable, "-c", HOLDER, str(directory)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_the_second_writer_is_told_the_first_ones_pid(tmp_path: Path) -> None:
    process = holder(tmp_path)
    try:
        for path in (tmp_path, tmp_path / "." / ".." / tmp_path.name):
            with (
                pytest.raises(Busy, match=rf"pid {process.pid} on .*another directory"),
                only_writer(path, print),
            ):
                pass
    finally:
        process.kill()
        process.communicate()


def test_a_dead_process_holds_nothing(tmp_path: Path) -> None:
    """Killed in the middle of it: what it left does not lock anybody out."""
    process = holder(tmp_path)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert (tmp_path / LOCK_NAME).exists()
    with only_writer(tmp_path, print):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_directory_nothing_was_written_into_is_gone_again(tmp_path: Path) -> None:
    """As where an input turned out to be wrong; what was there before stays."""
    there = tmp_path / "there"
    there.mkdir()
    for directory in (there, there / "new" / "deep"):
        with only_writer(directory, print):
            assert (directory / LOCK_NAME).exists()
    assert list(tmp_path.rglob("*")) == [there]
    with only_writer(there / "new", print):
        (there / "new" / "file").touch()
    assert (there / "new" / "file").exists()


def test_a_pipe_in_place_of_the_lock_is_told_and_stays(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / LOCK_NAME)
    with (
        pytest.raises(FileError, match="is a named pipe"),
        only_writer(tmp_path, print),
    ):
        pass
    assert (tmp_path / LOCK_NAME).is_fifo()


def test_a_directory_that_goes_while_it_is_made_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The writer before removes it after it was found and before it is looked at."""
    there = tmp_path / "there"
    there.mkdir()
    is_dir = Path.is_dir

    def gone(path: Path) -> bool:
        if path == there:
            monkeypatch.undo()
            there.rmdir()
        return is_dir(path)

    monkeypatch.setattr(Path, "is_dir", gone)
    with only_writer(there, print):
        assert (there / LOCK_NAME).exists()


def test_what_is_no_directory_is_told(tmp_path: Path) -> None:
    """A file, and a link that leads nowhere: nothing is tried without end."""
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("file", "link", "link/below", "file/below"):
        with (
            pytest.raises((FileExistsError, NotADirectoryError)),
            only_writer(tmp_path / name, print),
        ):
            pass


def test_many_who_come_at_once_write_one_after_the_other(tmp_path: Path) -> None:
    """The lock is removed each time, and never two hold it: the counter is right."""
    child = """
import sys
from pathlib import Path
from data.files.lock import Busy, only_writer
root, done = Path(sys.argv[1]), 0
while done < 40:
    try:
        with only_writer(root / "d", print):
            value = int((root / "n").read_text())
            (root / "n").write_text(str(value + 1))
            done += 1
    except Busy:
        pass
"""
    (tmp_path / "n").write_text("0")
    processes = [
        subprocess.Popen([sys.executable, "-c", child, str(tmp_path)]) for _ in range(4)
    ]
    assert [process.wait(timeout=60) for process in processes] == [0] * 4
    assert (tmp_path / "n").read_text() == "160"


def test_a_file_system_without_locks_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the kernel answers on a network file system without a lock server."""

    def refused(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refused)
    told: list[str] = []
    with only_writer(tmp_path, told.append):
        pass
    assert len(told) == 1
    assert "has no locks (No locks available)" in told[0]
