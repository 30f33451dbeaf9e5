"""mjlab's `params/env.yaml`, told as Isaac Lab tells the same.

It is the configuration as plain data: the robot is one of `scene.entities`, its
actuators a list, the time step that of MuJoCo, and a group of observations holds
`terms`. Joints are in the order of the robot's model.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .plain_yaml import at

_RENAMED = {"target_names_expr": "joint_names_expr", "frictionloss": "friction"}


def as_isaac_lab(told: Mapping[str, Any]) -> dict[str, Any] | None:
    """The parts of mjlab's tree where Isaac Lab has them; None of another's tree."""
    entities = at(told, "scene", "entities")
    if not isinstance(entities, dict) or not entities:
        return None
    robot = entities.get("robot", next(iter(entities.values())))
    motors: Any = at(robot, "articulation", "actuators")
    observed = told.get("observations")
    return {
        "scene": {
            "robot": {
                "init_state": at(robot, "init_state"),
                "spawn": {"spec_fn": robot.get("spec_fn")}
                if isinstance(robot, dict)
                else None,
                "actuators": {
                    str(place): {_RENAMED.get(k, k): v for k, v in group.items()}
                    for place, group in enumerate(list(motors or []))
                    if isinstance(group, dict)
                },
            }
        },
        "actions": told.get("actions"),
        "observations": {
            name: {**group, **(at(group, "terms") or {})}
            for name, group in (observed if isinstance(observed, dict) else {}).items()
            if isinstance(group, dict)
        },
        "sim": {"dt": at(told, "sim", "mujoco", "timestep")},
        "decimation": told.get("decimation"),
    }
