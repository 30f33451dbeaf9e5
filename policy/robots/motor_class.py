"""What motors of quadrupeds do, and where those of a model are far from it."""

from __future__ import annotations

import numpy as np

from .robot import Robot
from .servos import DAMPING_S

STIFF = (0.7, 3.5)
"""N m/rad per kg of a robot, the stiffest of its servos: those that walk outside run 1
to 3. A Go2 of 15 kg runs 20 to 40, an ANYmal of 50 kg runs 80."""
LEAST_DAMPING_S = 0.01
"""kd over kp, below which a joint hardly is damped."""
STRONG = (0.15, 2.5)
"""Torque limit of the strongest joint, as a share of weight times height of the base at
home: 1.1 for a Go2 and 0.3 for an ANYmal."""
GRAVITY_M_S2 = 9.81
SOFT = 1.5
"""Weight times height of the base at home, over the stiffness of the stiffest servo,
from which on a robot learned to stand and not to walk: ANYmal C as Menagerie draws it
has 2.2, and walks with 0.9; seven others that walk have 0.3 to 1.1."""
_FIRM = 1.15
"""Stiffness that is advised, in weights times heights a radian."""


def unusual_motors(robot: Robot) -> list[str]:
    """What no motor driver should be given unseen, in words; empty where all is usual.

    Its thresholds are wide: what is told is wrong by far, or not of this world.
    """
    mass_kg = float(robot.mj_model.body_subtreemass[robot.base_body_id])
    return [
        told
        for told in (
            _stiffness(robot, mass_kg),
            _damping(robot),
            _strength(robot, mass_kg),
        )
        if told
    ]


def soft_servos(robot: Robot) -> str | None:
    """What to do where the servos are too soft to learn a walk with; None where they
    are not."""
    mass_kg = float(robot.mj_model.body_subtreemass[robot.base_body_id])
    bears_n_m = mass_kg * GRAVITY_M_S2 * float(robot.home_qpos[2])
    stiffest = float(robot.kp.max())
    if bears_n_m / stiffest <= SOFT:
        return None
    kp = float(f"{_FIRM * bears_n_m:.2g}")
    return (
        f"the servos are soft for this weight: kp is up to {stiffest:.3g} N m/rad, "
        f"where {mass_kg:.3g} kg on legs of {robot.home_qpos[2]:.2g} m make "
        f"{bears_n_m:.3g} N m; a robot with such servos learned to stand. Try [servo] "
        f"kp = {kp:g}, kd = {DAMPING_S * kp:g} in the TOML beside its model"
    )


def _stiffness(robot: Robot, mass_kg: float) -> str | None:
    stiffest = float(robot.kp.max())
    low, high = STIFF
    if low <= stiffest / mass_kg <= high:
        return None
    return (
        f"kp is up to {stiffest:.3g} N m/rad for {mass_kg:.3g} kg, "
        f"{stiffest / mass_kg:.2g} N m/rad per kg, where quadrupeds run 1 to 3: train "
        "with the gains of the robot, [servo] of the TOML beside its model"
    )


def _damping(robot: Robot) -> str | None:
    if float((robot.kd / robot.kp).min()) >= LEAST_DAMPING_S:
        return None
    return (
        f"kd is {robot.kd.min():.3g} N m s/rad, less than {LEAST_DAMPING_S:g} s times "
        "kp: the joints would swing"
    )


def _strength(robot: Robot, mass_kg: float) -> str | None:
    limits = robot.torque_limit
    if not np.isfinite(limits).all():
        return (
            "a joint has no limit of torque, which every motor has: say torque_limit "
            "in [servo] of the TOML beside the model"
        )
    strongest = float(limits.max())
    share = strongest / (mass_kg * GRAVITY_M_S2 * float(robot.home_qpos[2]))
    low, high = STRONG
    if low <= share <= high:
        return None
    return (
        f"torques of up to {strongest:.3g} N m for {mass_kg:.3g} kg on legs of "
        f"{robot.home_qpos[2]:.2g} m are {share:.2g} times its weight on their length, "
        "where motors of quadrupeds give 0.2 to 1.5: compare with the data sheet, and "
        "say torque_limit in [servo] of the TOML beside the model"
    )
