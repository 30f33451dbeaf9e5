"""Pieces of work: the same outcomes whoever runs them, and nothing lost on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from benchmarks.in_order import in_order
from data.errors import GaitprefError
from gaitpref.executor.gpu_slots import Slots
from gaitpref.executor.pieces import DEVICES, Executor, Piece, PieceError
from gaitpref.executor.processes import Processes
from gaitpref.executor.ray_tasks import RayTasks
from tests.helpers.one_ray import one_ray
from tests.helpers.waiting import wait_for

LONGEST_S = 300
"""What takes longer hangs."""


def product(a: float, b: float) -> float:
    """A piece that ends well, unless it is asked for what there is not."""
    if a == 13:
        raise GaitprefError("13 is not multiplied: give another number")
    return a * b


def dies_at_first(note: Path, times: int) -> str:
    """Killed until it was tried `times` times."""
    with note.open("a") as file:
        file.write("x")
    tries = note.stat().st_size
    if tries <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return f"try {tries}"


def seen_gpus(meeting: Path | None = None) -> str:
    """What it sees; with a `meeting`, once another is there at the same time."""
    if meeting is not None:
        (meeting / str(os.getpid())).touch()
        deadline_s = time.monotonic() + LONGEST_S
        while len(list(meeting.iterdir())) < 2 and time.monotonic() < deadline_s:
            time.sleep(0.01)
        assert len(list(meeting.iterdir())) == 2
    return os.environ[DEVICES]


def whereabouts() -> tuple[str, str]:
    """Where a relative path leads to, and which GPUs are in sight."""
    return os.getcwd(), os.environ[DEVICES]


def stays(note: Path) -> None:
    """Runs until it is ended."""
    note.write_text(str(os.getpid()))
    while True:
        time.sleep(0.05)


def speaks(a: int, b: int) -> None:
    """Says something, by Python and past it, and fails."""
    print("from Python")
    os.write(2, b"from below\n")
    os.write(1, f"{a / b}".encode())


def leaves() -> None:
    """Ends its process, as some libraries do."""
    sys.exit("no licence")


@pytest.fixture(scope="module")
def ray() -> Iterator[RayTasks]:
    """Ray, started once."""
    with one_ray():
        yield RayTasks(address="local", retries=1)


@pytest.fixture(params=["processes", "ray"])
def executor(request: pytest.FixtureRequest) -> Executor:
    """One after the other, both who run pieces."""
    if request.param == "processes":
        return Processes(workers=2, retries=1)
    return request.getfixturevalue("ray")


def test_values_are_those_of_a_call_and_in_order(executor: Executor) -> None:
    """Also where a later piece ends first."""
    numbers = [(1.5, 2.0), (0.1, 0.2), (7.0, 3.0)]
    pieces = [Piece(name=f"{a}", function=product, args=(a, b)) for a, b in numbers]
    assert in_order(executor, pieces) == [product(a, b) for a, b in numbers]


def test_a_failure_is_told_and_the_others_go_on(
    executor: Executor, tmp_path: Path
) -> None:
    """What a function raises in one line, and what its process died of; a piece whose
    process died is tried again."""
    pieces = [
        Piece(name="bad", function=product, args=(13, 1)),
        Piece(name="odd", function=product, args=(None, 1)),
        Piece(name="gone", function=leaves),
        Piece(name="once", function=dies_at_first, args=(tmp_path / "a", 1)),
        Piece(name="always", function=dies_at_first, args=(tmp_path / "b", 9)),
        Piece(name="good", function=product, args=(2, 3)),
    ]
    with closing(executor.outcomes(pieces)) as outcomes:
        found = {outcome.piece.name: outcome for outcome in outcomes}
    values = {name: each.value for name, each in found.items() if not each.failure}
    assert values == {"once": "try 2", "good": 6}
    why = {name: each.failure.reason for name, each in found.items() if each.failure}
    assert why["bad"] == "13 is not multiplied: give another number"
    assert why["odd"].startswith("TypeError: unsupported operand")
    assert why["gone"] == "SystemExit: no licence"
    assert why["always"].endswith(", in each of 2 tries")
    odd = found["odd"].failure
    assert odd is not None
    assert "return a * b" in odd.trace
    assert (tmp_path / "b").stat().st_size == 2
    with pytest.raises(PieceError, match="bad: 13 is not multiplied"):
        in_order(executor, pieces[:1])


def test_a_piece_runs_where_it_was_asked_for_and_sees_no_gpu_it_has_not(
    executor: Executor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (found,) = in_order(executor, [Piece(name="here", function=whereabouts)])
    assert found == (str(tmp_path), "")


def test_what_a_piece_says_is_in_its_log(
    executor: Executor, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """With what it failed of, and nowhere else; a second try adds to it."""
    log = tmp_path / "logs" / "odd.log"
    for b in (2, 0):
        piece = Piece(name="odd", function=speaks, args=(1, b), log=log)
        with closing(executor.outcomes([piece])) as outcomes:
            assert [bool(each.failure) for each in outcomes] == [b == 0]
    text = log.read_text()
    assert text.count("from Python\n") == text.count("from below\n") == 2
    assert "0.5" in text
    assert text.endswith("ZeroDivisionError: division by zero\n")
    said = capfd.readouterr()
    assert "from" not in said.out + said.err


def test_leaving_early_ends_what_runs(executor: Executor, tmp_path: Path) -> None:
    """As a Ctrl-C does; what is finished was given before."""
    note = tmp_path / "pid"
    pieces = [
        Piece(name="finished", function=product, args=(2, 3)),
        Piece(name="endless", function=stays, args=(note,)),
        Piece(name="waiting", function=stays, args=(tmp_path / "other",)),
    ]
    with closing(executor.outcomes(pieces)) as outcomes:
        assert next(outcomes).value == 6
        wait_for(lambda: note.exists() and note.read_text() != "")
    pid = int(note.read_text())
    # A worker of Ray's outlives a piece that was told to end, and does nothing.
    wait_for(lambda: not alive(pid) or "endless" not in title_of(pid))


def test_a_gpu_is_shared_by_halves_and_waited_for(tmp_path: Path) -> None:
    """Two halves at the same time on the one GPU, then the whole of it."""
    executor = Processes(workers=3, gpus=("GPU-7",))
    pieces = [
        Piece(name="half", function=seen_gpus, args=(tmp_path,), gpus=0.5),
        Piece(name="other half", function=seen_gpus, args=(tmp_path,), gpus=0.5),
        Piece(name="whole", function=seen_gpus, gpus=1.0),
        Piece(name="none", function=seen_gpus),
    ]
    assert in_order(executor, pieces) == ["GPU-7", "GPU-7", "GPU-7", ""]


def test_shares_leave_whole_gpus_whole() -> None:
    """Three thirds fill one of two GPUs, a whole one takes the other, a fifth waits."""
    slots = Slots(9, ("0", "1"))
    thirds = [slots.take(1 / 3) for _ in range(3)]
    assert {third.gpus for third in thirds if third} == {("0",)}
    assert slots.take(2) is None
    whole = slots.take(1.0)
    assert whole is not None
    assert whole.gpus == ("1",)
    assert slots.take(0.2) is None
    free = slots.take(0.0)
    assert free is not None
    assert free.gpus == ()
    for place in (*thirds, whole):
        assert place is not None
        slots.give_back(place)
    both = slots.take(2)
    assert both is not None
    assert both.gpus == ("0", "1")


def test_no_more_pieces_run_than_there_are_workers() -> None:
    slots = Slots(2, ())
    taken = [slots.take(0.0) for _ in range(3)]
    assert [place is None for place in taken] == [False, False, True]


def test_what_is_not_there_is_said_before_anything_starts(
    executor: Executor, tmp_path: Path
) -> None:
    """A GPU that no machine has; a share that cannot be had."""
    note = tmp_path / "note"
    pieces = [
        Piece(name="first", function=dies_at_first, args=(note, 0)),
        Piece(name="big", function=seen_gpus, gpus=8),
    ]
    with pytest.raises(PieceError, match=r"big asks for 8 of a GPU, and .* has 0"):
        in_order(executor, pieces)
    assert not note.exists()
    with pytest.raises(PieceError, match="a whole number"):
        Piece(name="odd", function=seen_gpus, gpus=1.5)


def test_who_is_killed_leaves_no_process_behind(tmp_path: Path) -> None:
    """SIGKILL, which nobody can answer."""
    note = tmp_path / "pid"
    command = [sys.executable, "-m", "tests.gaitpref.test_executor", str(note)]
    with subprocess.Popen(command) as process:
        wait_for(lambda: note.exists() and note.read_text() != "")
        process.kill()
    pid = int(note.read_text())
    wait_for(lambda: not alive(pid))


def alive(pid: int) -> bool:
    """Whether the process is there, and not only its entry."""
    try:
        return "(zombie)" not in Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


def title_of(pid: int) -> str:
    """What a process calls itself; Ray's workers say which task they are at."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""


if __name__ == "__main__":
    in_order(
        Processes(workers=1),
        [Piece(name="endless", function=stays, args=(Path(sys.argv[1]),))],
    )
