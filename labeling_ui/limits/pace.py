"""How much of something somebody may do: a bucket that fills by itself."""

from __future__ import annotations


class Bucket:
    """Room for `at_once` things, and for `per_s` more each second."""

    def __init__(self, *, per_s: float, at_once: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left = at_once
        self._last_s = self._calm_s = float("-inf")

    def wait_s(self, now_s: float) -> float:
        """Time until there is room for one; 0 if there is now."""
        self._fill(now_s)
        return max(0.0, (1.0 - self._left) / self._per_s)

    def take(self, now_s: float, cost: float = 1.0) -> None:
        """Use room; what is not there yet is owed."""
        self._fill(now_s)
        self._left -= cost

    def taken(self, now_s: float) -> bool:
        """Use room for one if there is some."""
        if self.wait_s(now_s) > 0.0:
            return False
        self.take(now_s)
        return True

    def pressed_s(self, now_s: float) -> float:
        """For how long it has been more than half used, without a pause."""
        self._fill(now_s)
        return now_s - self._calm_s

    def _fill(self, now_s: float) -> None:
        if now_s > self._last_s:
            grown = self._left + (now_s - self._last_s) * self._per_s
            self._left, self._last_s = min(grown, self._at_once), now_s
        if self._left >= self._at_once / 2:
            self._calm_s = now_s
