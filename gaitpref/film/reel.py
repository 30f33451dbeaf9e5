"""Shots side by side, as the frames of one film, and films as files.

Shapes: H, W height and width of a frame in pixels.
"""

from __future__ import annotations

import io
import math
import sys
from collections.abc import Callable, Generator, Iterator, Sequence, Sized
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from data.errors import GaitprefError
from data.files.files import write_atomically
from gaitpref.console.extras import require

from .camera import CameraCfg, frames_of
from .moving_picture import MovingPicture
from .shot import Shot

KINDS = (".mp4", ".gif", ".webp")
_INK, _PAPER = (30, 36, 44), (255, 255, 255)
_MARGIN_PX = 6
_Frames = Generator[np.ndarray, None, None]
_QUALITY = 60
"""Of WebP, in percent: a robot on a plain floor."""


@dataclass(frozen=True, kw_only=True)
class FilmCfg:
    """How a film is made."""

    camera: CameraCfg = field(default_factory=CameraCfg)
    fps: float = 25.0
    """Pictures a second."""
    speed: float = 1.0
    """1 is as fast as it was; 0.25 is slow motion."""

    def __post_init__(self) -> None:
        if not (1 <= self.fps <= 60 and 0.01 <= self.speed <= 10):
            raise ValueError(
                f"a film has 1 to 60 pictures a second and a speed of 0.01 to 10, got "
                f"{self.fps} and {self.speed}"
            )


@dataclass(frozen=True)
class Film(Iterator[np.ndarray]):
    """Frames that are drawn when they are asked for, and how many they are."""

    _frames: _Frames
    _count: int

    def __next__(self) -> np.ndarray:
        return next(self._frames)

    def __len__(self) -> int:
        return self._count

    def close(self) -> None:
        """Stop drawing."""
        self._frames.close()


def film(
    shots: Sequence[Shot],
    cfg: FilmCfg,
    advance: Callable[[], None] = lambda: None,
) -> Film:
    """Frames [H, W, 3] uint8 with the shots beside one another, from left to right.

    As long as the longest shot; where another is over, its last state stays. Each shot
    is drawn in a thread of its own, a frame ahead.

    Args:
        shots: What is shown, one or more.
        cfg: How.
        advance: Called after each frame.

    Raises:
        NoRenderer: this machine cannot draw them.
    """
    count = frame_count(shots, cfg)
    return Film(_side_by_side(shots, cfg, count, advance), count)


def _side_by_side(
    shots: Sequence[Shot], cfg: FilmCfg, count: int, advance: Callable[[], None]
) -> _Frames:
    drawn = [
        _ahead(
            _captioned(
                frames_of(
                    shot.mjcf, shot.states_at(cfg.fps / cfg.speed, count), cfg.camera
                ),
                shot.captions(cfg.fps / cfg.speed, count),
            )
        )
        for shot in shots
    ]
    with ExitStack() as open_cameras:
        for shot in drawn:
            open_cameras.callback(shot.close)
        for together in zip(*drawn, strict=True):
            advance()
            yield np.concatenate(together, axis=1)


def frame_count(shots: Sequence[Shot], cfg: FilmCfg) -> int:
    """Frames of the film."""
    longest_s = max(shot.duration_s for shot in shots) / cfg.speed
    return max(1, round(longest_s * cfg.fps))


def _ahead(frames: _Frames) -> _Frames:
    """The same frames, each drawn while the one before is used."""
    if sys.platform == "win32":
        # What draws there wants the main thread.
        yield from frames
        return
    with ThreadPoolExecutor(1, "drawing") as drawing:
        coming = drawing.submit(next, frames, None)
        try:
            while (frame := coming.result()) is not None:
                coming = drawing.submit(next, frames, None)
                yield frame
        finally:
            # A camera is closed where it was opened.
            drawing.submit(frames.close).result()


def _captioned(frames: Iterator[np.ndarray], captions: Sequence[str]) -> _Frames:
    for frame, caption in zip(frames, captions, strict=True):
        if not caption:
            yield frame
            continue
        label = _label(caption)[: len(frame), : frame.shape[1]]
        written = frame.copy()
        written[: len(label), : label.shape[1]] = label
        yield written


@lru_cache(maxsize=64)
def _label(caption: str) -> np.ndarray:
    """[H, W, 3] uint8 of the words on paper."""
    font = ImageFont.load_default()
    _, _, right, bottom = font.getbbox(caption)
    size = math.ceil(right) + 2 * _MARGIN_PX, math.ceil(bottom) + 2 * _MARGIN_PX
    picture = Image.new("RGB", size, _PAPER)
    ImageDraw.Draw(picture).text((_MARGIN_PX, _MARGIN_PX), caption, _INK, font)
    return np.asarray(picture)


def webp_of(frames: Iterator[np.ndarray], fps: float) -> bytes:
    """The film as an animated WebP, which browsers show like a picture."""
    # A film is seen from its start: no picture is kept to begin at.
    begins = {"kmin": 0, "kmax": 0}
    return _animated(frames, fps, "WEBP", {"quality": _QUALITY, "method": 2} | begins)


def write_film(frames: Iterator[np.ndarray], path: Path, fps: float) -> None:
    """Write a film whose kind its ending says; the file is there when it is whole.

    Raises:
        GaitprefError: it is none of these, or MP4 is wanted and no encoder is there.
    """
    require_kind(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gif":
        write_atomically(path, _animated(frames, fps, "GIF", {}))
    elif path.suffix == ".webp":
        write_atomically(path, webp_of(frames, fps))
    else:
        _write_mp4(frames, path, fps)


def require_kind(path: Path) -> None:
    """Do nothing for a film that can be written.

    Raises:
        GaitprefError: it cannot.
    """
    if path.suffix not in KINDS:
        raise GaitprefError(f"{path} must end in {', '.join(KINDS)}")
    if path.suffix == ".mp4":
        require("imageio_ffmpeg", "film")


def _write_mp4(frames: Iterator[np.ndarray], path: Path, fps: float) -> None:
    ffmpeg = require("imageio_ffmpeg", "film")
    part = path.with_name(f".{path.stem}.part.mp4")
    first = next(frames)
    height, width, _ = first.shape
    writer = ffmpeg.write_frames(
        str(part), (width, height), fps=fps, macro_block_size=2, quality=7
    )
    try:
        writer.send(None)
        writer.send(np.ascontiguousarray(first))
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
        writer.close()
        write_atomically(path, part.read_bytes())
    finally:
        writer.close()
        part.unlink(missing_ok=True)


def _animated(
    frames: Iterator[np.ndarray], fps: float, kind: str, options: dict[str, int]
) -> bytes:
    counted = frames if isinstance(frames, Sized) else list(frames)
    picture = MovingPicture(iter(counted), len(counted))
    stream = io.BytesIO()
    picture.save(
        stream, kind, save_all=True, duration=round(1000 / fps), loop=0, **options
    )
    return stream.getvalue()
