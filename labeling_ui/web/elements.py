"""Whether a browser's message fits the element of the page that it is about."""

from __future__ import annotations

from typing import Literal

import viser
from viser import (
    GuiButtonGroupHandle,
    GuiButtonHandle,
    GuiDropdownHandle,
    GuiSliderHandle,
    GuiTextHandle,
)

from .browser_messages import Camera, Command, Message

Fit = Literal["fits", "late", "wrong"]
"""`late`: an honest page may send it about what has just changed or gone."""


def fit(gui: viser.GuiApi, message: Message) -> Fit:
    """Compare a message with what is on the page.

    viser would turn a value into the element's type and raise where that fails; its
    tables of elements are private, and nothing public asks for one.
    """
    if isinstance(message, Camera):
        return "fits"
    if isinstance(message, Command):
        return "fits" if message.uuid in gui._command_handle_from_uuid else "late"
    element = gui._gui_input_handle_from_uuid.get(message.uuid)
    value = message.updates.value
    match element:
        case None:
            return "late"
        case GuiButtonHandle():
            right = value is True
        case GuiButtonGroupHandle() | GuiDropdownHandle():
            right = value in element.options
        case GuiSliderHandle():
            if isinstance(value, bool | str):
                return "wrong"
            # Its end moves with the clips.
            return "fits" if element.min <= value <= element.max else "late"
        case GuiTextHandle():
            right = isinstance(value, str)
        case _:
            right = False
    return "fits" if right else "wrong"
