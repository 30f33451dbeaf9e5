"""`gaitpref train --actors N`: who collects, and where."""

from __future__ import annotations

from data.errors import GaitprefError
from gaitpref.cli.options import options
from gaitpref.cli.shared.training_command import refuse_unasked
from gaitpref.console.extras import require
from policy.engines.actors_cfg import ActorsCfg
from policy.parallel.ranks import Ranks


def actors_of(command: options.Train, ranks: Ranks) -> ActorsCfg | None:
    """The actors that collect; None where this process does.

    Raises:
        GaitprefError: two ways to use many cores at once, or Ray is not installed.
    """
    if command.actors is None:
        names = ("ray", "update", "most_lag")
        refuse_unasked(command, names, "is about actors: give --actors N")
        return None
    if ranks.size > 1:
        raise GaitprefError(
            "--actors has one process that learns: start it without torchrun, or "
            "leave --actors out"
        )
    require("ray", "scale")
    return ActorsCfg(
        actors=command.actors,
        update=command.update,
        address=command.ray,
        most_lag=command.most_lag,
    )
