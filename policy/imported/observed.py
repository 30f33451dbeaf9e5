"""What a policy that is trained here from scratch sees, where a file says it.

Only how it sees is taken over. How it acts stays this project's: pose, scale of
actions, gains and time steps are those of the robot and the environment.
"""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

from data.features import JOINTS
from policy.env.env_cfg import EnvCfg
from policy.env.own_law import own_law
from policy.law.law import Law, LawError
from policy.robots.robot import Robot
from policy.training.checkpoint import load_policy

from .meaning.draft import Draft, names_of
from .meaning.joint_names import canonical_joints
from .meaning.law_toml import read_law_toml
from .meaning.own_words import draft_of, read_own

_FRAMES = ("newest_first", "by_term", "before", "gait", "obs_limit")
_SEEN = ("terms", "joints", *_FRAMES)
"""Fields of a law that say what is seen; the joints' order is that of actions too."""


def observed_as(file: Path, robot: Robot, env: EnvCfg) -> tuple[Law, list[str]]:
    """The law of a new policy that sees what `file` says.

    Args:
        file: A TOML of `policy import --explain`, a policy.json, or a policy file.
        robot: Who will see.
        env: Where it will act, under a law of its own.

    Returns:
        The law, and the names of what the file says otherwise and is not taken over.

    Raises:
        GaitprefError: the file says nothing that this robot could see.
    """
    draft = _draft(file)
    if draft.terms is None:
        raise LawError(
            f"{file} says no terms: name them as [[terms]], in their order, each with "
            "name, scale, clip and frames"
        )
    joints = JOINTS
    if draft.joints is not None:
        joints = canonical_joints(draft.joints, names_of(robot))
    seen = {name: getattr(draft, name) for name in ("terms", *_FRAMES)}
    said = {name: value for name, value in seen.items() if value is not None}
    law = replace(own_law(robot, env, joints=joints), **said)
    left = [
        each.name
        for each in fields(Law)
        if each.name not in _SEEN
        and getattr(draft, each.name) not in (None, getattr(law, each.name))
    ]
    return law, left


def _draft(file: Path) -> Draft:
    if not file.is_file():
        raise LawError(f"--observe {file}: give all, imu, or a file that is there")
    match file.suffix:
        case ".toml":
            return read_law_toml(file)
        case ".json":
            return read_own(file)
        case ".pt":
            law = load_policy(file).info.env.law
            if law is None:
                raise LawError(f"{file} sees all there is: leave --observe out")
            return draft_of(law, str(file))
    raise LawError(
        f"--observe {file}: what is seen is said by a TOML as `gaitpref policy import "
        "FILE --explain` prints, a policy.json or a policy.pt"
    )
