"""A camera that walks beside the robot, drawn by MuJoCo without a display.

MuJoCo's own `Renderer` takes the kind of OpenGL that was named when MuJoCo was first
imported; here it is asked for when it is needed, so that a run without a display has
pictures too.
"""

from __future__ import annotations

import copy
import os
import sys
from collections.abc import Iterator
from contextlib import closing, nullcontext
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from data.errors import GaitprefError

from .endless_floor import endless_floor
from .flat_shadow import cast_shadows, flat_floor

_MOST_GEOMS = 2000
_NO = ("disable", "disabled", "off", "false", "0")
"""What MUJOCO_GL says where nothing is to be drawn."""
_OF_TEAM = 1.7
"""How much farther off, and more from above, two robots are seen."""
_SHADOW_PX, _SLICES, _STACKS, _QUADS = 512, 16, 6, 1
"""Of the quality of pictures: without a graphics card it costs most of the time."""
_FINER, _MOST_PX = 1.5, 4096
"""Pictures are drawn so much larger, up to so much, and made smaller for smooth edges:
without a graphics card, several samples a pixel take twice as long."""
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


class Camera:
    """Draws the states of one robot, one picture after the other.

    Several may be open at once in a thread.
    """

    def __init__(self, mj_model: mujoco.MjModel, cfg: CameraCfg | None = None) -> None:
        """Start drawing.

        Args:
            mj_model: The robot in its world; it stays as it is.
            cfg: Where the camera is.

        Raises:
            NoRenderer: this machine cannot draw.
        """
        cfg = cfg or CameraCfg()
        self._size = cfg.width_px, cfg.height_px
        finer = min(_FINER, _MOST_PX / max(self._size))
        width, height = (round(finer * side) for side in self._size)
        try:
            self._drawing: Any = _context(width, height)
            self._drawing.make_current()
        # A platform fails in its own way each.
        except Exception as why:
            found = " ".join(f"{type(why).__name__}: {why}".split())[:120]
            raise NoRenderer(
                f"this machine draws no pictures of the simulation ({found}); on "
                "Linux, install EGL (on Debian: apt-get install libegl1 "
                "libgl1-mesa-dri)"
            ) from None
        self._mj_model = copy.copy(mj_model)
        visual = self._mj_model.vis
        visual.global_.offwidth, visual.global_.offheight = width, height
        visual.quality.shadowsize, visual.quality.offsamples = _SHADOW_PX, 0
        visual.quality.numslices, visual.quality.numstacks = _SLICES, _STACKS
        visual.quality.numquads = _QUADS
        # Lights go along too: far from them shadows break up.
        self._mj_model.light_mode[:] = mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM
        self._mj_data = mujoco.MjData(self._mj_model)
        self._option = mujoco.MjvOption()
        self._scene = mujoco.MjvScene(self._mj_model, _MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._endless = endless_floor(mj_model)
        with (
            self._endless.of_few_tiles(self._mj_model)
            if self._endless
            else nullcontext()
        ):
            self._context = mujoco.MjrContext(
                self._mj_model, mujoco.mjtFontScale.mjFONTSCALE_100
            )
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._view = mujoco.MjrRect(0, 0, width, height)
        self._camera = mujoco.MjvCamera()
        self._camera.distance, self._camera.azimuth = cfg.distance_m, cfg.azimuth_deg
        self._camera.elevation = cfg.elevation_deg
        # A little below where the base stands at home: the feet are judged.
        free = mj_model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        self._bases = mj_model.jnt_qposadr[free]
        if len(self._bases) > 1:
            self._camera.distance *= _OF_TEAM
            self._camera.elevation *= _OF_TEAM
        self._looks_at_m = 0.67 * float(mj_model.qpos0[2] if mj_model.nq else 0.0)
        self._picture = np.empty((height, width, 3), np.uint8)
        self._floor = flat_floor(mj_model)
        if self._floor:
            self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False

    def __call__(self, qpos: np.ndarray) -> np.ndarray:
        """The picture [H, W, 3] uint8 of the state `qpos` [nq]."""
        self._drawing.make_current()
        mj_model, mj_data = self._mj_model, self._mj_data
        mj_data.qpos[:] = qpos
        mujoco.mj_kinematics(mj_model, mj_data)
        mujoco.mj_comPos(mj_model, mj_data)  # What lights follow.
        mujoco.mj_camlight(mj_model, mj_data)
        bases = [qpos[base : base + 2] for base in self._bases] or [qpos[:2]]
        self._camera.lookat[:] = (*np.mean(bases, axis=0), self._looks_at_m)
        mujoco.mjv_updateScene(
            mj_model,
            mj_data,
            self._option,
            None,
            self._camera,
            _STATIC_AND_MOVING,
            self._scene,
        )
        if self._endless:
            self._endless.lay(self._scene)
        if self._floor:
            cast_shadows(self._scene)
        mujoco.mjr_render(self._view, self._scene, self._context)
        mujoco.mjr_readPixels(self._picture, None, self._view, self._context)
        upright = Image.fromarray(self._picture[::-1])
        return np.asarray(upright.resize(self._size, Image.Resampling.BOX))

    def close(self) -> None:
        """Give back what draws; once more does nothing."""
        if self._drawing is not None:
            self._drawing.make_current()
            self._context.free()
            self._drawing.free()
            self._drawing = None


def _context(width_px: int, height_px: int) -> Any:
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    if wanted in _NO:
        raise RuntimeError(f"MUJOCO_GL={wanted} forbids it")
    if sys.platform == "darwin":
        from mujoco.cgl import GLContext
    elif sys.platform == "win32":
        from mujoco.glfw import GLContext
    else:
        # What draws is read once, when OpenGL is first imported.
        os.environ.setdefault("PYOPENGL_PLATFORM", wanted or "egl")
        if wanted == "osmesa":
            from mujoco.osmesa import GLContext
        else:
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
    try:
        mj_model = mujoco.MjModel.from_xml_string(mjcf)
    except ValueError as why:
        raise GaitprefError(f"the robot does not compile ({why})") from None
    with closing(Camera(mj_model, cfg)) as camera:
        for state in states:
            yield camera(state)
