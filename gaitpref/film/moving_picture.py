"""A picture whose frames are made when its encoder asks for them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from PIL import Image


class MovingPicture(Image.Image):
    """Frames [H, W, 3] uint8 as Pillow reads those of an animated file: forwards, one
    at a time, so that one is encoded while the next is drawn."""

    def __init__(self, frames: Iterator[np.ndarray], count: int) -> None:
        """Take the first frame.

        Args:
            frames: All of them.
            count: How many they are.
        """
        super().__init__()
        self.n_frames = count
        self._frames = frames
        self._number = -1
        self.seek(0)

    def seek(self, frame: int) -> None:
        """Go on to a frame; one that is over does not come back.

        Raises:
            EOFError: there is none of this number.
        """
        if frame >= self.n_frames:
            raise EOFError(f"frame {frame} of {self.n_frames}")
        while self._number < frame:
            picture = Image.fromarray(next(self._frames))
            self.im, self._mode, self._size = picture.im, picture.mode, picture.size
            self._number += 1

    def tell(self) -> int:
        """Number of the present frame."""
        return self._number
