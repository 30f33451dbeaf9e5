"""A robot as the simulators that train legged robots have it, to compare with.

Isaac's know neither feet that resist rolling nor dry friction of joints unless they are
told; models of MuJoCo have both, and a policy that was trained without walks slower.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco

from policy.robots.robot import Robot, load_robot_xml

_SLIDING = 3
"""Directions of a contact with friction along the ground alone: MuJoCo's condim."""
_USUAL_SOLIMP = [0.9, 0.95, 0.001, 0.5, 2.0]


def plainer(robot: Robot) -> Iterator[tuple[str, Robot]]:
    """`robot` without what its model has and those have not, one thing at a time."""
    spec = mujoco.MjSpec.from_string(robot.mjcf)
    rolling = [geom for geom in spec.geoms if geom.condim > _SLIDING]
    for geom in rolling:
        geom.condim, geom.solimp = _SLIDING, _USUAL_SOLIMP
    if rolling:
        told = 'the usual contact of feet (condim="3", no solimp in the MJCF)'
        yield told, _compiled(spec, robot)
    spec = mujoco.MjSpec.from_string(robot.mjcf)
    most = float(robot.mj_model.dof_frictionloss[robot.qvel_adr].max())
    for joint in spec.joints:
        joint.frictionloss = 0.0
    if most:
        told = f"joints without dry friction (joint_friction_nm = 0, not {most:g})"
        yield told, _compiled(spec, robot)


def _compiled(spec: mujoco.MjSpec, robot: Robot) -> Robot:
    dt_s = float(robot.mj_model.opt.timestep)
    return load_robot_xml(spec.to_xml(), name=robot.name, physics_dt_s=dt_s)
