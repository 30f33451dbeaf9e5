"""How the page looks before anything is on it."""

from __future__ import annotations

import viser

BRAND_RGB = (38, 112, 214)


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
