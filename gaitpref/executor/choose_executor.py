"""Which executor a command uses."""

from __future__ import annotations

from .pieces import Executor, PieceError, cores
from .processes import Processes
from .ray_tasks import RayTasks


def choose_executor(*, jobs: int | None, ray: str | None) -> Executor:
    """Ray's tasks at the address `ray`, or else `jobs` processes, one a core by
    default.

    Raises:
        PieceError: both are given.
    """
    if ray is None:
        return Processes(workers=cores() if jobs is None else jobs)
    if jobs is not None:
        raise PieceError(
            "with --ray, the cluster's cores say how many run side by side: give no "
            "number of processes besides"
        )
    return RayTasks(address=ray)
