"""Who is connected, and who may still come in; knows nothing of sockets."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Hashable
from typing import Generic, TypeVar

V = TypeVar("V", bound=Hashable)
_MINUTE_S = 60.0
_HOUR_S = 3600.0
_MAX_KEPT = 10_000


class Visitors(Generic[V]):
    """The open connections of every rater."""

    def __init__(self, *, per_rater: int, in_all: int) -> None:
        self._per_rater = per_rater
        self._in_all = in_all
        self._raters: OrderedDict[V, str] = OrderedDict()

    def __len__(self) -> int:
        return len(self._raters)

    def enter(self, visitor: V, rater: str) -> list[V] | None:
        """Let a visitor in.

        Returns:
            The rater's oldest visitors, who have to go: the newest window wins. None if
            the house is full, and the visitor is not in.
        """
        if not self.has_room(rater):
            return None
        own = self.of(rater)
        leaving = own[: max(0, len(own) + 1 - self._per_rater)]
        for gone in leaving:
            self.leave(gone)
        self._raters[visitor] = rater
        return leaving

    def has_room(self, rater: str) -> bool:
        """Whether a visitor of this rater would be let in."""
        leaving = max(0, len(self.of(rater)) + 1 - self._per_rater)
        return len(self) - leaving < self._in_all

    def leave(self, visitor: V) -> None:
        """Forget a visitor; harmless if nobody knows them."""
        self._raters.pop(visitor, None)

    def of(self, rater: str) -> list[V]:
        """A rater's visitors, the oldest first."""
        return [visitor for visitor, name in self._raters.items() if name == rater]

    def everybody(self) -> list[V]:
        """All visitors, the oldest first."""
        return list(self._raters)


class Departures:
    """How often a place in a full house becomes free."""

    def __init__(self, since_s: float) -> None:
        self._since_s = since_s
        self._times_s: deque[float] = deque(maxlen=_MAX_KEPT)

    def left(self, came_s: float, now_s: float) -> None:
        """A visitor is gone; who was there for a moment only is likely to be back."""
        if now_s - came_s >= _MINUTE_S:
            self._times_s.append(now_s)

    def wait_s(self, now_s: float) -> float | None:
        """Time between two places of the last hour that became free, in the mean; None
        where none did."""
        while self._times_s and now_s - self._times_s[0] > _HOUR_S:
            self._times_s.popleft()
        if not self._times_s:
            return None
        return min(now_s - self._since_s, _HOUR_S) / len(self._times_s)


class Attempts:
    """Failed logins of every address in the last minute."""

    def __init__(self, *, per_minute: int) -> None:
        self._per_minute = per_minute
        self._times_s: OrderedDict[str, deque[float]] = OrderedDict()

    def wait_s(self, address: str, now_s: float) -> float:
        """Time until this address may try again; 0 if it may now."""
        times_s = self._times_s.get(address, deque())
        while times_s and now_s - times_s[0] >= _MINUTE_S:
            times_s.popleft()
        if len(times_s) < self._per_minute:
            return 0.0
        return times_s[0] + _MINUTE_S - now_s

    def failed(self, address: str, now_s: float) -> None:
        """Count a failure."""
        self._times_s.setdefault(address, deque()).append(now_s)
        self._times_s.move_to_end(address)
        # Whoever has that many addresses must not fill the memory as well.
        while len(self._times_s) > _MAX_KEPT:
            self._times_s.popitem(last=False)


class Ended:
    """Logins that were ended before their time; the newest of very many."""

    def __init__(self) -> None:
        self._ids: OrderedDict[str, None] = OrderedDict()

    def __contains__(self, login: str) -> bool:
        return login in self._ids

    def add(self, login: str) -> None:
        """From now on this login is none."""
        self._ids[login] = None
        while len(self._ids) > _MAX_KEPT:
            self._ids.popitem(last=False)
