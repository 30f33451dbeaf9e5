"""A position servo on each of the twelve joints, whatever actuators a model has.

Torque motors get the law `torque = kp * (target - angle) - kd * velocity` within their
limits, computed by MuJoCo in every physics step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from .anatomy import Skeleton, actuators_of, is_position_servo
from .hints import Hints, RobotError
from .legs import Legs
from .speed_limits import set_speed_limit

STIFFNESS_PER_WEIGHT = 1.5
"""Weight times length of the standing leg that a servo makes of one radian: the legs
then give way by about a tenth of a radian when the robot stands."""

DAMPING_S = 0.02
"""Seconds: derivative gain over stiffness, the joint's own damping included."""

STANDING_SHARE = 0.65
"""Height of the hips above the feet, as a share of the stretched leg."""


@dataclass(frozen=True)
class _Gains:
    kp: float
    kd: float
    torque_limit: float
    """Infinite where nothing limits it."""


def set_joints(spec: mujoco.MjSpec, skeleton: Skeleton) -> str | None:
    """Give the joints of the legs the damping and friction that was said; tells which.

    Where all the damping is said, as kd of the servos, and not that of the joints, the
    joints have none.
    """
    hints = skeleton.hints
    said = dict(hints.joints or {})
    if hints.servo and "kd" in hints.servo:
        kd, damping = hints.servo["kd"], said.setdefault("damping", [0.0] * 3)
        if any(part > whole for part, whole in zip(damping, kd, strict=True)):
            raise RobotError(
                f"{skeleton.source}: [joints] damping = {damping} is more than [servo] "
                f"kd = {kd}, which is all the damping of a joint"
            )
    if not said:
        return None
    joints = {joint.id: joint for joint in spec.joints}
    for index, number in enumerate(skeleton.joints):
        joint, place = joints[number], index % 3
        joint.name = joint.name or _name_of(number)
        if "damping" in said:
            joint.damping = [said["damping"][place], 0.0, 0.0]
        if "friction" in said:
            joint.frictionloss = said["friction"][place]
        if "speed_limit" in said:
            set_speed_limit(spec, joint.name, said["speed_limit"][place])
    parts = [f"{name} {values}" for name, values in said.items()]
    return f"joints were given {' and '.join(parts)} (hip, thigh, calf)"


def ensure_servos(spec: mujoco.MjSpec, skeleton: Skeleton) -> str | None:
    """Make the actuators of the legs position servos; tells what was changed.

    `skeleton` is of what `spec` compiles to.
    """
    mj_model, joints, hints = skeleton.mj_model, skeleton.joints, skeleton.hints
    spec_joints = {joint.id: joint for joint in spec.joints}
    actuators = {actuator.id: actuator for actuator in spec.actuators}
    weight_n = 9.81 * float(mj_model.body_subtreemass[0])
    reach_m = float(Legs(skeleton).reach_m.mean())
    kp_found = STIFFNESS_PER_WEIGHT * weight_n * STANDING_SHARE * reach_m
    changes: list[tuple[str, _Gains]] = []
    for index, joint in enumerate(joints):
        mine = actuators_of(mj_model, joint)
        fits = len(mine) == 1 and is_position_servo(mj_model, mine[0])
        if fits and not hints.servo:
            continue
        gains = _hinted(_gains(mj_model, joint, mine, kp_found), hints, index % 3)
        gains = _without_bearings(gains, hints, index % 3)
        spec_joint = spec_joints[joint]
        spec_joint.name = spec_joint.name or _name_of(joint)
        for extra in mine[1:]:
            spec.delete(actuators[extra])
        if mine:
            servo = actuators[mine[0]]
            before = "servo" if fits else "actuator"
        else:
            servo, before = spec.add_actuator(name=spec_joint.name), "nothing"
        _make_servo(servo, spec_joint.name, gains)
        if hints.servo and "kd" in hints.servo:
            servo.damping = np.zeros_like(servo.damping)
        changes.append((before, gains))
    if len(mj_model.key_ctrl) and changes:
        # Their controls were meant for other actuators; the environment sets its own.
        for key in spec.keys:
            key.ctrl, key.act = [], []
    if changes and spec.option.integrator == mujoco.mjtIntegrator.mjINT_EULER:
        # Euler's method leaves the damping of servos explicit: stiff ones blow up.
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return _told(changes) if changes else None


