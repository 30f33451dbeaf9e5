"""`params/env.yaml` of Isaac Lab or mjlab, and `agent.yaml` beside it.

They hold the configuration of the training, joints by regular expressions and mostly
without their order: Isaac Sim's is hips, thighs, calves, mjlab's that of the model.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from data.features import JOINTS
from policy.law.law import LawError, Term, Vector

from .draft import BY_TYPE, INSTEAD, LEFT_FIRST, Draft, number_of, robot_name, whole_of
from .joint_names import canonical_joints
from .mjlab import as_isaac_lab
from .named_joints import NamedJoints
from .plain_yaml import at, read_plain_yaml
from .term_names import end_of, known_by, term_of

_BY_TYPE = (
    "hips, thighs, calves, each FL FR RL RR: Isaac Sim's order, which no file says"
)
_BY_MODEL = "as the robot's model has them, which is mjlab's order; no file says it"


def read_env(
    path: Path,
    joints: tuple[str, ...] | None = None,
    spelled: Mapping[str, str] | None = None,
) -> Draft:
    """The law of an env.yaml, and of an agent.yaml beside it.

    Args:
        path: The env.yaml.
        joints: The order of the policy, in which its numbers are put by their names;
            None is what the file says, or the order that its trainer has.
        spelled: What the robot's model calls each of `JOINTS`, in its order.

    Raises:
        LawError: it is none.
    """
    told = read_plain_yaml(path)
    of_mjlab = as_isaac_lab(told)
    told, spelled = of_mjlab or told, spelled or {}
    robot, action = at(told, "scene", "robot"), _action(path, told.get("actions"))
    if not isinstance(robot, dict):
        raise LawError(
            f"{path}: it has no scene.robot or scene.entities, as Isaac Lab and mjlab "
            f"write: {INSTEAD}"
        )
    agent = path.with_name("agent.yaml")
    trained = read_plain_yaml(agent) if agent.exists() else {}
    groups = _seen(path, told.get("observations"), trained.get("obs_groups"))
    guessed = _late(robot)
    if joints is None and (joints := _said_order(path, action, groups)) is None:
        guessed["joints"] = _BY_MODEL if of_mjlab else _BY_TYPE
        joints = (tuple(spelled) or LEFT_FIRST) if of_mjlab else BY_TYPE
    joints = canonical_joints(joints, [spelled.get(each, each) for each in JOINTS])
    named = NamedJoints.of(path, joints, spelled)
    pose = at(robot, "init_state", "joint_pos")
    pose = None if pose is None else named.numbers(pose, "joint_pos", 0.0)
    scale, offset, clip = (action.get(key) for key in ("scale", "offset", "clip"))
    motors = list((at(robot, "actuators") or {}).values())
    return Draft(
        source=f"{path.parent.name}/{path.name}",
        robot=_name_of(robot),
        joints=joints,
        terms=tuple(term for group in groups for term in _terms(path, group)),
        newest_first=False,
        by_term=True,
        default_joint_pos_rad=pose,
        action_scale_rad=named.numbers(1.0 if scale is None else scale, "scale", 1.0),
        action_offset_rad=pose
        if action.get("use_default_offset", True)
        else named.numbers(offset or 0.0, "offset", 0.0),
        action_limit=number_of(trained.get("clip_actions")),
        target_clip_rad=tuple(named.mapped(clip, _bounds, "clip", (-1e9, 1e9)))
        if isinstance(clip, dict)
        else None,
        kp_nm_per_rad=named.of_actuators(motors, "stiffness"),
        kd_nm_s_per_rad=named.of_actuators(motors, "damping"),
        torque_limit_nm=_limits(named, motors),
        joint_friction_nm=_friction(named, motors, of_mjlab is not None),
        physics_dt_s=number_of(at(told, "sim", "dt")),
        substeps=whole_of(told.get("decimation"), f"{path}: decimation"),
        activation=activation_of(agent),
        guessed=guessed,
    )


def _name_of(robot: Any) -> str | None:
    """What the model of the robot is called: a file, or mjlab's module of it."""
    for key in ("usd_path", "asset_path"):
        if isinstance(file := at(robot, "spawn", key), str):
            return robot_name(re.split(r"[/\\]", file)[-1].partition(".")[0])
    if isinstance(function := at(robot, "spawn", "spec_fn"), str):
        module = re.split(r"[.:]", function)[-2:][0]
        return robot_name(module.removesuffix("_constants"))
    return None


