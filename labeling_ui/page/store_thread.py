"""The thread that asks the data base: what is to be stored first, all of it at once.

Raters who answer at the same moment would wait for the disk one after the other. Here
everything that waits is stored, then the disk is waited for once, and only then is
each of them told.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

logger = logging.getLogger(__name__)

Work = Callable[[], None]


@dataclass(frozen=True, eq=False)
class _Store:
    """Something to be stored, and who is told what came of it."""

    act: Callable[[], Any]
    then: Callable[[Any], None]
    failed: Callable[[Exception], None]


class Worker:
    """Does one thing after the other; what stores goes before what only reads."""

    def __init__(self, together: Callable[[], AbstractContextManager[None]]) -> None:
        """Start the thread.

        Args:
            together: What is stored in this context is on the disk when it ends.
        """
        self._together = together
        self._waiting: queue.SimpleQueue[_Store | Work | None] = queue.SimpleQueue()
        self._told: deque[Work] = deque()
        self._reads: deque[Work] = deque()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="desk", daemon=True)
        self._thread.start()

    def submit(self, work: Work) -> None:
        """Have `work` done; what it raises ends up in the log."""
        self._waiting.put(work)

    def store(
        self,
        act: Callable[[], Any],
        then: Callable[[Any], None],
        failed: Callable[[Exception], None],
    ) -> None:
        """Have `act` store something.

        Args:
            then: Gets what `act` returned, once that is on the disk.
            failed: Gets what was raised instead, by `act` or by the disk.
        """
        self._waiting.put(_Store(act, then, failed))

    def stop(self) -> None:
        """Store what is waiting, tell nobody any more, and end."""
        self._waiting.put(None)
        self._thread.join()

    def _run(self) -> None:
        while not self._stopping:
            self.store_all(self._taken())
            if not self._stopping and (works := self._told or self._reads):
                logged(works.popleft())

    def _taken(self) -> list[_Store]:
        """What waits to be stored; waits itself where there is nothing to do."""
        stores: list[_Store] = []
        idle = not (self._told or self._reads)
        while idle or not self._waiting.empty():
            item = self._waiting.get()
            idle = False
            if item is None:
                self._stopping = True
            elif isinstance(item, _Store):
                stores.append(item)
            else:
                self._reads.append(item)
        return stores

    def store_all(self, stores: list[_Store]) -> None:
        tell: list[Work] = []
        try:
            if len(stores) > 1:
                with self._together():
                    tell = [_done(store) for store in stores]
            else:
                tell = [_done(store) for store in stores]
        except Exception as error:
            # The disk failed: nobody may count on anything.
            logger.exception("%d answers may not be on the disk", len(stores))
            tell = [_bound(store.failed, error) for store in stores]
        self._told.extend(tell)


def _done(store: _Store) -> Work:
    """Store it; gives what tells the result."""
    try:
        return _bound(store.then, store.act())
    except Exception as error:
        logger.exception("something could not be stored")
        return _bound(store.failed, error)


def _bound(tell: Callable[[Any], None], value: Any) -> Work:
    return lambda: tell(value)


def logged(work: Work) -> None:
    """Do `work`; what it raises ends up in the log."""
    try:
        work()
    except Exception:
        logger.exception("a task of the page failed")
