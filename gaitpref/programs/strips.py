"""Still pictures of a clip for a program that looks: key frames, and the footfalls.

Shapes: S states, T steps, H, W height and width in pixels.
"""

from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageDraw

from data.features import LEGS
from gaitpref.film.camera import CameraCfg, NoRenderer, frames_of
from gaitpref.film.shot import Shot
from gaitpref.film.stick_figure import leg_lines

KEY_FRAMES = 8
"""Pictures of a film strip, evenly spaced over the clip."""
CAMERA = CameraCfg(
    width_px=256, height_px=192, distance_m=1.2, azimuth_deg=105.0, elevation_deg=-10.0
)
"""From the side, where legs are seen best."""
_COLUMNS = 4
_INK, _PAPER = (30, 36, 44), (255, 255, 255)
_NEAR, _FAR, _FALL = (37, 99, 168), (138, 148, 160), (224, 49, 49)
_PX_OF_M = 260
_STRIP_WIDTH, _ROW_PX, _LEFT_PX = 800, 26, 40


def key_frames(shot: Shot) -> tuple[np.ndarray, ...]:
    """Pictures [H, W, 3] uint8 of a shot, from its first state to its last; a stick
    figure where this machine draws nothing else."""
    states = shot.qpos[key_steps(len(shot.qpos))]
    try:
        return tuple(frames_of(shot.mjcf, states, CAMERA))
    except NoRenderer:
        return tuple(_stick_frames(shot.mjcf, states))


def key_steps(steps: int) -> np.ndarray:
    """[S] steps of the key frames of a clip of so many."""
    return np.linspace(0, steps - 1, KEY_FRAMES).round().astype(int)


def film_strip(frames: tuple[np.ndarray, ...], times_s: np.ndarray) -> np.ndarray:
    """[H, W, 3] the frames in rows of four, each with its time."""
    height, width, _ = frames[0].shape
    rows = -(-len(frames) // _COLUMNS)
    strip = Image.new("RGB", (_COLUMNS * width, rows * height), _PAPER)
    draw = ImageDraw.Draw(strip)
    for number, (frame, time_s) in enumerate(zip(frames, times_s, strict=True)):
        row, place = divmod(number, _COLUMNS)
        x, y = place * width, row * height
        strip.paste(Image.fromarray(frame), (x, y))
        words = f"{number + 1}: {time_s:.2f} s"
        draw.rectangle(draw.textbbox((x + 5, y + 4), words), fill=_PAPER)
        draw.text((x + 5, y + 4), words, fill=_INK)
    return np.asarray(strip)


def footfall_strip(contact: np.ndarray, dt_s: float, *, fell: bool) -> np.ndarray:
    """[H, W, 3] a row for each leg of `contact` [T, 4], dark while the foot is down."""
    height = (len(LEGS) + 1) * _ROW_PX
    strip = Image.new("RGB", (_LEFT_PX + _STRIP_WIDTH + 10, height), _PAPER)
    draw = ImageDraw.Draw(strip)
    wide = _STRIP_WIDTH / len(contact)
    for leg, name in enumerate(LEGS):
        y = leg * _ROW_PX
        draw.text((8, y + 7), name, fill=_INK)
        ends = (_LEFT_PX, y + 4, _LEFT_PX + _STRIP_WIDTH, y + _ROW_PX - 4)
        draw.rectangle(ends, fill=(228, 231, 235))
        # Nobody measured a contact that is NaN.
        for step in np.flatnonzero(contact[:, leg] > 0.5):
            x = _LEFT_PX + wide * step
            box = (round(x), y + 4, max(round(x), round(x + wide) - 1), y + _ROW_PX - 4)
            draw.rectangle(box, fill=_NEAR)
    if fell:
        x = _LEFT_PX + _STRIP_WIDTH
        draw.rectangle((x - 6, 0, x, len(LEGS) * _ROW_PX), fill=_FALL)
    for share in np.linspace(0.0, 1.0, 5):
        words = f"{share * len(contact) * dt_s:.2f} s"
        x = _LEFT_PX + share * _STRIP_WIDTH - (0 if share == 0 else 34 * share)
        draw.text((x, len(LEGS) * _ROW_PX + 6), words, fill=_INK)
    return np.asarray(strip)


def png_of(picture: np.ndarray) -> bytes:
    """A picture [H, W, 3] as a PNG file."""
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def _stick_frames(mjcf: str, states: np.ndarray) -> Iterator[np.ndarray]:
    width, height = CAMERA.width_px, CAMERA.height_px
    ground = 0.85 * height
    lines = leg_lines(mjcf, states)  # [S, L, P, 2]
    points = np.stack(
        [width / 2 + _PX_OF_M * lines[..., 0], ground - _PX_OF_M * lines[..., 1]],
        axis=-1,
    )
    for of_state in points:
        picture = Image.new("RGB", (width, height), _PAPER)
        draw = ImageDraw.Draw(picture)
        draw.line((0, ground, width, ground), fill=_FAR, width=2)
        far_first = sorted(range(len(LEGS)), key=lambda leg: LEGS[leg].endswith("R"))
        for leg in far_first:
            colour = _FAR if LEGS[leg].endswith("L") else _NEAR
            draw.line([tuple(p) for p in of_state[leg]], fill=colour, width=4)
        trunk = [tuple(p) for p in of_state[[0, 1, 3, 2, 0], 0]]
        draw.line(trunk, fill=_INK, width=5)
        yield np.asarray(picture)
