"""The panel below the robots: the clock, the footfalls and, on request, the curves."""

from __future__ import annotations

import viser

from .actions import SHORTCUTS
from .controls import CLOCK_BUTTONS, Post, posts_value
from .motion import Motion
from .playback import Playback
from .strips import curves, footfalls

PANEL_HEIGHT_PX = 262
_WIDTH_PX = 900
_ECHO_S = 0.2
_SLIDER_REST_S = 0.6


class Transport:
    """Clock controls of one client."""

    def __init__(self, client: viser.ClientHandle, post: Post) -> None:
        gui = client.gui
        self._panel = gui.add_panel()
        with self._panel.add_tab("Clock and footfalls"):
            self._strip = gui.add_html("")
            self._slider = gui.add_slider("time, s", 0.0, 1.0, 0.01, 0.0)
            labels = tuple(SHORTCUTS[name].label for name in CLOCK_BUTTONS)
            self._buttons = gui.add_button_group("clock", labels)
            self._curves = gui.add_html("", visible=False)
        self._panel.float(x=12, y=-12, width=_WIDTH_PX)
        names = dict(zip(labels, CLOCK_BUTTONS, strict=True))
        self._curves_wanted = False
        self._echo_in_s = 0.0

        @self._buttons.on_click
        async def _(event: viser.GuiEvent) -> None:
            post(names[event.target.value])

        self._slider.on_update(posts_value(post, "seek"))

    def fill(self, motions: tuple[Motion, Motion] | None, clock: Playback) -> None:
        """Draw for these clips; also after the clock was paused, moved or changed."""
        if motions is None:
            self._strip.content = ""
            self._curves.content = ""
            return
        self._strip.content = footfalls(*motions, clock)
        if self._curves_wanted:
            self._curves.content = curves(*motions, clock)
        if self._slider.max != clock.duration_s:
            self._slider.max = round(clock.duration_s, 2)

    def toggle_curves(self) -> None:
        """Show the curves, or hide them; call `fill` afterwards."""
        self._curves_wanted = not self._curves_wanted
        self._curves.visible = self._curves_wanted

    def rest(self) -> None:
        """Leave the slider alone while a hand is on it."""
        self._echo_in_s = _SLIDER_REST_S

    def tick(self, clock: Playback, elapsed_s: float) -> None:
        """Let the slider follow, a few times a second."""
        self._echo_in_s -= elapsed_s
        if self._echo_in_s <= 0:
            self._echo_in_s = _ECHO_S
            self._slider.value = round(clock.time_s, 2)
