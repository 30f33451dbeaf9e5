"""A camera that walks beside the robot, drawn by MuJoCo without a display.

MuJoCo's own `Renderer` takes the kind of OpenGL that was named when MuJoCo was first
imported; here it is asked for when it is needed, so that a run without a display has
pictures too.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from data.errors import GaitprefError

_MOST_GEOMS = 2000
_SHADOW_PX, _SAMPLES = 512, 4
"""Of the quality of pictures: without a graphics card they cost most of the time."""
_STATIC_AND_MOVING = int(mujoco.mjtCatBit.mjCAT_ALL)


class NoRenderer(GaitprefError):
    """This machine cannot draw pictures of the simulation."""


@dataclass(frozen=True, kw_only=True)
class CameraCfg:
    """Where the camera is and how large its pictures are."""

    width_px: int = 320
    height_px: int = 240
    distance_m: float = 1.5
    """From the robot's base."""
    azimuth_deg: float = 130.0
    """Where it looks: 90 is to the left of a robot that looks along x."""
    elevation_deg: float = -14.0

    def __post_init__(self) -> None:
        if not (16 <= self.width_px <= 4096 and 16 <= self.height_px <= 4096):
            raise ValueError(
                f"a picture is 16 to 4096 pixels wide and high, got "
                f"{self.width_px} x {self.height_px}"
            )


@contextmanager
def _drawing(width_px: int, height_px: int) -> Iterator[Any]:
    """An OpenGL context of this thread.

    Raises:
        NoRenderer: there is none.
    """
    try:
        context = _context(width_px, height_px)
    except (ImportError, RuntimeError, AttributeError, OSError) as why:
        raise NoRenderer(
            f"this machine draws no pictures of the simulation ({why}); on Linux, "
            f"install EGL (on Debian: apt-get install libegl1 libgl1-mesa-dri)"
        ) from None
    try:
        context.make_current()
        yield context
    finally:
        context.free()


def _context(width_px: int, height_px: int) -> Any:
    if sys.platform == "darwin":
        from mujoco.cgl import GLContext
    elif sys.platform == "win32":
        from mujoco.glfw import GLContext
    else:
        # What draws is read once, when OpenGL is first imported.
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        from mujoco.egl import GLContext
    return GLContext(width_px, height_px)


def frames_of(
    mjcf: str, states: np.ndarray, cfg: CameraCfg | None = None
) -> Iterator[np.ndarray]:
    """Pictures [H, W, 3] uint8 of the states [S, nq], one after the other.

    Raises:
        NoRenderer: this machine cannot draw them.
        GaitprefError: the robot does not compile.
    """
    cfg = cfg or CameraCfg()
    try:
        mj_model = mujoco.MjModel.from_xml_string(mjcf)
    except ValueError as why:
        raise GaitprefError(f"the robot does not compile ({why})") from None
    with _drawing(cfg.width_px, cfg.height_px) as drawing:
        yield from _drawn(mj_model, states, cfg, drawing)


def _drawn(
    mj_model: mujoco.MjModel, states: np.ndarray, cfg: CameraCfg, drawing: Any
) -> Iterator[np.ndarray]:
    """Pictures; between two of them others may draw in contexts of their own."""
    visual = mj_model.vis
    visual.global_.offwidth, visual.global_.offheight = cfg.width_px, cfg.height_px
    visual.quality.shadowsize, visual.quality.offsamples = _SHADOW_PX, _SAMPLES
    mj_data = mujoco.MjData(mj_model)
    scene, option = mujoco.MjvScene(mj_model, _MOST_GEOMS), mujoco.MjvOption()
    scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    context = mujoco.MjrContext(mj_model, mujoco.mjtFontScale.mjFONTSCALE_100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    view = mujoco.MjrRect(0, 0, cfg.width_px, cfg.height_px)
    camera = mujoco.MjvCamera()
    camera.distance, camera.azimuth = cfg.distance_m, cfg.azimuth_deg
    camera.elevation = cfg.elevation_deg
    # Level where the base stands at home, a little below it: the feet are judged.
    looks_at_m = 0.67 * float(mj_model.qpos0[2])
    picture = np.empty((cfg.height_px, cfg.width_px, 3), np.uint8)
    try:
        for state in states:
            drawing.make_current()
            mj_data.qpos[:] = state
            mujoco.mj_kinematics(mj_model, mj_data)
            mujoco.mj_comPos(mj_model, mj_data)  # What lights follow.
            mujoco.mj_camlight(mj_model, mj_data)
            camera.lookat[:] = (*state[:2], looks_at_m)
            mujoco.mjv_updateScene(
                mj_model, mj_data, option, None, camera, _STATIC_AND_MOVING, scene
            )
            mujoco.mjr_render(view, scene, context)
            mujoco.mjr_readPixels(picture, None, view, context)
            yield picture[::-1].copy()
    finally:
        drawing.make_current()
        context.free()
