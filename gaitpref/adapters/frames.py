"""Pictures of a robot, for those who record videos of an environment.

Shapes: N environments.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from data.errors import GaitprefError
from policy.robots.robot import Robot

MODES = ("rgb_array",)
"""Ways to render that there are."""
_WIDTH, _HEIGHT = 480, 360
_DISTANCE_M, _AZIMUTH_DEG, _ELEVATION_DEG = 1.6, 130.0, -18.0


class Frames:
    """Draws one robot without a window; the camera goes along with it."""

    def __init__(self, robot: Robot) -> None:
        """Start MuJoCo's offscreen renderer.

        Raises:
            GaitprefError: there is none on this machine, or in this process.
        """
        self._mj_model = robot.mj_model
        self._mj_data = mujoco.MjData(robot.mj_model)
        visual = robot.mj_model.vis.global_
        height, width = min(_HEIGHT, visual.offheight), min(_WIDTH, visual.offwidth)
        try:
            self._renderer = mujoco.Renderer(robot.mj_model, height, width)
        except Exception as error:
            # A platform fails in its own way each.
            found = " ".join(f"{type(error).__name__}: {error}".split())[:120]
            raise GaitprefError(
                "render_mode='rgb_array' needs an offscreen renderer, and MuJoCo finds "
                f"none ({found}); start Python with MUJOCO_GL=egl, where the driver "
                "has EGL, or MUJOCO_GL=osmesa with libosmesa6 installed, or leave "
                "render_mode out"
            ) from None
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        self._camera.trackbodyid = robot.base_body_id
        self._camera.distance = _DISTANCE_M
        self._camera.azimuth, self._camera.elevation = _AZIMUTH_DEG, _ELEVATION_DEG

    def __call__(self, qpos: np.ndarray) -> np.ndarray:
        """The picture [height, width, 3] uint8 of the state `qpos` [nq]."""
        self._mj_data.qpos[:] = qpos
        mujoco.mj_kinematics(self._mj_model, self._mj_data)
        mujoco.mj_comPos(self._mj_model, self._mj_data)
        mujoco.mj_camlight(self._mj_model, self._mj_data)
        self._renderer.update_scene(self._mj_data, self._camera)
        return self._renderer.render().copy()

    def close(self) -> None:
        """Give the renderer back."""
        self._renderer.close()


def frames_for(robot: Robot, render_mode: str | None) -> Frames | None:
    """What draws in `render_mode`; None where nothing is to be drawn.

    Raises:
        GaitprefError: there is no such mode, or no renderer.
    """
    if render_mode is None:
        return None
    if render_mode not in MODES:
        raise GaitprefError(
            f"render_mode is {' or '.join(map(repr, MODES))}, got {render_mode!r}; to "
            "watch a policy in a browser: `gaitpref play`"
        )
    return Frames(robot)


def metadata_of(control_dt_s: float, others: dict[str, Any]) -> dict[str, Any]:
    """Gymnasium's facts about how an environment is drawn, beside `others`."""
    return others | {"render_modes": list(MODES), "render_fps": round(1 / control_dt_s)}
