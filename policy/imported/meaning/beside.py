"""Where a policy's meaning is looked for: in its file, then in what lies beside it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

from policy.law.law import LawError

from .deploy_yaml import read_deploy
from .draft import Draft
from .env_yaml import activation_of, read_env
from .io_descriptors import read_descriptors
from .own_words import of_metadata, read_own
from .rl_sar import read_rl_sar

_POLICIES = (
    "exported/policy.onnx",
    "policy.onnx",
    "exported/policy.pt",
    "policy.pt",
    "checkpoints/body_latest.jit",
    "body_latest.jit",
)


def policy_file(path: Path) -> Path:
    """The file of a policy in a run directory: the newest checkpoint, else what was
    exported; a file is itself.

    Raises:
        LawError: there is none.
    """
    if not path.is_dir():
        return path
    numbered = [
        (int(match.group(1)), file)
        for file in path.glob("model_*.pt")
        if (match := re.fullmatch(r"model_(\d+)\.pt", file.name))
    ]
    if numbered:
        return max(numbered)[1]
    for name in _POLICIES:
        if (path / name).exists():
            return path / name
    files = [*path.glob("*.onnx"), *path.glob("*.pt")]
    if len(files) == 1:
        return files[0]
    names = ", ".join(sorted(file.name for file in files)[:6]) or "none"
    raise LawError(
        f"{path} holds no model_N.pt, and no one policy.onnx or policy.pt (found: "
        f"{names}); give the file itself"
    )


def meaning_of(
    file: Path,
    metadata: Mapping[str, str],
    joints: tuple[str, ...] | None = None,
    spelled: Mapping[str, str] | None = None,
) -> Draft | None:
    """The first law that is found: in the file, or beside it.

    Args:
        file: The policy.
        metadata: What it says of itself.
        joints: Their order, for what says numbers by name and no order.
        spelled: What the robot's model calls each of `JOINTS`, in its order.

    Raises:
        LawError: it cannot be read.
    """
    if (draft := of_metadata(metadata)) is not None:
        return draft
    try:
        return _beside(file, partial(read_env, joints=joints, spelled=spelled))
    except (TypeError, ValueError, LookupError, ArithmeticError, AttributeError) as bad:
        # Of another's file anything can be of any kind.
        told = " ".join(str(bad).split())[:160]
        raise LawError(
            f"what lies beside {file} has a value of the wrong kind ({told}): correct "
            "it, or move it away and say the law with --law"
        ) from None


def _beside(file: Path, read_env: Callable[[Path], Draft]) -> Draft | None:
    readers: tuple[tuple[str, Callable[[Path], Draft]], ...] = (
        ("deploy.yaml", read_deploy),
        ("IO_descriptors.yaml", read_descriptors),
        ("env.yaml", read_env),
    )
    for name, read in readers:
        for place in _places(file):
            if (place / name).is_file():
                return read(place / name)
    config, base = file.with_name("config.yaml"), file.parent.parent / "base.yaml"
    if config.is_file() and base.is_file():
        return read_rl_sar(config, base)
    own = file.with_name("policy.json")
    return read_own(own) if own.is_file() else None


def activation_beside(file: Path) -> str | None:
    """What an agent.yaml beside a checkpoint says of its activation."""
    for place in _places(file):
        if (place / "agent.yaml").is_file():
            return activation_of(place / "agent.yaml")
    return None


def _places(file: Path) -> Iterator[Path]:
    for folder in (file.parent, file.parent.parent):
        yield folder / "params"
        yield folder / "io_descriptors"
        yield folder
