"""The simulator a command asks for."""

from __future__ import annotations

from gaitpref.cli.options import options
from gaitpref.cli.options.sweep_options import Looping
from gaitpref.console.progress import console
from policy.sim.making import SimCfg


def sim_of(command: options.Train | Looping) -> SimCfg | None:
    """Where the command trains; None is the processor's threads.

    Raises:
        SimError: device and simulator do not go together.
    """
    cfg = SimCfg(device=command.device, kind=command.sim)
    return cfg if cfg.on_warp else None


def require_sim(cfg: SimCfg | None) -> None:
    """See that it is there before anything else is done, and say what it costs.

    Raises:
        SimError: there is no GPU, or a package is not installed.
    """
    if cfg is None:
        return
    cfg.require()
    console.print(
        "MuJoCo Warp compiles its kernels the first time it runs on a machine, which "
        "takes some minutes"
    )
