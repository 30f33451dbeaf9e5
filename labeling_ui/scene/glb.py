"""Meshes as binary glTF: those of a robot, tinted for its side of the page, and others.

All of them are made with one kind of material, so that a browser builds one program to
draw them; without a graphics card it takes seconds for each kind there is.
"""

from __future__ import annotations

import colorsys
import io
from functools import lru_cache

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from .geometry import BodyMesh, Rgb, RobotGeometry, linear_rgb
from .solids import Solid

LEFT_RGB: Rgb = (0.20, 0.47, 0.93)
"""A, the left side: blue."""
RIGHT_RGB: Rgb = (0.96, 0.52, 0.10)
"""B, the right side: orange; told from blue by every kind of colour vision."""


@lru_cache(maxsize=16)
def tinted_glbs(
    geometry: RobotGeometry, side: Rgb, opacity: float = 1.0
) -> tuple[bytes, ...]:
    """One file per mesh of the robot, in the colours of its side."""
    return tuple(_glb(mesh, side, opacity) for mesh in geometry.meshes)


def tinted(rgb: Rgb, side: Rgb) -> Rgb:
    """The colour of a part on a robot of the colour `side`.

    Light parts take the side's colour, dark ones only a breath of it, and what was
    coloured to stand out turns white, so that the robot keeps its look.
    """
    hue, saturation, value = colorsys.rgb_to_hsv(*rgb)
    del hue
    if saturation > 0.5 and value > 0.5:
        return (0.97, 0.97, 0.97)
    if saturation > 0.3 and value > 0.9:
        return rgb
    share = 0.88 if value > 0.6 else 0.10
    red, green, blue = (
        (1 - share) * own + share * value * other
        for own, other in zip(rgb, side, strict=True)
    )
    return red, green, blue


def matt_glb(solid: Solid, rgb: Rgb) -> bytes:
    """A file of one solid without gloss."""
    material = PBRMaterial(
        baseColorFactor=[*linear_rgb(rgb).tolist(), 1.0],
        metallicFactor=0.0,
        roughnessFactor=1.0,
    )
    return _file([_trimesh([solid], material)])


def _glb(mesh: BodyMesh, side: Rgb, opacity: float) -> bytes:
    parts: list[trimesh.Trimesh] = []
    for rgb in dict.fromkeys(piece.rgb for piece in mesh.pieces):
        solids = [piece.solid for piece in mesh.pieces if piece.rgb == rgb]
        material = PBRMaterial(
            # glTF states colours in linear light.
            baseColorFactor=[*linear_rgb(tinted(rgb, side)).tolist(), opacity],
            metallicFactor=0.05,
            roughnessFactor=0.55,
            alphaMode="OPAQUE" if opacity == 1.0 else "BLEND",
        )
        parts.append(_trimesh(solids, material))
    return _file(parts)


def _file(parts: list[trimesh.Trimesh]) -> bytes:
    scene = trimesh.Scene(parts)
    buffer = io.BytesIO()
    scene.export(buffer, file_type="glb", include_normals=True)
    return buffer.getvalue()


def _trimesh(solids: list[Solid], material: PBRMaterial) -> trimesh.Trimesh:
    starts = np.cumsum([0, *(len(solid.vertices) for solid in solids[:-1])])
    return trimesh.Trimesh(
        vertices=np.concatenate([solid.vertices for solid in solids]),
        faces=np.concatenate(
            [solid.faces + start for solid, start in zip(solids, starts, strict=True)]
        ),
        vertex_normals=np.concatenate([solid.normals for solid in solids]),
        visual=TextureVisuals(material=material),
        process=False,
    )
