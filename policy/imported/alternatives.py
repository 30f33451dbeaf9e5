"""What was guessed, tried the other way: where the figures differ, they say so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from data.errors import GaitprefError
from data.features import JOINTS
from data.files.telling import Tell, silent
from policy.env.env_cfg import EnvCfg
from policy.law.law import Law, Term
from policy.law.origin import Measured
from policy.robots.robot import Robot

from .bring import Understood, embodied
from .meaning.draft import BY_TYPE, LEFT_FIRST, RIGHT_FIRST, Draft
from .meaning.joint_names import canonical_joints
from .meaning.trainer_laws import POSES, scaled_hips
from .plain_robot import plainer
from .readers.network_file import read_network
from .trial import measure

_ASKED = ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
"""Of one simulation. Turning is what a wrong scale of gyro or command is seen by."""
_WALK_S = 5.0
_CLOSER = ", closer than what was taken"
_APART = 0.05
"""m/s and rad/s: how far figures must differ to be told apart."""
_ORDERS = {
    "FL FR RL RR, leg by leg": LEFT_FIRST,
    "FR FL RR RL, leg by leg": RIGHT_FIRST,
    "all hips, thighs, calves": BY_TYPE,
}
_LIMITS = {"half": 0.5, "1.5 times": 1.5}
_ACTIVATIONS = ("elu", "relu", "tanh")


def tried(
    known: Understood, robot_xml: Path | None, tell: Tell = silent
) -> Iterator[str]:
    """What a policy does with each other value of what was guessed, and on a robot
    that is more as trainers have it where it is too fast or slow, a line each; `tell`
    gets how many values and robots are tried."""
    law, robot, cfg = embodied(known, robot_xml)
    taken = _measured(known, law, robot, cfg)
    limits = robot.torque_limit[law.from_canonical]
    instead = list(others(known, limits))
    of = 1 + len(instead)
    tell(1, of)
    for done, (told, other) in enumerate(instead, start=2):
        try:
            rows = _measured(other, *embodied(other, robot_xml))
        except GaitprefError as error:
            yield f"{told}: {error}"
            continue
        tell(done, of)
        yield f"{told}: {_in_words(rows)}{against(rows, taken)}"
    fallen = _falls(taken)
    exact = not fallen and max(_off(row) for row in taken[1:]) < _APART
    if exact or fallen & set(_ASKED[:2]):
        return
    robots = list(plainer(robot))
    for done, (told, plain) in enumerate(robots, start=of + 1):
        rows = _measured(known, law, plain, cfg)
        tell(done, of + len(robots))
        verdict = against(rows, taken)
        if verdict == _CLOSER:
            verdict += "; a copy of the model with it, as --robot, takes it"
        yield f"{told}: {_in_words(rows)}{verdict}"


def others(
    known: Understood, limits_nm: np.ndarray | None = None
) -> Iterator[tuple[str, Understood]]:
    """The policy with each other value of what was guessed, and what that is.

    Args:
        known: The policy.
        limits_nm: [12] of the robot's model, in the policy's order of the joints; None
            leaves limits of torque as they are.
    """
    for told, draft in _other_drafts(known):
        yield told, replace(known, draft=draft)
    if limits_nm is not None:
        for told, draft in _other_limits(known.draft, limits_nm):
            yield told, replace(known, draft=draft)
    if "activation" in known.draft.guessed:
        taken = known.draft.guessed["activation"]
        for name in _ACTIVATIONS:
            if name != taken:
                found = read_network(known.file, name)
                yield f"activation {name}", replace(known, found=found)


def _other_drafts(known: Understood) -> Iterator[tuple[str, Draft]]:
    draft = known.draft
    if "joints" in draft.guessed:
        for told, order in _ORDERS.items():
            if order != draft.joints:
                yield f"joints {told}", replace(known.in_order(order), joints=order)
    if "by_term" in draft.guessed or "newest_first" in draft.guessed:
        for by_term, newest in product((True, False), repeat=2):
            changes: dict[str, Any] = {"by_term": by_term, "newest_first": newest}
            if (draft.by_term, draft.newest_first) != (by_term, newest):
                frames = "term by term" if by_term else "frame by frame"
                first = "newest" if newest else "oldest"
                yield f"history {frames}, {first} first", replace(draft, **changes)
    if "joint_pos" in draft.guessed and draft.terms is not None:
        yield (
            "joint_pos as absolute angles",
            replace(draft, terms=_absolute(draft.terms)),
        )
    yield from _other_times(draft)
    yield from _other_poses(draft)


def _other_times(draft: Draft) -> Iterator[tuple[str, Draft]]:
    dt_s, substeps = draft.physics_dt_s, draft.substeps
    if dt_s is None or substeps is None:
        return
    if "substeps" in draft.guessed:
        for other in (max(1, substeps // 2), 2 * substeps):
            told = f"an action every {1000 * dt_s * other:g} ms"
            yield told, replace(draft, substeps=other)
    if "physics_dt_s" in draft.guessed:
        finer = replace(draft, physics_dt_s=dt_s / 2, substeps=2 * substeps)
        yield f"physics of {500 * dt_s:g} ms", finer


def _other_limits(draft: Draft, nm: np.ndarray) -> Iterator[tuple[str, Draft]]:
    # A model without limits has none that could be halved.
    if "torque_limit_nm" not in draft.guessed or not np.isfinite(nm).all():
        return
    for told, factor in _LIMITS.items():
        limits = tuple(float(each) for each in factor * nm)
        yield (
            f"torques up to {told} the model's",
            replace(draft, torque_limit_nm=limits),
        )


def _other_poses(draft: Draft) -> Iterator[tuple[str, Draft]]:
    scale = draft.action_scale_rad
    if draft.joints is None or "default_joint_pos_rad" not in draft.guessed:
        return
    joints = canonical_joints(draft.joints, JOINTS)
    for told, pose_of in POSES.items():
        if (pose := pose_of(joints)) != draft.default_joint_pos_rad:
            yield f"pose {told}", replace(draft, default_joint_pos_rad=pose)
    if "action_scale_rad" in draft.guessed and scale is not None:
        # Where a trainer has halved them already, the other way is up.
        halved = scale[joints.index("FL_hip")] < scale[joints.index("FL_thigh")]
        told, factor = ("twice", 2.0) if halved else ("half", 0.5)
        other = scaled_hips(joints, scale, factor)
        yield f"hips at {told} their scale", replace(draft, action_scale_rad=other)


def _absolute(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    return tuple(
        replace(term, name="joint_pos_abs") if term.name == "joint_pos" else term
        for term in terms
    )


def _measured(
    known: Understood, law: Law, robot: Robot, cfg: EnvCfg
) -> tuple[Measured, ...]:
    network = known.found.network(tuple(int(j) for j in law.to_canonical))
    return measure(
        lambda obs, noise=None: network(obs), robot, cfg, asked=_ASKED, walk_s=_WALK_S
    )


def _in_words(rows: tuple[Measured, ...]) -> str:
    fallen = [row for row in rows if row.fell_at_s is not None]
    if fallen and not any(fallen[0].command):
        return f"falls at {fallen[0].fell_at_s:.1f} s standing"
    told = [_walk_in_words(row) for row in rows if any(row.command)]
    return ", ".join(told)


def _walk_in_words(row: Measured) -> str:
    asked = row.command[2] or row.command[0]
    verb, unit = ("turns", "rad/s") if row.command[2] else ("walks", "m/s")
    if row.fell_at_s is not None:
        return f"falls at {row.fell_at_s:.1f} s at {asked:.1f} {unit}"
    return f"{verb} {_asked_of(row):.2f} of {asked:.1f} {unit}"


def against(rows: tuple[Measured, ...], taken: tuple[Measured, ...]) -> str:
    """How what was tried compares with what was taken, by all commands that neither
    falls at; who falls at fewer is told so."""
    if _falls(rows) - _falls(taken):
        return ""
    if _falls(taken) - _falls(rows):
        return ", and what was taken falls"
    pairs = [
        (mine, its)
        for mine, its in zip(rows, taken, strict=True)
        if any(mine.command) and mine.fell_at_s is None
    ]
    if not pairs:
        return ""
    if all(abs(_asked_of(mine) - _asked_of(its)) < _APART for mine, its in pairs):
        return ", as what was taken does: these figures do not tell them apart"
    closer = sum(_off(its) - _off(mine) for mine, its in pairs)
    return _CLOSER if closer >= _APART else ""


def _falls(rows: tuple[Measured, ...]) -> set[tuple[float, float, float]]:
    """The commands it falls at."""
    return {row.command for row in rows if row.fell_at_s is not None}


def _asked_of(row: Measured) -> float:
    """The speed that was asked for, as it was done: m/s forward, or rad/s."""
    return row.yaw_rad_s if row.command[2] else row.forward_m_s


def _off(row: Measured) -> float:
    """How far that is from what was asked for."""
    return abs(_asked_of(row) - (row.command[2] or row.command[0]))
