"""States of MuJoCo's form, from a program of your own, as an episode.

Shapes: N states.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from data.episodes.episode import Episode
from data.episodes.resample import local_attitude, local_fit
from data.features import column
from data.files.files import sha256_bytes
from policy.robots.robot import Robot, load_robot

from .as_episode import as_episode
from .feature_rows import rows_of
from .log_map import SHIPPED_ROBOT, LogError
from .recording import LARGEST, MIN_SAMPLES, UNIT_TOLERANCE, possible
from .track import one_command

_WINDOW_STEPS = 2.5
"""Half the window that velocities are taken over."""


def steps_from_qpos(
    robot: Robot | Path | str,
    qpos: np.ndarray,
    qvel: np.ndarray | None,
    dt_s: float,
    *,
    command: np.ndarray | tuple[float, float, float] | None = None,
    contact: np.ndarray | None = None,
    torque: np.ndarray | None = None,
    action: np.ndarray | None = None,
    fell: bool = False,
    task: str = "hardware",
    contact_height_m: float = 0.002,
) -> Episode:
    """States at even times as an episode: `dataset.add_episodes([it])` keeps it.

    Nothing is smoothed or resampled. What nobody says is worked out where it can be
    (velocities, contacts) and missing where it cannot; the ground is flat, at height 0.

    Args:
        robot: Path of its MJCF, `"go1"` for the Go1 that ships, or a `Robot`.
        qpos: [N, 19] as MuJoCo has it: position m, attitude wxyz, joints rad in the
            order of the model.
        qvel: [N, 18] as MuJoCo has it: velocity in the world, turning rates of the
            body, joints; None works it out of `qpos`.
        dt_s: Time between two states.
        command: Forward m/s, left m/s, yaw rad/s asked for: one, or [N, 3].
        contact: [N, 4] feet that touch, FR, FL, RR, RL.
        torque: [N, 12] N m, FR, FL, RR, RL, each hip, thigh, calf.
        action: [N, 12] what the policy gave before each state came, same order; the
            first row is not used.
        fell: The last state is a fall, which ends the episode.
        task: Name of the task, for the overview of a data set.
        contact_height_m: Without `contact`, a lower foot touches.

    Raises:
        LogError: an array has another shape, or holds a number that cannot be.
        RobotError, FileError: the robot cannot be used.
    """
    if not (math.isfinite(dt_s) and dt_s > 0):
        raise LogError(f"dt_s must be positive, got {dt_s}")
    if not isinstance(robot, Robot):
        xml = None if robot == SHIPPED_ROBOT else Path(robot)
        robot = load_robot(xml, physics_dt_s=dt_s)
    if robot.mj_model.nq != 19:
        raise LogError(f"{robot.name} has more to it than a base and twelve joints")
    count = len(qpos)
    if count < MIN_SAMPLES:
        raise LogError(f"qpos has {count} states, it needs {MIN_SAMPLES} or more")
    states = _checked("qpos", qpos, count, 19).copy()
    states[:, 3:7] = _unit(states[:, 3:7])
    if qvel is None:
        rates = _rates(states, robot, dt_s)
    else:
        rates = _checked("qvel", qvel, count, 18)
    asked, acted = _asked(command, count), _optional("action", action, count, 12)
    feet = _optional("contact", contact, count, 4)
    rows = rows_of(
        robot,
        states,
        rates,
        dt_s=dt_s,
        contact=None if feet is None else feet > 0.5,
        contact_height_m=contact_height_m,
        torque=_optional("torque", torque, count, 12),
        action=acted,
        command=asked,
    )
    rows[-1, column("fallen")] = fell
    velocities = ("joint_vel", "base_lin_vel_b", "base_ang_vel_b")
    derived = velocities * (qvel is None) + ("foot_contact",) * (feet is None)
    lin_vel_b, ang_vel_b = (
        rows[:, column(name)] for name in ("base_lin_vel_b", "base_ang_vel_b")
    )
    return as_episode(
        robot,
        states,
        rates,
        rows,
        dt_s=dt_s,
        command=one_command(asked, lin_vel_b, ang_vel_b),
        task=task,
        number=0,
        sha256=sha256_bytes(states.tobytes()),
        extra={"source": "qpos", "derived_features": " ".join(derived)},
        end_reason="terminated" if fell else "truncated",
        action=None if acted is None else acted[1:],
    )


def _unit(wxyz: np.ndarray) -> np.ndarray:
    """Attitudes [N, 4] that are about of length 1, made 1."""
    length = np.linalg.norm(wxyz, axis=1)
    off = np.abs(length - 1)
    if off.max() > UNIT_TOLERANCE:
        row = int(off.argmax())
        raise LogError(
            f"qpos[{row}, 3:7] is an attitude of length {length[row]:.3g} in place of "
            "1; are the columns position, attitude wxyz, joints?"
        )
    return wxyz / length[:, None]


def _checked(
    name: str, told: np.ndarray, count: int, width: int, start: int = 0
) -> np.ndarray:
    """`told` as numbers [N, width] that can be; rows before `start` are not looked at.

    Raises:
        LogError: it is something else.
    """
    try:
        values = np.asarray(told, dtype=np.float64)
    except (TypeError, ValueError):
        raise LogError(f"{name} must hold numbers, got {type(told).__name__}") from None
    if values.shape != (count, width):
        raise LogError(
            f"{name} must be [{count}, {width}], a row for each state, got "
            f"{list(values.shape)}"
        )
    wrong = ~possible(values)
    wrong[:start] = False
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        worst = values[row][~(np.abs(values[row]) < LARGEST)][0]
        raise LogError(
            f"{name}[{row}] holds {worst}, as {int(wrong.sum())} of {count} rows do "
            "that cannot be; leave those states out"
        )
    return values


def _optional(
    name: str, told: np.ndarray | None, count: int, width: int
) -> np.ndarray | None:
    return None if told is None else _checked(name, told, count, width, start=1)


def _asked(
    command: np.ndarray | tuple[float, float, float] | None, count: int
) -> np.ndarray | None:
    """The command of every state [N, 3]."""
    if command is None:
        return None
    one = np.asarray(command, dtype=np.float64)
    return _checked(
        "command", np.tile(one, (count, 1)) if one.shape == (3,) else one, count, 3
    )


def _rates(qpos: np.ndarray, robot: Robot, dt_s: float) -> np.ndarray:
    """Velocities [N, 18] of states [N, 19], by cubics through those around."""
    times_s, half_s = np.arange(len(qpos)) * dt_s, _WINDOW_STEPS * dt_s
    rates = np.zeros((len(qpos), 18))
    rates[:, :3] = local_fit(times_s, qpos[:, :3], times_s, half_s)[1]
    rates[:, 3:6] = local_attitude(times_s, qpos[:, 3:7], times_s, half_s)[1]
    joints = qpos[:, robot.qpos_adr]
    rates[:, robot.qvel_adr] = local_fit(times_s, joints, times_s, half_s)[1]
    return rates
