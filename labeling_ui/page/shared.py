"""What all pages of a server use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime

from labeling_ui.questions.rater_session import utc_now

from .page_access import Picture
from .store_thread import Worker


@dataclass(eq=False)
class Shared:
    """What all pages of a server use."""

    worker: Worker
    """Asks and stores, one thing after the other."""
    submit_late: Callable[[Callable[[], None]], None]
    """Has another worker do what nobody waits for."""
    wake: Callable[[], None]
    """Has the ticker handle what was posted at once."""
    guidelines: Callable[[], str]
    """What raters are told, as it is now."""
    picture: Picture | None = None
    """Tells what moved a reward about the last answer, where there is one."""
    has_names: bool = True
    """Whether raters log in; without, the name of who is there tells nobody a thing."""
    since_utc: datetime = field(default_factory=utc_now)
    """When the server started."""
    welcomed: set[str] = field(default_factory=set)
    """Raters who have seen the guidelines since the server started."""
