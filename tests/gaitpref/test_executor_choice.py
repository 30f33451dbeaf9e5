"""Which executor a command gets, and what it is told where there is none."""

from __future__ import annotations

import time

import pytest

from benchmarks.in_order import in_order
from gaitpref.executor.choose_executor import choose_executor
from gaitpref.executor.pieces import Piece, PieceError
from gaitpref.executor.processes import Processes
from gaitpref.executor.ray_tasks import RayTasks
from policy.parallel.ray_connection import RayError


def test_a_command_chooses_one() -> None:
    assert choose_executor(jobs=3, ray=None) == Processes(workers=3)
    assert choose_executor(jobs=None, ray="auto") == RayTasks(address="auto")
    with pytest.raises(PieceError, match="no number of processes"):
        choose_executor(jobs=3, ray="auto")


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
    pytest.importorskip("ray")
    start_s = time.monotonic()
    with pytest.raises(RayError, match=told):
        in_order(RayTasks(address=address), [Piece(name="x", function=print)])
    assert time.monotonic() - start_s < 60
