"""The way ahead of a robot, and how far it came of what it was asked for."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.walks import walk
from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from labeling_ui.label_server import LabelServer
from labeling_ui.scene.obedience import AHEAD_S, HIDDEN_M, obeyed, ways
from tests.helpers.label_browser import (
    LAPTOP,
    WAIT_MS,
    dismiss_guidelines,
    label_cfg,
    launched,
)

STANDS = np.zeros((2, 2))
AHEAD = np.zeros(2)


def test_the_way_ahead_is_as_long_as_the_speed_says_and_turns_with_the_robot() -> None:
    """0.5 m/s forward, of a robot that heads to the left."""
    headings = np.array([0.0, np.pi / 2])
    positions, wxyzs = ways(STANDS, headings, np.array([[0.5, 0.0, 0.0]]))
    length = positions[:, -1] - positions[:, 0]
    expected = [[0.5 * AHEAD_S, 0.0, 0.0], [0.0, 0.5 * AHEAD_S, 0.0]]
    assert length == pytest.approx(np.array(expected), abs=1e-6)
    assert wxyzs[1, 0] == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


def test_a_turn_on_the_spot_is_a_bow_around_it() -> None:
    """All marks are as far away; the last is turned by the yaw of that time."""
    positions, wxyzs = ways(STANDS, AHEAD, np.array([[0.0, 0.0, 1.0]]))
    far = np.linalg.norm(positions[0, :, :2], axis=-1)
    assert far == pytest.approx(far[0])
    angles = 2 * np.arctan2(wxyzs[0, :, 3], wxyzs[0, :, 0])
    assert angles[-1] - angles[0] == pytest.approx(AHEAD_S)


def test_who_is_told_to_stand_has_no_way() -> None:
    positions, _ = ways(STANDS, AHEAD, np.zeros((1, 3)))
    assert (positions == HIDDEN_M).all()


def test_what_was_asked_for_is_measured_along_the_robot() -> None:
    """Sent to the left at 0.2 m/s for a second, it goes half as far, and ahead."""
    ground = np.linspace([0.0, 0.0], [0.3, 0.1], 51)
    asked = np.tile([0.0, 0.2, 0.5], (50, 1))
    found = obeyed(ground, np.zeros(51), asked, 0.02)
    assert found.went_m == pytest.approx(0.1)
    assert found.asked_m == pytest.approx(0.2)
    assert (found.turned_rad, found.asked_rad) == pytest.approx((0.0, 0.5))


@pytest.mark.browser
def test_the_page_shows_who_obeys(tmp_path: Path) -> None:
    """Beside the feet how far each came, and green marks before the robots; of two that
    are asked for 0.5 m/s over 1.2 s, one goes at half of it."""
    dataset = Dataset.create(tmp_path / "set")
    good = walk(100, seed=0)
    lazy = replace(good, qpos=good.qpos * np.where(np.arange(19) == 0, 0.5, 1.0))
    clips = [Clip(each.sha256, 0, 60) for each in dataset.add_episodes([good, lazy])]
    with dataset.answers() as store:
        store.add_pairs([Pair.make(*clips, strategy="random", round=0)])
    with LabelServer(dataset, label_cfg(auth=False)) as server, launched() as browser:
        page = browser.new_page(viewport=LAPTOP)
        page.set_default_timeout(WAIT_MS)
        page.goto(server.url + "/?fixedDpr=0.25")
        dismiss_guidelines(page)
        went = page.locator(".gp .went")
        went.nth(1).wait_for()
        told = {row.inner_text().replace("\n", " ") for row in went.all()}
        page.keyboard.press(" ")
        page.get_by_text("1x paused").wait_for()
        marks = 0
        for _ in range(30):
            drawn = page.locator("canvas[data-engine]").screenshot()
            if marks := _green(drawn):
                break
            page.wait_for_timeout(500)
    assert told == {"went 0.60 m of 0.60 m", "went 0.30 m of 0.60 m"}
    assert marks > 20


def _green(png: bytes) -> int:
    """Pixels that are; neither robot nor the floor is."""
    red, green, blue = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), int).T
    return int(((green > red + 25) & (green > blue + 10)).sum())
