"""One thing that was looked at, and what it came to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["ok", "missing", "bad"]
"""`missing`: somebody may want it, and can do without. `bad`: it does not work as it is
or should be."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What was found of one thing."""

    name: str
    state: State
    told: str
    """What is there."""
    advice: str = ""
    """What to do where it is not `ok`."""
    needed: bool = False
    """Nobody can do without it."""

    @property
    def breaks(self) -> bool:
        """Whether nobody can work like this."""
        return self.needed and self.state != "ok"
