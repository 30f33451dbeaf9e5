"""Pictures of a robot, for those who record videos of an environment."""

from __future__ import annotations

from typing import Any

from data.errors import GaitprefError
from gaitpref.film.camera import Camera, CameraCfg
from policy.robots.robot import Robot

MODES = ("rgb_array",)
"""Ways to render that there are."""
_CAMERA = CameraCfg(width_px=480, height_px=360)


def frames_for(robot: Robot, render_mode: str | None) -> Camera | None:
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
    return Camera(robot.mj_model, _CAMERA)


def metadata_of(control_dt_s: float, others: dict[str, Any]) -> dict[str, Any]:
    """Gymnasium's facts about how an environment is drawn, beside `others`."""
    return others | {"render_modes": list(MODES), "render_fps": round(1 / control_dt_s)}
