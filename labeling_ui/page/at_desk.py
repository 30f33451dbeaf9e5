"""What a page has done at the desk, by a worker, one thing after the other.

What may block is the worker's; what comes of it is posted to the page as an event.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from labeling_ui.limits.page_limits import ACTIONS_WAITING

from .controls import Post
from .page_access import Act, Desk, Look, Showing
from .store_thread import Worker

REFRESH_S = 1.0
"""How often the desk is asked whether something else is to be shown."""


class AtDesk:
    """Looks at a desk and stores there; posts `showing`, `idle`, `stored`, `failed`."""

    def __init__(
        self,
        desk: Desk,
        worker: Worker,
        submit_late: Callable[[Callable[[], None]], None],
        post: Post,
    ) -> None:
        """Work at `desk` for the page that `post` tells.

        Args:
            desk: Where questions and answers are.
            worker: Asks and stores.
            submit_late: Has another do what nobody waits for.
            post: Hands an event to the page.
        """
        self._desk, self._worker = desk, worker
        self._submit_late, self._post = submit_late, post
        self._busy = self._storing = False
        self._acts: deque[Act] = deque()
        # One of each at most waits for a worker that is busy with answers.
        self._look_waits = self._load_waits = False
        self._refresh_in_s = REFRESH_S

    def refresh(self, elapsed_s: float, shown: Showing | None, *, active: bool) -> None:
        """Look now and then whether something else than `shown` is on the desk."""
        self._refresh_in_s -= elapsed_s
        if self._refresh_in_s <= 0 and not (self._busy or self._look_waits):
            self._refresh_in_s = REFRESH_S
            self.look(
                lambda desk: (
                    desk.look() if shown is None else desk.changed(shown, active=active)
                )
            )

    def look(self, look: Look) -> None:
        """Have the worker look at the desk, and show what is new on it."""
        self._busy = self._look_waits = True

        def looked() -> None:
            self._look_waits = False
            self._seen(look)

        self._worker.submit(looked)

    def store(self, act: Act) -> None:
        """Have the worker store something, then show what came of it.

        One after the other, so that who sends thousands is one among others there.
        """
        if self._storing:
            if len(self._acts) < ACTIONS_WAITING:
                self._acts.append(act)
            return
        self._busy = self._storing = True
        self._worker.store(
            lambda: self._desk.act(act),
            lambda outcome: self._seen(lambda desk: desk.after(outcome), "stored"),
            lambda error: self._failed(),
        )

    def stored(self) -> None:
        """What was stored is shown: go on with what came meanwhile."""
        self._busy = self._storing = False
        if self._acts:
            self.store(self._acts.popleft())

    def idle(self) -> None:
        """A look is over."""
        self._busy = self._storing

    def _seen(self, look: Look, done: str = "idle") -> None:
        """Post what is on the desk, and have what comes next loaded."""
        try:
            showing = look(self._desk)
            if showing is not None:
                self._post("showing", showing)
                if not self._load_waits:
                    # Behind what others wait for.
                    self._load_waits = True
                    self._worker.submit(self._load_ahead)
        finally:
            self._post(done)

    def _load_ahead(self) -> None:
        self._load_waits = False
        pairs = self._desk.upcoming()
        self._submit_late(lambda: self._desk.load(pairs))

    def _failed(self) -> None:
        self._post("failed")
        self._post("stored")
