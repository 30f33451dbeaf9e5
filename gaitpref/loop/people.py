"""What the stages of the loop know of those who answer, and tell people."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gaitpref.programs.seen_pair import ProgramRater
from labeling_ui.page.loop_status import LoopStatus


@dataclass(frozen=True, kw_only=True)
class People:
    """Who answers at the page; by default nobody looks, and nobody is hurried."""

    patience_s: float = math.inf
    """How long a round waits for its answers before it goes on with what it has."""
    announce: Callable[[LoopStatus], None] = lambda status: None
    """Shows on the page what the loop is doing."""
    require_page: Callable[[], None] = lambda: None
    """Raises GaitprefError where nobody could answer any more."""
    program: ProgramRater | None = None
    """Answers in their place."""

    def tell(self, text: str, progress: float | None = None) -> None:
        """Say what the loop is doing, and how much of that is done, in [0, 1]."""
        self.announce(LoopStatus(text, progress))
