"""URDFs as they are published: a base fixed in the air, meshes of another machine."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import mujoco

from data.files.files import read_file
from data.files.limits import ROBOT_BYTES

from .hints import RobotError
from .mesh_files import find_mesh, missing
from .speed_limits import set_speed_limit

_FASTEST_RAD_S = 200.0
_XACRO = "http://www.ros.org/wiki/xacro"


def urdf_in(path: Path) -> ElementTree.Element | None:
    """The root element of a URDF; None where `path` is something else.

    Raises:
        RobotError: it is a xacro, which a URDF is made of.
    """
    content = read_file(path, ROBOT_BYTES)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError):
        return None
    if root.tag != "robot":
        return None
    if any(_XACRO in str(element.tag) for element in root.iter()):
        raise RobotError(
            f"{path}: it is a xacro, which a URDF is made of: `xacro {path.name} > "
            "robot.urdf`"
        )
    return root


def read_urdf(
    root: ElementTree.Element, path: Path, *, without_visuals: bool
) -> tuple[mujoco.MjSpec, list[str]]:
    """The robot in a URDF with a base that floats and meshes that are there.

    Args:
        root: Its root element, which is changed.
        path: Where it was read from.
        without_visuals: Leave out all meshes that only are looked at.

    Returns:
        The model, and what was changed, in words.

    Raises:
        RobotError: a mesh that touches the ground is absent.
        ValueError: MuJoCo cannot read it.
    """
    told = [_float(root), *_mend(root, path, without_visuals=without_visuals)]
    text = ElementTree.tostring(root, encoding="unicode")
    spec = mujoco.MjSpec.from_string(text)
    for name, speed in _speed_limits(root).items():
        set_speed_limit(spec, name, speed)
    return spec, [change for change in told if change]


def _speed_limits(root: ElementTree.Element) -> dict[str, float]:
    """rad/s that the joints of a URDF turn at most, by their names."""
    found: dict[str, float] = {}
    for joint in root.iter("joint"):
        limit = joint.find("limit")
        try:
            speed = float("nan" if limit is None else limit.get("velocity", "nan"))
        except ValueError:
            continue
        # Where nobody knew, files have 0 or a number beyond any motor.
        if 0 < speed < _FASTEST_RAD_S:
            found[joint.get("name", "")] = speed
    return found


def _float(root: ElementTree.Element) -> str | None:
    """Let the base of a robot that hangs fixed in the air move freely."""
    joints = {joint: _link(joint, "child") for joint in root.iter("joint")}
    if any(joint.get("type") == "floating" for joint in joints):
        return None
    names = [link.get("name", "") for link in root.iter("link")]
    roots = [name for name in names if name not in joints.values()]
    if len(roots) != 1:
        return None
    base = roots[0]
    of_world = [joint for joint in joints if _link(joint, "parent") == base == "world"]
    if of_world:
        held, kind = of_world[0], of_world[0].get("type")
        held.set("type", "floating")
        return (
            f"the {kind} joint {held.get('name')!r}, which held {joints[held]!r} to "
            "the world, floats"
        )
    ElementTree.SubElement(root, "link", name="world")
    joint = ElementTree.SubElement(root, "joint", name="gaitpref_float")
    joint.set("type", "floating")
    ElementTree.SubElement(joint, "parent", link="world")
    ElementTree.SubElement(joint, "child", link=base)
    return f"a floating joint was added above the base {base!r}, which a URDF fixes"


def _mend(
    root: ElementTree.Element, path: Path, *, without_visuals: bool
) -> list[str | None]:
    """Name the mesh files that are there; leave out those that only are looked at and
    are not. What MuJoCo would not draw unless it is told so, is drawn."""
    for material in root.iter("material"):
        # Pictures stay behind, and MuJoCo would look for their files.
        for picture in material.findall("texture"):
            material.remove(picture)
    extension = root.find("mujoco")
    if extension is None:
        extension = ElementTree.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    folder = path.parent / compiler.attrib.pop("meshdir", "")
    compiler.set("strippath", "false")
    if without_visuals:
        compiler.set("discardvisual", "true")
    compiler.attrib.setdefault("discardvisual", "false")
    unseen: list[str] = []
    untouched: list[str] = []
    for link in root.iter("link"):
        for element in [*link.findall("visual"), *link.findall("collision")]:
            mesh = element.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            found = find_mesh(name, folder)
            if found is not None:
                mesh.set("filename", str(found))
            elif element.tag == "visual":
                link.remove(element)
                unseen.append(name)
            else:
                untouched.append(name)
    if untouched:
        raise missing(path, untouched, "contact")
    if without_visuals:
        return ["meshes that only are looked at were left out"]
    if not unseen:
        return []
    shown = ", ".join(unseen[:3]) + (", ..." if unseen[3:] else "")
    return [
        f"{len(unseen)} meshes that only are looked at are not beside the model and "
        f"were left out: {shown}"
    ]


def _link(joint: ElementTree.Element, end: str) -> str | None:
    found = joint.find(end)
    return None if found is None else found.get("link")
