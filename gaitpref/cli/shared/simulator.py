"""The simulator a command asks for."""

from __future__ import annotations

from gaitpref.cli.options import options
from gaitpref.console.progress import console
from policy.sim.making import SimCfg


def sim_of(command: options.Train | options.Loop) -> SimCfg | None:
    """Where the command trains, seen to be there before anything else is done; None is
    the processor's threads.

    Raises:
        SimError: there is no GPU, or a package is not installed.
    """
    cfg = SimCfg(device=command.device, kind=command.sim)
    if not cfg.on_warp:
        return None
    cfg.require()
    console.print(
        "MuJoCo Warp compiles its kernels the first time it runs on a machine, which "
        "takes some minutes"
    )
    return cfg
