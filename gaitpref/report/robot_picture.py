"""A robot in its home pose as a PNG, drawn without a graphics card or a display.

Shapes: P triangles.
"""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from data.features import LEGS
from labeling_ui.scene.geometry import instance_poses, robot_geometry
from policy.robots.robot import Robot

_SUN_W = np.array([0.3, -0.5, 0.8])
_FRONT, _SIDE = ("from the front right", 35.0, 20.0), ("from the right", 90.0, 2.0)


def draw(robot: Robot) -> bytes:
    """A PNG with two views of the robot and the names of its feet."""
    corners_w, colours = _triangles(robot)
    figure = Figure(figsize=(12, 5.5), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    for place, (title, azimuth_deg, elevation_deg) in enumerate((_FRONT, _SIDE), 1):
        axes = figure.add_subplot(1, 2, place, aspect="equal", title=title)
        to_view = _view(np.radians(azimuth_deg), np.radians(elevation_deg))
        seen = corners_w @ to_view.T  # [P, 3, 3]: right, up, towards the viewer
        # Painter's order: what is nearer is drawn over what is farther.
        order = np.argsort(seen[:, :, 2].mean(axis=1))
        axes.add_collection(
            PolyCollection(
                list(seen[order][:, :, :2]),
                facecolors=colours[order],
                edgecolors=colours[order],
                linewidths=0.2,
            )
        )
        if place == 1:
            _mark_feet(axes, robot, to_view)
        axes.autoscale_view()
        axes.margins(0.1)
        axes.set_xlabel("m")
    stream = io.BytesIO()
    canvas.print_png(stream)
    return stream.getvalue()


def _mark_feet(axes: Axes, robot: Robot, to_view: np.ndarray) -> None:
    for leg, foot in zip(LEGS, robot.home_foot_pos_w @ to_view.T, strict=True):
        axes.plot(foot[0], foot[1], "o", color="#d62728", markersize=5)
        axes.annotate(
            leg, foot[:2], (4, -14), textcoords="offset points", weight="bold"
        )


def _triangles(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Corners [P, 3, 3] in the world frame, m, and shaded colours [P, 3]."""
    geometry = robot_geometry(robot.mjcf)
    positions, attitudes = instance_poses(geometry, robot.home_qpos[None])
    sun_w = _SUN_W / np.linalg.norm(_SUN_W)
    corners, colours = [], []
    for mesh, instances in zip(geometry.meshes, geometry.instance_slices, strict=True):
        for at, wxyz in zip(
            positions[0, instances], attitudes[0, instances], strict=True
        ):
            for piece in mesh.pieces:
                solid = piece.solid.moved(at, wxyz)
                faces_w = solid.vertices[solid.faces]
                normals = np.cross(
                    faces_w[:, 1] - faces_w[:, 0], faces_w[:, 2] - faces_w[:, 0]
                )
                lengths = np.linalg.norm(normals, axis=1, keepdims=True)
                normals /= np.maximum(lengths, 1e-12)
                # Meshes of others list corners in either sense.
                light = 0.45 + 0.55 * np.abs(normals @ sun_w)
                corners.append(faces_w)
                colours.append(light[:, None] * np.array(piece.rgb))
    return np.concatenate(corners), np.concatenate(colours)


def _view(azimuth: float, elevation: float) -> np.ndarray:
    """World to view [3, 3]; the viewer looks from `azimuth` right of the front, rad."""
    from_w = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            -np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    right = np.cross((0.0, 0.0, 1.0), from_w)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(from_w, right), from_w])
