"""How the page looks before anything is on it."""

from __future__ import annotations

import viser

BRAND_RGB = (28, 92, 190)
NEUTRAL_RGB = (73, 80, 87)
"""Of buttons that take no side."""
SIDE_RGBS = ((36, 96, 208), (245, 133, 26))
"""Of buttons for A, where white is read, and for B, where black is: near enough to the
robots' blue and orange, and far enough from the letters."""


def set_theme(gui: viser.GuiApi, *, dark: bool) -> None:
    """Light or dark, without viser's own buttons."""
    gui.configure_theme(
        dark_mode=dark,
        show_logo=False,
        show_share_button=False,
        brand_color=BRAND_RGB,
        control_width="medium",
    )
    gui.set_panel_label("gaitpref")