def _action(path: Path, actions: Any) -> dict[str, Any]:
    """The term of joint targets: it is called joint_pos, or is the only one."""
    named = actions if isinstance(actions, dict) else {}
    action = named.get("joint_pos")
    if action is None and len(named) == 1:
        action = next(iter(named.values()))
    kind = end_of(at(action, "class_type") or "JointPositionAction")
    if not isinstance(action, dict) or kind != "JointPositionAction":
        told = ", ".join(map(str, named))[:60] or "none"
        raise LawError(
            f"{path}: its actions are {told} ({kind[:60]}), and one target for each "
            f"joint (JointPositionAction) is followed alone: {INSTEAD}"
        )
    return action


def _seen(path: Path, observed: Any, of_agent: Any) -> list[dict[str, Any]]:
    """The groups of observations that the actor sees, in their order."""
    named = observed if isinstance(observed, dict) else {}
    names = at(of_agent, "actor") or at(of_agent, "policy")
    if not isinstance(names, list):
        names = [name for name in ("actor", "policy") if name in named][:1]
    seen = [named.get(str(name)) for name in names]
    if not seen or not all(isinstance(group, dict) for group in seen):
        raise LawError(
            f"{path}: it has no observations of {' and '.join(map(str, names))[:80]} "
            f"for the actor, but of {', '.join(map(str, named))[:80] or 'nothing'}: "
            f"{INSTEAD}"
        )
    return seen  # type: ignore[return-value]


def _said_order(
    path: Path, action: dict[str, Any], groups: list[dict[str, Any]]
) -> tuple[str, ...] | None:
    """The order of joints, where actions and observations list twelve and keep to it.

    Raises:
        LawError: each has another order.
    """
    orders = {_kept(action)}
    for name in ("joint_pos", "joint_vel"):
        terms = [group[name] for group in groups if name in group]
        orders |= {_kept(at(term, "params", "asset_cfg")) for term in terms}
    if len(orders) > 1:
        raise LawError(
            f"{path}: actions, joint_pos and joint_vel do not all list their joints in "
            "one order (preserve_order), which is not followed here: give a policy "
            "trained with one order"
        )
    return orders.pop()


def _kept(told: Any) -> tuple[str, ...] | None:
    """Twelve names of joints whose order is kept."""
    names = at(told, "joint_names") or at(told, "actuator_names")
    if at(told, "preserve_order") is not True or not isinstance(names, list):
        return None
    plain = len(names) == 12 and all(re.fullmatch(r"[\w/-]+", str(n)) for n in names)
    return tuple(map(str, names)) if plain else None


def _late(robot: Any) -> dict[str, str]:
    """What is told of a delay of the motors, which no law has."""
    motors = (at(robot, "actuators") or {}).values()
    lags = [at(each, key) for each in motors for key in ("delay_max_lag", "max_delay")]
    if most := max((number_of(lag) or 0.0 for lag in lags), default=0.0):
        return {
            "delay": f"none: targets came up to {most:g} time steps late in training"
        }
    return {}


def _limits(named: NamedJoints, motors: list[Any]) -> Vector | None:
    for key in ("effort_limit_sim", "effort_limit", "saturation_effort"):
        if (found := named.of_actuators(motors, key)) is not None:
            return found
    return None


def _friction(named: NamedJoints, motors: list[Any], in_nm: bool) -> float | None:
    """Dry friction, where all joints have one; without `in_nm` only 0 has no unit."""
    found = set(named.of_actuators(motors, "friction") or ())
    return found.pop() if len(found) == 1 and (in_nm or found == {0.0}) else None


def _bounds(value: Any) -> tuple[float, float] | None:
    if not isinstance(value, list) or len(value) != 2:
        return None
    low, high = map(number_of, value)
    return None if low is None or high is None or low >= high else (low, high)


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


def _terms(path: Path, group: Any) -> list[Term]:
    common = group.get("history_length")
    terms = []
    for name, value in group.items():
        if not isinstance(value, dict) or "func" not in value:
            continue
        terms.append(
            term_of(
                known_by(value["func"], str(name)),
                scale=value.get("scale"),
                clip=value.get("clip"),
                frames=common or value.get("history_length"),
            )
        )
    return terms
