"""A robot as lines that move, where a machine cannot draw its shapes.

Shapes: S states, L legs, P points of a line.
"""

from __future__ import annotations

import html
from collections.abc import Sequence

import mujoco
import numpy as np

from data.features import LEGS

from .shot import Shot

_FPS = 12.5
_WIDTH, _HEIGHT, _SCALE = 320, 200, 260
"""Of a picture, in its own units, and units in a metre."""
_GROUND = 170
_LEFT, _RIGHT = "#8a94a0", "#2563a8"


def stick_figures(shots: Sequence[Shot]) -> str:
    """Each shot as an SVG element, seen from its right side, over and over."""
    return "".join(map(_figure, shots))


def _figure(shot: Shot) -> str:
    frames = max(1, round(shot.duration_s * _FPS))
    lines_b = leg_lines(shot.mjcf, shot.states_at(_FPS, frames))
    trunk = lines_b[:, [0, 1, 3, 2, 0], 0]
    legs = "".join(
        _line(lines_b[:, leg], frames, _LEFT if name.endswith("L") else _RIGHT)
        for leg, name in enumerate(LEGS)
    )
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" role="img">'
        f"<title>{html.escape(shot.caption or 'a clip')}</title>"
        f'<line x1="0" x2="{_WIDTH}" y1="{_GROUND}" y2="{_GROUND}" stroke="#8a94a0"/>'
        f'<text x="8" y="18" fill="currentColor">{html.escape(shot.caption)}</text>'
        f"{legs}{_line(trunk, frames, 'currentColor')}</svg>"
    )


def leg_lines(mjcf: str, states: np.ndarray) -> np.ndarray:
    """[S, L, P, 2] hip, knee and foot of each leg in the plane that the robot walks in:
    metres ahead of its base, and above the ground."""
    mj_model = mujoco.MjModel.from_xml_string(mjcf)
    mj_data = mujoco.MjData(mj_model)
    bodies = [_leg_bodies(mj_model, number) for number in range(len(LEGS))]
    lines = np.empty((len(states), len(LEGS), 3, 2))
    for number, state in enumerate(states):
        mj_data.qpos[:] = state
        mujoco.mj_kinematics(mj_model, mj_data)
        w, x, y, z = state[3:7]
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        for leg, (thigh, calf) in enumerate(bodies):
            foot = _tip(mj_model, mj_data, calf)
            points = np.stack([mj_data.xpos[thigh], mj_data.xpos[calf], foot])
            lines[number, leg, :, 0] = (points - state[:3]) @ ahead
            lines[number, leg, :, 1] = points[:, 2]
    return lines


def _leg_bodies(mj_model: mujoco.MjModel, leg: int) -> tuple[int, int]:
    """Bodies of the second and the third hinge of a leg, in the model's order."""
    hinges = np.flatnonzero(mj_model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    thigh, calf = hinges[3 * leg + 1], hinges[3 * leg + 2]
    return int(mj_model.jnt_bodyid[thigh]), int(mj_model.jnt_bodyid[calf])


def _tip(mj_model: mujoco.MjModel, mj_data: mujoco.MjData, calf: int) -> np.ndarray:
    """Place of what is farthest down the leg."""
    below = [calf, *np.flatnonzero(mj_model.body_parentid == calf)]
    geoms = np.flatnonzero(np.isin(mj_model.geom_bodyid, below))
    if not len(geoms):
        return mj_data.xpos[calf]
    apart = np.linalg.norm(mj_data.geom_xpos[geoms] - mj_data.xpos[calf], axis=1)
    return mj_data.geom_xpos[geoms[np.argmax(apart)]]


def _line(points: np.ndarray, frames: int, colour: str) -> str:
    """A line [S, P, 2] whose corners move."""
    x = _WIDTH / 2 + _SCALE * points[..., 0]
    y = _GROUND - _SCALE * points[..., 1]
    corners = np.stack([x, y], axis=-1).round(1)
    values = [" ".join(f"{a:g},{b:g}" for a, b in frame) for frame in corners]
    return (
        f'<polyline points="{values[0]}" fill="none" stroke="{colour}" '
        f'stroke-width="4" stroke-linejoin="round"><animate attributeName="points" '
        f'calcMode="discrete" repeatCount="indefinite" dur="{frames / _FPS:g}s" '
        f'values="{";".join(values)}"/></polyline>'
    )
