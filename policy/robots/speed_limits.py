"""How fast joints turn at most, as custom numbers of a model.

MJCF has no place for it, and MuJoCo holds no joint to it: it is for motor drivers.
"""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

_PREFIX = "gaitpref_speed_limit_"
"""With the name of a joint behind it, the name of its number."""


def set_speed_limit(spec: mujoco.MjSpec, joint: str, speed_rad_s: float) -> None:
    """Say that the joint of this name turns at `speed_rad_s` at most."""
    for known in list(spec.numerics):
        if known.name == _PREFIX + joint:
            spec.delete(known)
    spec.add_numeric(name=_PREFIX + joint, data=[speed_rad_s], size=1)


def speed_limits(mj_model: mujoco.MjModel, joints: Iterable[int]) -> np.ndarray:
    """rad/s of each of the `joints`; infinite where nobody said."""
    found = []
    for joint in joints:
        name = _PREFIX + mj_model.joint(joint).name
        number = mujoco.mj_name2id(mj_model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
        found.append(np.inf if number < 0 else float(mj_model.numeric(number).data[0]))
    return np.array(found)
