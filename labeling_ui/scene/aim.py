"""Whether a visitor's camera has to be put in its place again."""

from __future__ import annotations

import viser

from .scene import PairScene, aspect_of

_OTHER_ASPECT = 0.03
"""A window that becomes so much wider or narrower is looked at anew."""
_PUT_BACK = 2
"""How often a new page's camera is put in its place again."""


class Aim:
    """Follows one visitor's camera."""

    def __init__(self, scene: PairScene, camera: viser.CameraHandle) -> None:
        """The scene was looked at a moment ago."""
        self._scene = scene
        self._aspect, self._left = aspect_of(camera), _PUT_BACK

    def is_lost(self, camera: viser.CameraHandle) -> bool:
        """Whether to look again, now that the visitor's page says where it is."""
        aspect = aspect_of(camera)
        if abs(aspect / self._aspect - 1.0) > _OTHER_ASPECT:
            self._aspect = aspect
            return True
        if self._left and not self._scene.is_seen_as_set(camera):
            # viser's page puts its camera back once while it builds the scene.
            self._left -= 1
            return True
        return False
