"""What a URDF lacks where its robot hangs fixed in the air."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import mujoco

from .hints import RobotError


def require_floating_base(spec: mujoco.MjSpec, path: Path) -> None:
    """Refuse a URDF whose base is fixed to the world, with the elements that free it.

    Raises:
        RobotError: it is one.
    """
    if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
        return
    try:
        robot = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError):
        return
    if robot.tag != "robot":
        return
    joints = {joint: _link(joint, "child") for joint in robot.iter("joint")}
    roots = [
        name
        for name in (link.get("name", "") for link in robot.iter("link"))
        if name not in joints.values()
    ]
    if len(roots) != 1:
        return
    base = roots[0]
    of_world = [joint for joint in joints if _link(joint, "parent") == base == "world"]
    if of_world:
        name, kind = of_world[0].get("name"), of_world[0].get("type")
        raise RobotError(
            f"{path}: its joint {name!r} holds {joints[of_world[0]]!r} to the world; "
            f'write type="floating" in place of type="{kind}" into it'
        )
    raise RobotError(
        f"{path}: a URDF fixes its base, here {base!r}, to the world unless it says "
        'otherwise; add these two elements to <robot>: <link name="world"/> and '
        '<joint name="float" type="floating"><parent link="world"/>'
        f'<child link="{base}"/></joint>'
    )


def _link(joint: ElementTree.Element, end: str) -> str | None:
    found = joint.find(end)
    return None if found is None else found.get("link")
