"""The panel below the robots: the clock, the footfalls and, on request, the curves."""

from __future__ import annotations

import viser

from labeling_ui.scene.clip_motion import Motion

from .controls import CLOCK_BUTTONS, FLOATING_PX, Post, posts_value
from .footfall_svg import curve_playheads, curves, footfalls, playhead
from .playback import Playback
from .shortcuts import SHORTCUTS

_ECHO_S = 0.2
_SLIDER_REST_S = 0.6


class Transport:
    """Clock controls of one client."""

    def __init__(self, client: viser.ClientHandle, post: Post) -> None:
        gui = client.gui
        self._panel = gui.add_panel()
        with self._panel.add_tab("Clock and footfalls"):
            self._playhead = gui.add_html("")
            self._strip = gui.add_html("")
            self._curve_heads = gui.add_html("", visible=False)
            self._curves = gui.add_html("", visible=False)
            self._slider = gui.add_slider("time, s", 0.0, 1.0, 0.01, 0.0)
            labels = tuple(SHORTCUTS[name].label for name in CLOCK_BUTTONS)
            self._buttons = gui.add_button_group("clock", labels)
        self._panel.float(x=12, y=-12, width=FLOATING_PX)
        names = dict(zip(labels, CLOCK_BUTTONS, strict=True))
        self._echo_in_s = 0.0
        self._aligned = 0

        @self._buttons.on_click
        async def _(event: viser.GuiEvent) -> None:
            post(names[event.target.value])

        self._slider.on_update(posts_value(post, "seek"))

    def fill(self, motions: tuple[Motion, Motion] | None, clock: Playback) -> None:
        """Draw for these clips."""
        if motions is None:
            self._strip.content = self._curves.content = self._playhead.content = ""
            return
        self._strip.content = footfalls(*motions, clock.duration_s)
        self._curves.content = (
            curves(*motions, clock.duration_s) if self._curves.visible else ""
        )
        if self._slider.max != clock.duration_s:
            self._slider.max = round(clock.duration_s, 2)
        self.align(clock)

    def align(self, clock: Playback) -> None:
        """Put the playhead where the clock is, and let it run as the clock does."""
        self._playhead.content = playhead(clock)
        if self._curves.visible:
            self._curve_heads.content = curve_playheads(clock)
        self._aligned = clock.replays
        if not clock.playing:
            # Nothing is drawn any more, so nothing else would let the slider follow.
            self._slider.value = round(clock.time_s, 2)

    def toggle_curves(self) -> None:
        """Show the curves, or hide them; call `fill` afterwards."""
        shown = not self._curves.visible
        self._curves.visible = self._curve_heads.visible = shown

    def rest(self) -> None:
        """Leave the slider alone while a hand is on it."""
        self._echo_in_s = _SLIDER_REST_S

    def tick(self, clock: Playback, elapsed_s: float) -> None:
        """Let the slider follow a few times a second, the playhead once a round."""
        if clock.replays != self._aligned:
            self.align(clock)
        self._echo_in_s -= elapsed_s
        if self._echo_in_s <= 0:
            self._echo_in_s = _ECHO_S
            self._slider.value = round(clock.time_s, 2)
