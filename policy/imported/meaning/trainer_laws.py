"""Laws of trainers that write down none, by their names; read off their sources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

from data.features import JOINTS
from policy.law.gait import Gait
from policy.law.law import Term

from .draft import BY_TYPE, LEFT_FIRST, RIGHT_FIRST, Draft
from .joint_names import canonical_joints


def _pose(joints: tuple[str, ...], **angles: float) -> tuple[float, ...]:
    """An angle for each joint: of `FL_hip`, else of `F_thigh`, else of `calf`."""

    def angle(joint: str) -> float:
        leg, part = joint.split("_")
        for name in (f"{leg[1]}_{part}", f"{leg[0]}_{part}_", part):
            if name in angles:
                return angles[name]
        raise KeyError(joint)

    return tuple(angle(joint) for joint in joints)


def _a1_pose(joints: tuple[str, ...]) -> tuple[float, ...]:
    return _pose(joints, L_hip=0.1, R_hip=-0.1, F_thigh_=0.8, R_thigh_=1.0, calf=-1.5)


def _go1_pose(joints: tuple[str, ...]) -> tuple[float, ...]:
    return _pose(joints, L_hip=-0.1, R_hip=0.1, thigh=0.9, calf=-1.8)


def _straight_hips(joints: tuple[str, ...]) -> tuple[float, ...]:
    return _pose(joints, hip=0.0, thigh=0.8, calf=-1.5)


POSES: dict[str, Callable[[tuple[str, ...]], tuple[float, ...]]] = {
    "of an A1 (thighs 0.8 and 1.0, calves -1.5)": _a1_pose,
    "of a Go1 (thighs 0.9, calves -1.8)": _go1_pose,
    "with hips at 0 (thighs 0.8, calves -1.5)": _straight_hips,
}
"""Default poses that trainers have, rad, of joints by the names of `JOINTS`."""


def scaled_hips(
    joints: tuple[str, ...], scale: tuple[float, ...], factor: float = 0.5
) -> tuple[float, ...]:
    """`scale` with that of the hips times `factor`: some trainers have halved it."""
    pairs = zip(joints, scale, strict=True)
    return tuple(s * factor if joint.endswith("hip") else s for joint, s in pairs)


def _of_part(joints: tuple[str, ...], leg: float, calf: float) -> tuple[float, ...]:
    return tuple(calf if joint.endswith("calf") else leg for joint in joints)


def _terms(*names: str, **scales: float | tuple[float, ...]) -> tuple[Term, ...]:
    def scale(name: str) -> tuple[float, ...]:
        value = scales.get(name, 1.0)
        return value if isinstance(value, tuple) else (value,)

    return tuple(Term(name=name, scale=scale(name)) for name in names)


_BODY = ("base_lin_vel", "base_ang_vel", "projected_gravity")
_JOINTS = ("joint_pos", "joint_vel", "last_action")


def _legged_gym(name: str) -> Draft:
    return Draft(
        source=f"the preset {name}",
        robot=name.rpartition("-")[2],
        joints=LEFT_FIRST,
        terms=_terms(
            *_BODY,
            "command",
            *_JOINTS,
            base_lin_vel=2.0,
            base_ang_vel=0.25,
            command=(2.0, 2.0, 0.25),
            joint_vel=0.05,
        ),
        obs_limit=100.0,
        default_joint_pos_rad=_a1_pose(LEFT_FIRST),
        action_scale_rad=(0.25,) * 12,
        action_limit=100.0,
        kp_nm_per_rad=(20.0,) * 12,
        kd_nm_s_per_rad=(0.5,) * 12,
        physics_dt_s=0.005,
        substeps=4,
    )


_GAIT_SCALES = (2.0, *(1.0,) * 5, 0.15, 0.3, 0.3, *(1.0,) * 3)


def _walk_these_ways() -> Draft:
    """Frames are counted by the width of the network: 30 of 70 numbers."""
    return Draft(
        source="the preset walk-these-ways",
        robot="go1",
        joints=LEFT_FIRST,
        terms=_terms(
            "projected_gravity",
            "command",
            "gait_command",
            *_JOINTS,
            "action_before_last",
            "gait_clock",
            command=(2.0, 2.0, 0.25),
            gait_command=_GAIT_SCALES,
            joint_vel=0.05,
        ),
        newest_first=False,
        by_term=False,
        before="zeros",
        gait=Gait(),
        obs_limit=100.0,
        default_joint_pos_rad=_a1_pose(LEFT_FIRST),
        action_scale_rad=scaled_hips(LEFT_FIRST, (0.25,) * 12),
        action_limit=10.0,
        kp_nm_per_rad=(20.0,) * 12,
        kd_nm_s_per_rad=(0.5,) * 12,
        physics_dt_s=0.005,
        substeps=4,
        guessed={
            "gait": "a trot of 3 Hz, feet 0.08 m high, stance 0.25 by 0.4 m; it "
            "follows others too, which [gait] of a TOML says (--explain prints it, "
            "--law takes it)",
            "gait_command": "scales of its numbers, as the trainer's settings have "
            "them",
            "gait_clock": "at the start of its cycle where an episode begins",
            "before": "zeros before an episode, as its own player begins",
            "action_limit": "10, as the trainer's settings have it",
            "kp_nm_per_rad": "20 with kd 0.5: the training had a network in place of "
            "motors, and a delay, which are not followed",
        },
    )


PRESETS: dict[str, Draft] = {
    "legged-gym-a1": _legged_gym("legged-gym-a1"),
    "legged-gym-go2": _legged_gym("legged-gym-go2"),
    "isaac-lab-go2-flat": Draft(
        source="the preset isaac-lab-go2-flat",
        robot="go2",
        joints=BY_TYPE,
        terms=_terms(*_BODY, "command", *_JOINTS),
        default_joint_pos_rad=_a1_pose(BY_TYPE),
        action_scale_rad=(0.25,) * 12,
        kp_nm_per_rad=(25.0,) * 12,
        kd_nm_s_per_rad=(0.5,) * 12,
        physics_dt_s=0.005,
        substeps=4,
    ),
    "unitree-rl-lab-go2": Draft(
        source="the preset unitree-rl-lab-go2",
        robot="go2",
        joints=BY_TYPE,
        terms=_terms(*_BODY[1:], "command", *_JOINTS, base_ang_vel=0.2, joint_vel=0.05),
        default_joint_pos_rad=_a1_pose(BY_TYPE),
        action_scale_rad=(0.25,) * 12,
        kp_nm_per_rad=(25.0,) * 12,
        kd_nm_s_per_rad=(0.5,) * 12,
        physics_dt_s=0.005,
        substeps=4,
    ),
    "unitree-rl-mjlab-go2": Draft(
        source="the preset unitree-rl-mjlab-go2",
        robot="go2",
        joints=LEFT_FIRST,
        terms=_terms(*_BODY[1:], "command", *_JOINTS),
        default_joint_pos_rad=_go1_pose(LEFT_FIRST),
        action_scale_rad=(0.5,) * 12,
        kp_nm_per_rad=_of_part(LEFT_FIRST, 20.0, 40.0),
        kd_nm_s_per_rad=_of_part(LEFT_FIRST, 1.0, 2.0),
        physics_dt_s=0.005,
        substeps=4,
    ),
    "mjlab-go1-flat": Draft(
        source="the preset mjlab-go1-flat",
        robot="go1",
        joints=RIGHT_FIRST,
        terms=_terms(*_BODY, *_JOINTS, "command"),
        default_joint_pos_rad=_go1_pose(RIGHT_FIRST),
        action_scale_rad=_of_part(RIGHT_FIRST, 0.373, 0.249),
        kp_nm_per_rad=_of_part(RIGHT_FIRST, 15.9, 35.8),
        kd_nm_s_per_rad=_of_part(RIGHT_FIRST, 1.01, 2.28),
        physics_dt_s=0.005,
        substeps=4,
    ),
    "walk-these-ways": _walk_these_ways(),
}
"""Sources: legged_gym a1_config.py and unitree_rl_gym go2_config.py; Isaac Lab
velocity_env_cfg.py with unitree.py; unitree_rl_lab and unitree_rl_mjlab deploy.yaml of
their Go2; metadata of mjlab 1.6's Go1, whose numbers have three digits; walk-these-ways
legged_robot.py with train.py and play.py."""


def preset_law(name: str, joints: tuple[str, ...] | None = None) -> Draft:
    """The preset `name`, its joints in another order if one is given.

    What a training often changes, and with which a robot walks either way, is guessed.

    Raises:
        LawError: `joints` are not the twelve.
    """
    draft = PRESETS[name]
    assert draft.joints is not None
    why = "the trainer's own, which a training may have changed: no file says it"
    changed = dict.fromkeys(("default_joint_pos_rad", "action_scale_rad"), why)
    guessed = {**draft.guessed, **changed}
    order = draft.joints if joints is None else canonical_joints(joints, JOINTS)
    vectors: dict[str, Any] = {
        each.name: tuple(value[draft.joints.index(joint)] for joint in order)
        for each in fields(draft)
        if each.name != "joints"
        and isinstance(value := getattr(draft, each.name), tuple)
        and len(value) == 12
    }
    return replace(draft, joints=order, guessed=guessed, **vectors)
