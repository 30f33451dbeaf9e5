"""What the environment needs and a model may lack: foot sites and sensors.

Sensors, in this order: `gaitpref_contact_LEG` (1) for the four legs,
`gaitpref_vel_LEG` (3, m/s, world frame) for the four legs, `gaitpref_contact_base` (1).
Contact sensors count contacts with the ground; they do not measure force.
"""

from __future__ import annotations

import mujoco
import numpy as np

from data.features import LEGS

from .anatomy import Anatomy, bodies_below
from .foot import collides

PREFIX = "gaitpref_"
"""What the name of everything added to a model starts with."""

SENSORS = (
    *(f"{PREFIX}contact_{leg}" for leg in LEGS),
    *(f"{PREFIX}vel_{leg}" for leg in LEGS),
    f"{PREFIX}contact_base",
)
"""Names of the sensors that are added, in their order."""


def is_complete(spec: mujoco.MjSpec) -> bool:
    """Whether nothing is to be added, because all was added before."""
    return tuple(s.name for s in spec.sensors if s.name.startswith(PREFIX)) == SENSORS


def add_sites_and_sensors(
    spec: mujoco.MjSpec, mj_model: mujoco.MjModel, found: Anatomy
) -> None:
    """Complete `spec`, of which `mj_model` was compiled and `found` is the anatomy."""
    # Adding to or deleting from a spec takes the ids of its elements away.
    bodies = {body.id: body for body in spec.bodies}
    geoms = {geom.id: geom for geom in spec.geoms}
    base, ground = bodies[found.base], _ground_body(mj_model, found.base)
    base.name = base.name or f"{PREFIX}base"
    for sensor in list(spec.sensors):
        if sensor.name.startswith(PREFIX):
            spec.delete(sensor)
    for leg, foot in zip(LEGS, found.feet, strict=True):
        geom = geoms[foot.geom]
        geom.name = geom.name or f"{PREFIX}{leg}_foot"
        _add_contact_sensor(spec, leg, mujoco.mjtObj.mjOBJ_GEOM, geom.name, ground)
    for leg, site in zip(LEGS, _add_sites(bodies, mj_model, found), strict=True):
        spec.add_sensor(
            name=f"{PREFIX}vel_{leg}",
            type=mujoco.mjtSensor.mjSENS_FRAMELINVEL,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=site,
        )
    _add_contact_sensor(spec, "base", mujoco.mjtObj.mjOBJ_BODY, base.name, ground)


def _add_sites(
    bodies: dict[int, mujoco.MjsBody], mj_model: mujoco.MjModel, found: Anatomy
) -> list[str]:
    """The names of the four foot sites, of which the missing are made."""
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:] = found.home_qpos
    mujoco.mj_kinematics(mj_model, mj_data)
    names: list[str] = []
    for leg, foot in zip(LEGS, found.feet, strict=True):
        if foot.site is not None:
            names.append(mj_model.site(foot.site).name)
            continue
        rotation_w = mj_data.xmat[foot.body].reshape(3, 3)
        bodies[foot.body].add_site(
            name=f"{PREFIX}{leg}_foot",
            pos=(foot.point_w - mj_data.xpos[foot.body]) @ rotation_w,
            size=[0.01, 0.01, 0.01],
            group=4,
        )
        names.append(f"{PREFIX}{leg}_foot")
    return names


def _ground_body(mj_model: mujoco.MjModel, base: int) -> str | None:
    """The one body all the ground belongs to; None if the ground has many bodies."""
    robot = bodies_below(mj_model, base)
    ground = {
        int(mj_model.geom_bodyid[geom])
        for geom in range(mj_model.ngeom)
        if mj_model.geom_bodyid[geom] not in robot and collides(mj_model, geom)
    }
    return mj_model.body(ground.pop()).name or None if len(ground) == 1 else None


def _add_contact_sensor(
    spec: mujoco.MjSpec,
    name: str,
    objtype: mujoco.mjtObj,
    objname: str,
    ground: str | None,
) -> None:
    """Count the contacts of a geom or body with `ground`, or with anything if None."""
    sensor = spec.add_sensor(
        name=f"{PREFIX}contact_{name}",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=objtype,
        objname=objname,
    )
    # Bit mask of the data to report, way of reducing (none), number of slots.
    sensor.intprm[:3] = np.array(
        [1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND), 0, 1]
    )
    if ground is not None:
        sensor.reftype, sensor.refname = mujoco.mjtObj.mjOBJ_BODY, ground
