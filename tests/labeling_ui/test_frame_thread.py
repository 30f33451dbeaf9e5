"""The thread that moves all pages: how often, and what one broken page does."""

import time

from labeling_ui.page.frame_thread import CROWD, Ticker
from labeling_ui.page.loop_status import LoopStatus, no_status


class Counted:
    """A page that counts its frames, or fails at the first."""

    def __init__(self, *, broken: bool = False) -> None:
        self.frames = 0
        self._broken = broken

    def tick(self, elapsed_s: float, status: LoopStatus | None) -> None:
        self.frames += 1
        if self._broken:
            raise ValueError("this page is broken")

    def attend(self) -> None:
        pass


def moved(pages: list[Counted], seconds: float) -> None:
    """Move `pages` for so long."""
    ticker = Ticker(no_status)
    for key, page in enumerate(pages):
        ticker.add(key, page)
    ticker.start()
    time.sleep(seconds)
    ticker.stop()


def test_a_crowd_is_moved_half_as_often() -> None:
    few = [Counted() for _ in range(CROWD)]
    many = [Counted() for _ in range(CROWD + 1)]
    moved(few, 1.5)
    moved(many, 1.5)
    assert few[0].frames > 1.4 * many[0].frames
    assert many[-1].frames > 5


def test_a_broken_page_is_left_and_the_others_move_on() -> None:
    broken, well = Counted(broken=True), Counted()
    moved([broken, well], 0.5)
    assert broken.frames == 1
    assert well.frames > 2
