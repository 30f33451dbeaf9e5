"""A Ray that has the cores and the versions actors need."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from policy.parallel.cores import cores as own_cores
from policy.parallel.ray_connection import LOCAL, connected, is_connected

from .actors_cfg import ActorsCfg, ActorsError

_PACKAGES = ("gaitpref", "mujoco", "numpy", "ray", "rsl-rl-lib", "torch")


@contextmanager
def ray_for(cfg: ActorsCfg) -> Iterator[Any]:
    """The module `ray`, connected; what was started here ends with it.

    Raises:
        ActorsError: it has fewer cores than there are actors.
        RayError: nothing answers at the address, or its versions differ.
    """
    cores = cfg.cores or own_cores()
    if cfg.address in (None, LOCAL) and not is_connected():
        # Starting one takes seconds.
        _require_cores(cores, cfg)
    with connected(cfg.address or LOCAL, cores=cores) as ray:
        _require_cores(int(ray.cluster_resources().get("CPU", 0)), cfg)
        yield ray


def versions() -> dict[str, str]:
    """What must be the same on all machines, by name, as far as it is installed."""
    found = {"Python": platform.python_version()}
    for name in _PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def require_same_versions(
    ours: dict[str, str], theirs: dict[str, str], node: str
) -> None:
    """Go on only if a machine has the versions of the learner's.

    Raises:
        ActorsError: one differs.
    """
    for name, version in ours.items():
        if theirs.get(name) != version:
            raise ActorsError(
                f"{node} has {name} {theirs.get(name, 'not at all')}, the learner's "
                f"machine {version}: install the same on both, as with constraints.txt"
            )


def _require_cores(cores: int, cfg: ActorsCfg) -> None:
    if cfg.actors > cores:
        here = cfg.address in (None, LOCAL)
        where = "this machine" if here else f"the Ray at {cfg.address}"
        raise ActorsError(
            f"--actors {cfg.actors} needs as many cores, {where} has {cores}: give "
            f"--actors {max(cores, 1)}, or --ray with the address of a larger one"
        )
