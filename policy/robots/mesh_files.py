"""Where the meshes of a published model are: not always where it says.

A model names them as its author's machine had them (`package://`, another folder), and
often travels without those that only are looked at.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import mujoco

from .hints import RobotError

_FOLDERS = ("", "meshes", "assets")
_PARENTS = 3
"""Folders above the model that are looked into: a package has its models in one of its
folders and its meshes in another."""
_READABLE = (".stl", ".obj", ".msh")
"""Endings of mesh files that MuJoCo reads."""


def find_mesh(name: str, folder: Path) -> Path | None:
    """The file that a model in `folder` means by `name`; None where it is not there.

    Looked for where it says, and beside: from the folder and those above it, along ever
    shorter ends of the path, which may begin with the name of a package, and with
    another ending where MuJoCo cannot read that of the name.
    """
    said = PurePosixPath(name.partition("://")[2] or name)
    endings = [said.suffix.lower()] if said.suffix.lower() in _READABLE else _READABLE
    if "://" not in name:
        exact = folder / said
        if exact.is_file() and said.suffix.lower() in _READABLE:
            return exact.resolve()
    parts = [part for part in said.parts if part not in ("/", "..", ".")]
    for base in (folder, *folder.parents[:_PARENTS]):
        for inner in _FOLDERS:
            for first in range(len(parts)):
                for ending in endings:
                    tail = Path(*parts[first:])
                    found = base / inner / tail
                    if ending != said.suffix.lower():
                        found = found.with_suffix(ending)
                    if found.is_file():
                        return found.resolve()
    return None


def missing(path: Path, names: list[str], role: str) -> RobotError:
    """That mesh files are absent, and what to do; `role` is what they are for."""
    shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if names[3:] else "")
    cure = (
        "put them there"
        if role != "looks"
        else "put them there, or go on without what only is looked at: `gaitpref robot "
        f"inspect {path} --without-visuals --out DIR` writes DIR/NAME.xml, which other "
        "commands take as --robot"
    )
    return RobotError(
        f"{path}: its meshes {shown} are in no folder beside it (as named, or in "
        f"meshes/ or assets/, up to {_PARENTS} folders above); {cure}"
    )


def mend_meshes(
    spec: mujoco.MjSpec, path: Path, *, without_visuals: bool
) -> str | None:
    """Let the meshes of an MJCF be found, or leave out what only is looked at.

    Args:
        spec: Changed in place.
        path: The file it was read from.
        without_visuals: Leave out all meshes that only are looked at.

    Returns:
        What was changed, in words.

    Raises:
        RobotError: a mesh is absent; it says whether it only is looked at.
    """
    told = _drop_visuals(spec) if without_visuals else None
    if _compiles(spec):
        return told
    seen = {geom.meshname for geom in spec.geoms if _only_seen(geom)}
    absent: dict[str, list[str]] = {"looks": [], "contact": []}
    moved = 0
    for mesh in spec.meshes:
        if not mesh.file or (path.parent / spec.meshdir / mesh.file).is_file():
            continue
        found = find_mesh(mesh.file, path.parent)
        if found is None:
            role = "looks" if mesh.name in seen else "contact"
            absent[role].append(mesh.file)
        else:
            mesh.file = str(found)
            moved += 1
    for role in ("contact", "looks"):
        if absent[role]:
            raise missing(path, absent[role], role)
    found = f"{moved} meshes were found in other folders than named" if moved else None
    return "; ".join(filter(None, (told, found))) or None


def _compiles(spec: mujoco.MjSpec) -> bool:
    try:
        spec.compile()
    except ValueError:
        return False
    return True


def _drop_visuals(spec: mujoco.MjSpec) -> str | None:
    """Take away meshes that only are looked at, their geoms and pictures."""
    for geom in [geom for geom in spec.geoms if _only_seen(geom)]:
        spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    gone = [mesh for mesh in spec.meshes if mesh.name not in used]
    for mesh in gone:
        spec.delete(mesh)
    return f"{len(gone)} meshes that only are looked at were left out" if gone else None


def _only_seen(geom: mujoco.MjsGeom) -> bool:
    """Whether a geom is a mesh that touches and weighs nothing."""
    weighs = geom.parent.name != "world" and not geom.parent.explicitinertial
    massless = geom.mass == 0 or (geom.mass != geom.mass and geom.density == 0)
    return bool(
        geom.type == mujoco.mjtGeom.mjGEOM_MESH
        and geom.contype == 0
        and geom.conaffinity == 0
        and (massless or not weighs)
    )
