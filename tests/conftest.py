"""Settings of all tests, and the data bases that answers are kept in."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from hypothesis import settings

from data.answers.address import Address
from tests.helpers import curves_of_reports, postgres

# A busy machine is no failure: how long one example takes is not what is tested.
settings.register_profile("gaitpref", deadline=None)
settings.load_profile("gaitpref")
# As in every command: small matrices gain nothing from a second thread, and those of
# MKL waited for one another for ever on a busy machine. Likewise in what tests start.
torch.set_num_threads(1)
os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"
# Reports draw stick figures, but in the tests of films: pictures take seconds a loop.
os.environ["MUJOCO_GL"] = "disable"


@pytest.fixture(scope="session", autouse=True)
def blank_curves() -> Iterator[None]:
    """Likewise the curves, but where a test asks for them to be drawn."""
    with curves_of_reports.blank():
        yield


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: who waits for a browser needs none."""
    return 1 + (os.cpu_count() or 1)


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[str]:
    """The URL of a PostgreSQL server that lives as long as the tests."""
    with postgres.server() as url:
        yield url


@pytest.fixture
def postgres_answers(postgres_server: str) -> str:
    """The URL of an empty store of answers in PostgreSQL."""
    return postgres.new_schema(postgres_server)


@pytest.fixture(params=["sqlite", "postgresql"])
def answers_address(request: pytest.FixtureRequest, tmp_path: Path) -> Address:
    """Where answers are kept: once a file, once a server."""
    if request.param == "sqlite":
        return tmp_path / "preferences.sqlite"
    return request.getfixturevalue("postgres_answers")
