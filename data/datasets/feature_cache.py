"""Feature rows of the episodes used last, shared by the threads of a process."""

from __future__ import annotations

import threading
from collections import OrderedDict

import numpy as np

FEATURE_CACHE_BYTES = 256 * 2**20
"""Feature rows kept in memory; about 1,400 episodes of 500 steps."""


class FeatureCache:
    """Arrays by episode hash; the one not used for longest makes room."""

    def __init__(self) -> None:
        self._mutex = threading.Lock()
        self._arrays: OrderedDict[str, np.ndarray] = OrderedDict()
        self._bytes = 0

    def get(self, sha256: str) -> np.ndarray | None:
        """The rows of an episode, if they are still here."""
        with self._mutex:
            if sha256 in self._arrays:
                self._arrays.move_to_end(sha256)
            return self._arrays.get(sha256)

    def put(self, sha256: str, features: np.ndarray) -> None:
        """Keep the rows [T, F] of an episode."""
        with self._mutex:
            if sha256 not in self._arrays:
                self._arrays[sha256] = features
                self._bytes += features.nbytes
            while self._bytes > FEATURE_CACHE_BYTES:
                _, oldest = self._arrays.popitem(last=False)
                self._bytes -= oldest.nbytes
