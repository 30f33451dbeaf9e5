"""What Isaac Lab leaves beside a policy: IO_descriptors.yaml, or params/env.yaml.

env.yaml holds the configuration of the training, its joints by regular expressions and
without their order, which is that of Isaac Sim: all hips, all thighs, all calves.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from data.features import JOINTS
from policy.law.law import LawError, Vector

from .draft import BY_TYPE, Draft, number_of, twelve
from .joint_names import canonical_joints
from .plain_yaml import at, read_plain_yaml
from .term_names import term_of

_ORDER = "hips, thighs, calves, each FL FR RL RR: Isaac Sim's order, which no file says"
_ABSOLUTE = ("joint_pos", "joint_pos_limit_normalized")
_PATTERN_CHARS = 200
_REPEATED_GROUP = re.compile(r"\)\s*[*+{]")


def read_env(path: Path, joints: tuple[str, ...] = BY_TYPE) -> Draft:
    """The law of an env.yaml, and of an agent.yaml beside it.

    Args:
        path: The env.yaml.
        joints: The order of the policy, in which its numbers are put by their names.

    Raises:
        LawError: it is none.
    """
    told = read_plain_yaml(path)
    robot, action = at(told, "scene", "robot"), at(told, "actions", "joint_pos")
    if not isinstance(robot, dict) or not isinstance(action, dict):
        raise LawError(
            f"{path}: it has no scene.robot and actions.joint_pos, as Isaac Lab "
            "writes: say the law in a TOML (--explain prints one, --law takes it)"
        )
    joints = canonical_joints(joints, JOINTS)
    names = [f"{joint}_joint" for joint in joints]
    pose = _by_name(at(robot, "init_state", "joint_pos"), names, 0.0, path)
    actuators = at(robot, "actuators") or {}
    if not isinstance(actuators, dict):
        raise LawError(f"{path}: scene.robot.actuators must have names")
    scale = action.get("scale")
    offset = pose
    if not action.get("use_default_offset", True):
        offset = _by_name(action.get("offset", 0.0), names, 0.0, path)
    return Draft(
        source=f"{path.parent.name}/{path.name}",
        joints=joints,
        terms=_terms(path, at(told, "observations", "policy")),
        newest_first=False,
        by_term=True,
        default_joint_pos_rad=pose,
        action_scale_rad=_by_name(1.0 if scale is None else scale, names, 1.0, path),
        action_offset_rad=offset,
        kp_nm_per_rad=_of_actuators(actuators, "stiffness", names, path),
        kd_nm_s_per_rad=_of_actuators(actuators, "damping", names, path),
        torque_limit_nm=_limits(actuators, names, path),
        physics_dt_s=number_of(at(told, "sim", "dt")),
        substeps=int(number_of(told.get("decimation")) or 0) or None,
        activation=activation_of(path.with_name("agent.yaml")),
        guessed={"joints": _ORDER},
    )


def activation_of(agent: Path) -> str | None:
    """What agent.yaml says of the function between the layers.

    Raises:
        LawError: the network is recurrent.
    """
    if not agent.exists():
        return None
    told = read_plain_yaml(agent)
    for part in ("actor", "policy"):
        kind = str(at(told, part, "class_name") or "")
        if "Recurrent" in kind or "RNN" in kind or at(told, part, "rnn_type"):
            raise LawError(
                f"{agent}: the policy is recurrent ({kind or 'rnn_type'}), and only "
                "feed-forward networks of proprioception are taken"
            )
        if isinstance(found := at(told, part, "activation"), str):
            return found
    return None


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
                str(entry.get("name")),
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


def _terms(path: Path, group: Any) -> Any:
    if not isinstance(group, dict):
        raise LawError(f"{path}: it has no observations.policy")
    common = group.get("history_length")
    terms = []
    for name, value in group.items():
        if not isinstance(value, dict) or "func" not in value:
            continue
        func = str(value["func"])
        if re.split(r"[:.]", func)[-1] in _ABSOLUTE:
            raise LawError(
                f"{path}: the policy sees {func[-60:]!r}, angles that are not measured "
                "from the default pose, which is not followed here: give one trained "
                "with joint_pos_rel"
            )
        # The function says it more surely than the name somebody gave the term.
        known = func if func.endswith(("_rel", "_vel", "_gravity", "_scan")) else name
        terms.append(
            term_of(
                known,
                scale=value.get("scale"),
                clip=value.get("clip"),
                frames=common or value.get("history_length"),
            )
        )
    return tuple(terms)


def _of_actuators(
    actuators: dict[str, Any], key: str, names: list[str], path: Path
) -> Vector:
    values: list[float | None] = [None] * 12
    for group in actuators.values():
        patterns = at(group, "joint_names_expr")
        patterns = patterns if isinstance(patterns, list) else [patterns or ".*"]
        for index, name in enumerate(names):
            if any(_fits(str(pattern), name, path) for pattern in patterns):
                values[index] = _by_name(at(group, key), names, 0.0, path)[index]
    if any(value is None for value in values):
        raise LawError(f"{path}: no actuator says the {key} of every joint")
    return twelve(values, key)


def _limits(actuators: dict[str, Any], names: list[str], path: Path) -> Vector | None:
    for key in ("effort_limit_sim", "effort_limit", "saturation_effort"):
        if all(at(group, key) is not None for group in actuators.values()):
            return _of_actuators(actuators, key, names, path)
    return None


def _by_name(value: Any, names: list[str], otherwise: float, path: Path) -> Vector:
    """A number, twelve, or a mapping of regular expressions to numbers."""
    if not isinstance(value, dict):
        return twelve(value, str(path))
    found = [otherwise] * 12
    for pattern, number in value.items():
        if (plain := number_of(number)) is None:
            raise LawError(f"{path}: {str(pattern)[:40]} must be a number")
        fits = [i for i, name in enumerate(names) if _fits(str(pattern), name, path)]
        if not fits:
            raise LawError(
                f"{path}: {str(pattern)[:40]!r} fits none of the joints "
                f"{', '.join(names[:3])}, ...: say the law in a TOML (--explain prints "
                "one, --law takes it)"
            )
        for index in fits:
            found[index] = plain
    return tuple(found)


def _fits(pattern: str, name: str, path: Path) -> bool:
    # A stranger's expression could be matched for ever: repetitions in a repetition,
    # many in a row, or many alternatives are more ways than can be tried.
    open_ends = sum(map(pattern.replace("(?", "(").count, "*+?{"))
    if (
        len(pattern) > _PATTERN_CHARS
        or open_ends > 4
        or pattern.count("|") > 12
        or _REPEATED_GROUP.search(pattern)
    ):
        raise LawError(
            f"{path}: {pattern[:40]!r} is no plain pattern of joint names, with at "
            f"most {_PATTERN_CHARS} letters, 4 of * + ? {{ and none after a group: "
            "write names or .*"
        )
    try:
        return re.fullmatch(pattern, name) is not None
    except re.error:
        raise LawError(f"{path}: {pattern[:40]!r} is no regular expression") from None
