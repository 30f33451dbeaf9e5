"""What a policy says of itself: metadata in ONNX, or policy.json of this project."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from data.files.files import read_text
from data.files.limits import TEXT_BYTES
from data.files.plain import from_plain
from policy.law.law import Law, LawError

from .draft import Draft, robot_name, twelve
from .term_names import term_of

OWN_KEY = "policy.json"
"""The metadata that this project writes into its own ONNX."""


def of_metadata(metadata: Mapping[str, str]) -> Draft | None:
    """The law in the metadata of an ONNX file, ours or mjlab's; None without one.

    Raises:
        LawError: it has one that cannot be read.
    """
    if OWN_KEY in metadata:
        return of_own(metadata[OWN_KEY], "the ONNX's own metadata")
    if "joint_names" not in metadata or "observation_names" not in metadata:
        return None

    def numbers(key: str) -> Any:
        if key not in metadata:
            return None
        return twelve([_value(v) for v in _split(metadata[key])], key)

    names = _split(metadata["observation_names"])
    joints = _split(metadata["joint_names"])
    if len(joints) != 12:
        raise LawError(
            f"the metadata's joint_names must be 12 joints, got {len(joints)}: "
            "export the policy of a quadruped"
        )

    def of_terms(key: str) -> list[Any]:
        found = [
            _value(v) for v in _split(metadata.get(f"observation_terms_{key}", ""))
        ]
        return found if len(found) == len(names) else [None] * len(names)

    terms = tuple(
        term_of(name, scale=scale, clip=clip, frames=frames)
        for name, scale, clip, frames in zip(
            names,
            of_terms("scale"),
            of_terms("clip"),
            of_terms("history_length"),
            strict=True,
        )
    )
    return Draft(
        source="the ONNX's own metadata",
        joints=tuple(joints),
        terms=terms,
        newest_first=False,
        by_term=True,
        default_joint_pos_rad=numbers("default_joint_pos"),
        action_scale_rad=numbers("action_scale"),
        kp_nm_per_rad=numbers("joint_stiffness"),
        kd_nm_s_per_rad=numbers("joint_damping"),
        guessed={"torque_limit_nm": "those of the robot's model: the file says none"},
    )


def read_own(path: Path) -> Draft:
    """The law in a policy.json of this project.

    Raises:
        LawError: it is none.
    """
    try:
        text = read_text(path, TEXT_BYTES)
    except UnicodeDecodeError:
        raise LawError(f"{path}: it is no text") from None
    return of_own(text, str(path))


def of_own(text: str, source: str) -> Draft:
    """The law in the text of a policy.json.

    Raises:
        LawError: it is none, or one from before it named the law as a record.
    """
    try:
        told = json.loads(text)
        law = from_plain(Law, told["law_record"])
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise LawError(
            f"{source}: it names no law ({type(error).__name__}: {str(error)[:80]}); "
            "export the policy again"
        ) from None
    return replace(draft_of(law, source), robot=robot_name(told.get("robot")))


def draft_of(law: Law, source: str) -> Draft:
    """A whole law as a draft that leaves nothing open."""
    values = {name: getattr(law, name) for name in Law.__dataclass_fields__}
    return Draft(source=source, carried=True, **values)


def _split(text: str) -> list[str]:
    """Parts between commas that are in no brackets."""
    parts = re.findall(r"(?:[^,\[(]|[\[(][^\])]*)+", text)
    return [part.strip() for part in parts if part.strip()]


def _value(text: str) -> Any:
    """A number, a list of numbers, or None."""
    if text in ("None", "null", "none"):
        return None
    try:
        return json.loads(text.replace("(", "[").replace(")", "]"))
    except (ValueError, RecursionError):
        raise LawError(f"the metadata has {text[:40]!r} where a number is") from None
