"""The two YAML files of rl_sar: `config.yaml` of a policy, `base.yaml` of its robot.

`joint_mapping` says which joint of the robot each joint of the policy is; the vectors
of config.yaml are in the order of the policy. In `observations_history` 0 is the newest
frame; the priority `time` puts frames together, `term` terms.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from policy.law.law import LawError

from .draft import Draft, number_of, order_of, robot_name, twelve, whole_of
from .plain_yaml import read_plain_yaml
from .term_names import term_name, term_of

_SCALES = {
    "base_lin_vel": "lin_vel_scale",
    "base_ang_vel": "ang_vel_scale",
    "joint_pos": "dof_pos_scale",
    "joint_vel": "dof_vel_scale",
    "command": "commands_scale",
}


def read_rl_sar(config: Path, base: Path) -> Draft:
    """The law of a policy of rl_sar.

    Raises:
        LawError: a file is none of the pair.
    """
    _, told = _one_section(config)
    name, robot = _one_section(base)
    both = {**robot, **told}
    names = robot.get("joint_names")
    if not isinstance(names, list) or len(names) != 12:
        raise LawError(f"{base}: joint_names must be 12 names")
    mapping = order_of(both.get("joint_mapping"), f"{config}: joint_mapping")
    newest_first, frames = _history(config, both.get("observations_history"))
    observed = both.get("observations")
    if not isinstance(observed, list):
        raise LawError(f"{config}: observations must be a list of names")
    terms = tuple(
        term_of(name, scale=both.get(_SCALES.get(term_name(name), "")), frames=frames)
        for name in map(str, observed)
    )
    upper = both.get("clip_actions_upper")
    return Draft(
        source=f"{config.name} with {base.name}",
        robot=robot_name(name),
        joints=tuple(str(names[joint]) for joint in mapping),
        terms=terms,
        newest_first=newest_first,
        by_term=both.get("observations_history_priority") == "term",
        obs_limit=number_of(both.get("clip_obs")),
        default_joint_pos_rad=twelve(both.get("default_dof_pos"), "default_dof_pos"),
        action_scale_rad=twelve(both.get("action_scale"), "action_scale"),
        action_limit=None
        if upper is None
        else min(twelve(upper, "clip_actions_upper")),
        kp_nm_per_rad=twelve(both.get("rl_kp"), "rl_kp"),
        kd_nm_s_per_rad=twelve(both.get("rl_kd"), "rl_kd"),
        torque_limit_nm=twelve(both.get("torque_limits"), "torque_limits"),
        physics_dt_s=number_of(both.get("dt")),
        substeps=whole_of(both.get("decimation"), f"{base}: decimation"),
    )


def _one_section(path: Path) -> tuple[str, dict[str, Any]]:
    """The one name at the top of the file, and what stands under it."""
    told = read_plain_yaml(path)
    sections = [(str(name), v) for name, v in told.items() if isinstance(v, dict)]
    if len(sections) != 1:
        raise LawError(f"{path}: it must have one section, as rl_sar's files do")
    return sections[0]


def _history(path: Path, ages: Any) -> tuple[bool, int]:
    """Whether the newest frame is first, and how many there are."""
    if not ages:
        return False, 1
    count = len(ages) if isinstance(ages, list) else 0
    if count and ages == list(range(count)):
        return True, count
    if count and ages == list(range(count - 1, -1, -1)):
        return False, count
    raise LawError(
        f"{path}: observations_history must be frames that follow one another, got "
        f"{str(ages)[:80]}"
    )
