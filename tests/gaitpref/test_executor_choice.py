"""Which executor a command gets, and what it is told where there is none."""

from __future__ import annotations

import pickle
import socket
import sys
import time
from pathlib import Path

import pytest

from benchmarks.in_order import in_order
from gaitpref.executor.choose_executor import choose_executor, cores_each
from gaitpref.executor.pieces import Piece, PieceError, attempt
from gaitpref.executor.processes import Processes
from gaitpref.executor.ray_tasks import RayTasks
from policy.parallel import ray_connection
from policy.parallel.cores import CORES, cores
from policy.parallel.ray_connection import RayError
from tests.helpers.required import needed


def test_a_command_chooses_one() -> None:
    assert choose_executor(jobs=3, ray=None) == Processes(workers=3)
    assert choose_executor(jobs=None, ray="auto") == RayTasks(address="auto")
    with pytest.raises(PieceError, match="no number of processes"):
        choose_executor(jobs=3, ray="auto")


def test_pieces_share_the_cores_of_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 16, two have 8 each and three 5, though more could run side by side; a piece
    of Ray's has one. A piece knows of its own, and who ran it here of all again."""
    monkeypatch.setenv(CORES, "16")
    assert [
        cores_each(pieces, jobs=jobs, ray=None)
        for pieces, jobs in ((40, 2), (3, None), (40, None), (0, 4), (40, 99))
    ] == [8, 5, 1, 16, 1]
    assert cores_each(2, jobs=None, ray="auto") == 1
    pieces = [Piece(name=f"{each}", function=cores, cores=each) for each in (1, 8)]
    assert in_order(Processes(workers=2), pieces) == [1, 8]
    assert pickle.loads(attempt(pieces[1].packed())) == 8
    assert cores() == 16
    # What says nothing of a number is as if it was not set.
    monkeypatch.setenv(CORES, "many")
    assert 0 < cores() < 10_000


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("nowhere", "takes HOST:PORT.*, auto or local, got 'nowhere'"),
        (
            "127.0.0.1:1",
            r"no Ray answers at .*127.0.0.1:1 .* --port 1` starts",
        ),
        ("127.0.0.1:99999", "no Ray answers at"),
        ("no-such-host.invalid:6379", "no Ray answers at"),
    ],
)
def test_an_address_where_no_ray_is_is_said_at_once(address: str, told: str) -> None:
    """Ray itself would try for minutes."""
    needed("ray", "RAY")
    start_s = time.monotonic()
    with pytest.raises(RayError, match=told):
        in_order(RayTasks(address=address), [Piece(name="x", function=print)])
    assert time.monotonic() - start_s < 60


def test_what_listens_and_is_no_ray_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether or not there is a script `ray` beside this Python."""
    needed("ray", "RAY")
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setattr(ray_connection, "_ANSWER_S", 3.0)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(RayError, match=r"what answers at .* is not Ray"):
            in_order(RayTasks(address=address), [Piece(name="x", function=print)])
