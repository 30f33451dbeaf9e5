"""Where the robots stand in pictures of different shapes, as a visitor is sent it."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest

from benchmarks.visitor import Visitor
from benchmarks.walks import walking_dataset
from labeling_ui.label_server import LabelCfg, LabelServer


@pytest.mark.parametrize(
    ("picture", "apart"),
    [((390, 456), (0.0, 0.66)), ((528, 390), (-1.2, 0.0)), ((1280, 720), (-1.2, 0.0))],
)
def test_one_robot_stands_above_the_other_where_it_is_narrow(
    tmp_path: Path, picture: tuple[int, int], apart: tuple[float, float]
) -> None:
    """A's name beside B's, or above it, by so many metres along x and z."""
    dataset = walking_dataset(tmp_path / "set", pairs=3)

    async def names(url: str) -> list[np.ndarray]:
        visitor = Visitor(url, None, picture=picture)
        page = asyncio.create_task(visitor.run())
        async with asyncio.timeout(60):
            await visitor.until_moving()
            while not {"/label_A", "/label_B"} <= visitor.places.keys():
                await asyncio.sleep(0.02)
        page.cancel()
        return [np.array(visitor.places[name]) for name in ("/label_A", "/label_B")]

    with LabelServer(dataset, LabelCfg(port=0, auth=False)) as server:
        a, b = asyncio.run(names(server.url))
    assert (a - b)[[0, 2]] == pytest.approx(apart, abs=0.01)
