"""What is installed: Python, the packages of every extra, and the versions tested."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import platform
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from .finding import Finding

_OURS = ("data", "gaitpref", "labeling_ui", "policy", "rewardmodel")
_HOME = Path(__file__).resolve().parents[2]
_LEAST_PYTHON = (3, 11)
_FOR_WHOM = {
    "train": "training, recording, the loop",
    "label": "the labeling page, `play`, `watch`",
    "fit": "fitting rewards alone",
    "film": "films as MP4",
    "gpu": "training on an NVIDIA GPU",
    "explain": "rewards of networks, shared among habits",
    "parquet": "Parquet files",
    "postgres": "answers in PostgreSQL",
    "remote": "data sets behind a URL",
    "s3": "data sets in S3",
    "view": "clips for Foxglove and Rerun",
    "logs": "logs of robots",
    "export": "data sets in formats of others",
    "onnx": "policies as ONNX",
    "scale": "many machines with Ray",
    "wandb": "curves in Weights & Biases",
}
"""What each extra is for; those for developers are left out."""


@dataclass(frozen=True)
class _Installed:
    """Packages by name: the version that is there, and the one that was tested."""

    here: Mapping[str, str]
    tested: Mapping[str, str]


def python_finding() -> Finding:
    """Whether this Python is new enough."""
    fits = sys.version_info >= _LEAST_PYTHON
    return Finding(
        name="Python",
        state="ok" if fits else "bad",
        told=f"{platform.python_version()} in {sys.prefix}",
        advice="" if fits else "make a new environment with Python 3.11 or newer",
        needed=True,
    )


def own_packages() -> Finding:
    """Whether the names that stand on the package index too are those of gaitpref."""
    strange = {
        name: found.origin
        for name in _OURS
        if (found := importlib.util.find_spec(name)) is not None
        and found.origin is not None
        and Path(found.origin).resolve().parent != _HOME / name
    }
    missing = [name for name in _OURS if importlib.util.find_spec(name) is None]
    if not strange and not missing:
        version = importlib.metadata.version("gaitpref")
        return Finding(
            name="gaitpref", state="ok", told=f"{version} in {_HOME}", needed=True
        )
    told = [f"`{name}` is {place}" for name, place in strange.items()]
    told += [f"`{name}` is not found" for name in missing]
    return Finding(
        name="gaitpref",
        state="bad",
        told="; ".join(told),
        advice="leave that directory, or uninstall the package of that name, and "
        f"install gaitpref again: pip install -e {_HOME} -c constraints.txt",
        needed=True,
    )


def package_findings() -> Iterator[Finding]:
    """The packages everybody needs, then those of each extra."""
    packages = _Installed(_here(), _tested())
    wanted = [*_requirements(importlib.metadata.requires("gaitpref") or ())]
    core = [need for need in wanted if _is_for(need, "")]
    yield _finding("packages", core, packages, extra="", needed=True)
    for extra, purpose in _FOR_WHOM.items():
        own = list(_of_extra(wanted, extra))
        yield _finding(f".[{extra}]", own, packages, extra=extra, purpose=purpose)


def _finding(
    name: str,
    wanted: list[Requirement],
    packages: _Installed,
    *,
    extra: str,
    purpose: str = "what every command needs",
    needed: bool = False,
) -> Finding:
    here = packages.here
    names = [canonicalize_name(need.name) for need in wanted]
    missing = [package for package in names if package not in here]
    wrong = [
        f"{package} {here[package]} where {need.specifier} is wanted"
        for package, need in zip(names, wanted, strict=True)
        if package in here and not _fits(need, here[package])
    ]
    others = [
        f"{package} {here[package]} (tested with {tested})"
        for package in dict.fromkeys(names)
        if package in here
        and (tested := packages.tested.get(package))
        and not _same(tested, here[package])
    ]
    told = [*wrong, *others]
    if missing:
        told.insert(0, f"not installed: {', '.join(dict.fromkeys(missing))}")
    state = "bad" if wrong else "missing" if missing else "ok"
    install = f"pip install -e '.[{extra}]'" if extra else "pip install -e ."
    return Finding(
        name=name,
        state=state,
        told=f"{purpose}: {'; '.join(told) or 'as tested'}",
        advice=f"{install} -c constraints.txt" if missing or wrong or others else "",
        needed=needed,
    )


def _requirements(lines: Iterable[str]) -> Iterator[Requirement]:
    for line in lines:
        try:
            yield Requirement(line)
        except InvalidRequirement:
            continue


def _of_extra(wanted: list[Requirement], extra: str) -> Iterator[Requirement]:
    """What an extra asks for, that of the extras it takes along included."""
    for need in wanted:
        if not _is_for(need, extra) or _is_for(need, ""):
            continue
        if canonicalize_name(need.name) == "gaitpref":
            for other in sorted(need.extras):
                yield from _of_extra(wanted, other)
        else:
            yield need


def _is_for(need: Requirement, extra: str) -> bool:
    return need.marker is None or need.marker.evaluate({"extra": extra})


def _fits(need: Requirement, version: str) -> bool:
    try:
        return need.specifier.contains(Version(version), prereleases=True)
    except InvalidVersion:
        return True


def _same(tested: str, here: str) -> bool:
    """Whether two versions differ at most in how they were built, as 2.13.0+cpu."""
    try:
        return Version(tested).public == Version(here).public
    except InvalidVersion:
        return tested == here


def _here() -> dict[str, str]:
    return {
        canonicalize_name(found.name): found.version
        for found in importlib.metadata.distributions()
        if found.name
    }


def _tested() -> dict[str, str]:
    """Versions in constraints.txt; none where gaitpref was built into a wheel."""
    path = _HOME / "constraints.txt"
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return {}
    pairs = (line.split(";")[0].strip().partition("==") for line in lines)
    return {canonicalize_name(name): version for name, equal, version in pairs if equal}
