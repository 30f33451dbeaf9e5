"""Options of `gaitpref arena`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from .bounds import Count, Seed
from .reward_options import Erring


@dataclass(frozen=True, kw_only=True)
class Arena:
    """Find out which of several policies people prefer, blind.

    Asks about two of them at a time, under the same command, where their order is most
    open, until it is sure at 95 %. People answer on the page of `gaitpref label`;
    started again, the same command counts their answers and asks on.
    """

    out: Path
    """Directory of the arena: data set, ranking.json and index.html."""
    policy: Annotated[list[str], tyro.conf.UseAppendAction]
    """NAME=FILE, twice or more."""
    criterion: str | None = None
    """Let a simulated rater answer, who looks for this, as `gaitpref answer` does."""
    erring: Erring = field(default_factory=Erring)
    most: Count = 60
    """Questions in all."""
    episodes: Count = 20
    """Episodes recorded of each policy."""
    open: bool = False
    """Open the page of the arena in this machine's browser."""
    seed: Seed = 0
    """Where all chance comes from."""
