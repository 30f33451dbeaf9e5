"""Which executor a command uses, and what each piece has of it."""

from __future__ import annotations

from policy.parallel.cores import cores

from .pieces import Executor, PieceError
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


def cores_each(pieces: int, *, jobs: int | None, ray: str | None) -> int:
    """Cores of each of so many pieces that run by what `choose_executor` gives.

    Those of this machine are shared by the pieces side by side. Of a cluster, whose
    machines differ, each has one.
    """
    if ray is not None:
        return 1
    here = cores()
    return max(1, here // max(1, min(pieces, here if jobs is None else jobs)))
