"""One world with two robots: the second hangs in the model of the first.

The ground, its contacts and all settings are those of the first robot's model; of the
second only the robot itself is added, every name with a prefix. So the state of the
world is that of the first robot, and behind it that of the second.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

import mujoco

from policy.robots.inline import flatten
from policy.robots.robot import Robot, RobotError

MATE = "mate_"
"""What every name of the second robot begins with."""
_BUMP = 1 << 29
"""The bit by which both robots collide; models hardly use any but the first few."""
_QPOS, _QVEL = 7 + 12, 6 + 12
_HOME = "home"
"""The key of both robots' home poses."""


def pair_of(robot: Robot) -> tuple[Robot, Robot]:
    """Both robots in one world; they share model and text.

    Raises:
        RobotError: it has joints beside its legs, or stands on no even ground.
    """
    mj_model = robot.mj_model
    if (mj_model.nq, mj_model.nv, mj_model.nu) != (_QPOS, _QVEL, 12):
        raise RobotError(
            f"{robot.name} has {mj_model.nq} positions and {mj_model.nu} motors, a "
            f"robot of a team has {_QPOS} and 12: a free base and twelve joints; take "
            "arms and loose bodies away"
        )
    if robot.ground is not None:
        raise RobotError("a team walks on flat ground: leave the terrain out")
    world = mujoco.MjSpec.from_string(robot.mjcf)
    other = mujoco.MjSpec.from_string(robot.mjcf)
    for spec in (world, other):
        # A pose of one robot is none of a world of two.
        for key in list(spec.keys):
            spec.delete(key)
    base = mj_model.body(robot.base_body_id).name
    _let_bump(world, contype=_BUMP)
    _let_bump(other, conaffinity=_BUMP)
    world.worldbody.add_frame().attach_body(other.body(base), MATE, "")
    world.add_key(name=_HOME, qpos=[*robot.home_qpos, *robot.home_qpos])
    try:
        mjcf = flatten(world)
        both = mujoco.MjModel.from_xml_string(mjcf)
    except ValueError as error:
        told = " ".join(str(error).split())
        raise RobotError(f"{robot.name} cannot be there twice ({told})") from None
    if (both.nq, both.nv, both.nu) != (2 * _QPOS, 2 * _QVEL, 24):
        raise RobotError(
            f"two of {robot.name} have {both.nq} positions and {both.nu} motors "
            f"together, not {2 * _QPOS} and 24: its motors drive more than its legs"
        )
    first = replace(
        robot,
        mj_model=both,
        mjcf=mjcf,
        model_sha256=hashlib.sha256(mjcf.encode()).hexdigest(),
        changes=(),
    )
    return first, _second(first)


def _let_bump(spec: mujoco.MjSpec, *, contype: int = 0, conaffinity: int = 0) -> None:
    """Let what collides of the robot in `spec` also collide by these bits.

    Robots mostly have no bit in common with themselves, and so none with each other. A
    bit that the first one asks by and the second answers to leaves each with itself as
    it was.
    """
    for base in spec.worldbody.bodies:
        for geom in base.find_all(mujoco.mjtObj.mjOBJ_GEOM):
            if geom.contype or geom.conaffinity:
                geom.contype |= contype
                geom.conaffinity |= conaffinity


def first_alone(mjcf: str) -> str:
    """The model of the first robot alone, out of a world of two.

    Raises:
        RobotError: it is no world of two.
    """
    try:
        world = mujoco.MjSpec.from_string(mjcf)
        bases = [b for b in world.worldbody.bodies if b.name.startswith(MATE)]
        homes = [list(key.qpos)[:_QPOS] for key in world.keys if key.name == _HOME]
        for gone in (*bases, *world.keys):
            world.delete(gone)
        for home in homes:
            world.add_key(name=_HOME, qpos=home)
        text = flatten(world)
    except ValueError as error:
        told = " ".join(str(error).split())
        raise RobotError(f"the world of a team does not compile ({told})") from None
    if not bases:
        raise RobotError("the world of a team has one robot: record it again")
    return text


def _second(first: Robot) -> Robot:
    """The second robot of the world of the first."""
    both = first.mj_model

    def mates(kind: mujoco.mjtObj, number: int) -> int:
        name = mujoco.mj_id2name(both, kind, number)
        return mujoco.mj_name2id(both, kind, f"{MATE}{name}")

    sites = [mates(mujoco.mjtObj.mjOBJ_SITE, int(site)) for site in first.foot_site_ids]
    base = mates(mujoco.mjtObj.mjOBJ_BODY, first.base_body_id)
    motors = first.actuator_ids + 12
    return replace(
        first,
        base_body_id=base,
        qpos_adr=first.qpos_adr + _QPOS,
        qvel_adr=first.qvel_adr + _QVEL,
        actuator_ids=motors,
        foot_site_ids=first.foot_site_ids * 0 + sites,
    )