def _gains(
    mj_model: mujoco.MjModel, joint: int, mine: list[int], kp_found: float
) -> _Gains:
    """What the actuators `mine` of `joint` say of a servo, completed by rule."""
    damping = float(mj_model.dof_damping[mj_model.jnt_dofadr[joint]])
    kp, limit, kd = kp_found, np.inf, None
    for actuator in mine[:1]:
        gear = abs(float(mj_model.actuator_gear[actuator, 0]))
        bias = mj_model.actuator_biasprm[actuator]
        affine = mj_model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
        if affine and bias[1] < 0:
            kp, kd = -float(bias[1]) * gear**2, -float(bias[2]) * gear**2
        if mj_model.actuator_forcelimited[actuator]:
            limit = np.abs(mj_model.actuator_forcerange[actuator]).max() * gear
        if not affine and mj_model.actuator_ctrllimited[actuator]:
            gain = abs(float(mj_model.actuator_gainprm[actuator, 0]))
            most = np.abs(mj_model.actuator_ctrlrange[actuator]).max()
            limit = min(limit, most * gain * gear)
    if kd is None:
        kd = max(DAMPING_S * kp - damping, 0.0)
    return _Gains(kp, kd, float(limit))


def _hinted(gains: _Gains, hints: Hints, place: int) -> _Gains:
    given = {name: values[place] for name, values in (hints.servo or {}).items()}
    return _Gains(
        given.get("kp", gains.kp),
        given.get("kd", gains.kd),
        given.get("torque_limit", gains.torque_limit),
    )


def _name_of(joint: int) -> str:
    """What a joint is called that had no name."""
    return f"gaitpref_joint_{joint}"


def _without_bearings(gains: _Gains, hints: Hints, place: int) -> _Gains:
    """The servo's part of the damping, where all of it was said."""
    if not (hints.servo and "kd" in hints.servo and hints.joints):
        return gains
    damping = hints.joints.get("damping", [0.0] * 3)[place]
    return replace(gains, kd=gains.kd - damping)


def _make_servo(servo: mujoco.MjsActuator, joint: str, gains: _Gains) -> None:
    servo.trntype, servo.target = mujoco.mjtTrn.mjTRN_JOINT, joint
    servo.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    servo.dyntype = mujoco.mjtDyn.mjDYN_NONE
    servo.dynprm = [1.0, *[0.0] * (len(servo.dynprm) - 1)]
    servo.gainprm = [gains.kp, *[0.0] * (len(servo.gainprm) - 1)]
    bias = [0.0, -gains.kp, -gains.kd]
    servo.biasprm = [*bias, *[0.0] * (len(servo.biasprm) - len(bias))]
    servo.gear = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    servo.actlimited = servo.ctrllimited = int(mujoco.mjtLimited.mjLIMITED_FALSE)
    servo.ctrlrange, servo.inheritrange = [0.0, 0.0], 0.0
    limited = np.isfinite(gains.torque_limit)
    servo.forcelimited = int(
        mujoco.mjtLimited.mjLIMITED_TRUE
        if limited
        else mujoco.mjtLimited.mjLIMITED_FALSE
    )
    if limited:
        servo.forcerange = [-gains.torque_limit, gains.torque_limit]


def _told(changes: list[tuple[str, _Gains]]) -> str:
    had = sorted({before for before, _ in changes})
    kp, kd = ([getattr(g, name) for _, g in changes] for name in ("kp", "kd"))
    return (
        f"{len(changes)} joints with {' or '.join(had)} got position servos: kp "
        f"{min(kp):.4g} to {max(kp):.4g} N m/rad, kd {min(kd):.3g} to {max(kd):.3g} "
        "N m s/rad beside the joints' own damping"
    )
