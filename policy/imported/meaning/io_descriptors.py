"""`IO_descriptors.yaml`, which Isaac Lab writes of a policy's input and output."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from policy.law.law import LawError, Vector

from .draft import Draft, number_of, twelve
from .plain_yaml import at, read_plain_yaml
from .term_names import known_by, term_of


def read_descriptors(path: Path) -> Draft:
    """The law of an IO_descriptors.yaml.

    Raises:
        LawError: it is none.
    """
    told = read_plain_yaml(path)
    actions, robots = told.get("actions"), told.get("articulations")
    action = next(iter(_entries(actions)), None)
    robot = next(iter(_entries(robots)), None)
    if action is None or robot is None:
        raise LawError(f"{path}: it has no actions and articulations")
    names = action.get("joint_names") or robot.get("joint_names")
    if not isinstance(names, list) or len(names) != 12:
        raise LawError(f"{path}: the action must name 12 joints")
    of_robot = robot.get("joint_names") or names

    def vector(key: str) -> Vector | None:
        values = robot.get(key)
        if values is None:
            return None
        by_name = dict(zip(of_robot, values, strict=False))
        return twelve([by_name.get(name) for name in names], key)

    observed = told.get("observations")
    group = observed.get("policy", observed) if isinstance(observed, dict) else observed
    terms = []
    for entry in _entries(group, named=True):
        more = entry.get("overloads") or entry
        terms.append(
            term_of(
                known_by(entry.get("full_path") or entry.get("name")),
                scale=more.get("scale"),
                clip=more.get("clip"),
                frames=more.get("history_length"),
            )
        )
    offset, dt_s = action.get("offset"), number_of(at(told, "scene", "physics_dt"))
    step = number_of(at(told, "scene", "dt"))
    decimation = number_of(at(told, "scene", "decimation"))
    if decimation is None and dt_s and step:
        decimation = round(step / dt_s)
    return Draft(
        source=path.name,
        joints=tuple(map(str, names)),
        terms=tuple(terms) or None,
        newest_first=False,
        by_term=True,
        default_joint_pos_rad=vector("default_joint_pos"),
        action_scale_rad=twelve(action.get("scale", 1.0), "scale"),
        action_offset_rad=None if offset is None else twelve(offset, "offset"),
        kp_nm_per_rad=vector("default_joint_stiffness"),
        kd_nm_s_per_rad=vector("default_joint_damping"),
        physics_dt_s=dt_s,
        substeps=int(decimation or 0) or None,
        guessed={"torque_limit_nm": "those of the robot's model: the file says none"},
    )


def _entries(values: Any, *, named: bool = False) -> list[dict[str, Any]]:
    """The mappings in a list, or in a mapping, whose names they get."""
    if isinstance(values, list):
        return [each for each in values if isinstance(each, dict)]
    if isinstance(values, dict):
        return [
            {"name": name, **each} if named else each
            for name, each in values.items()
            if isinstance(each, dict)
        ]
    return []
