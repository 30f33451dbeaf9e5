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

_ASKED = ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
_WALK_S = 5.0
_CLOSER = ", closer than what was taken"
_APART_M_S = 0.05
"""How far figures must differ to be told apart."""
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
    that is more as trainers have it where it walks too fast or slow, a line each;
    `tell` gets how many values and robots are tried."""
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
    if _fell(taken) or _off(taken) < _APART_M_S:
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
    stands, walks = rows
    if stands.fell_at_s is not None:
        return f"falls at {stands.fell_at_s:.1f} s standing"
    if walks.fell_at_s is not None:
        return f"falls at {walks.fell_at_s:.1f} s at 0.5 m/s"
    return f"walks {walks.forward_m_s:.2f} of 0.5 m/s"


def against(rows: tuple[Measured, ...], taken: tuple[Measured, ...]) -> str:
    """How what was tried compares with what was taken, where both walk or one does."""
    if _fell(rows):
        return ""
    if _fell(taken):
        return ", and what was taken falls"
    if abs(rows[1].forward_m_s - taken[1].forward_m_s) < _APART_M_S:
        return ", as what was taken does: these figures do not tell them apart"
    return _CLOSER if _off(rows) < _off(taken) else ""


def _fell(rows: tuple[Measured, ...]) -> bool:
    return any(row.fell_at_s is not None for row in rows)


def _off(rows: tuple[Measured, ...]) -> float:
    """How far a walk is from the speed that was asked for, m/s."""
    return abs(rows[1].forward_m_s - rows[1].command[0])
