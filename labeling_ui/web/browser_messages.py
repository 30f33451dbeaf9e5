"""What a browser may say to viser; pure functions.

viser knows some forty messages that a client may send, and some of them it sends on to
everybody and keeps for ever. The page needs three.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec

_Uuid = Annotated[str, msgspec.Meta(max_length=64)]
_Pixels = Annotated[int, msgspec.Meta(ge=0, le=2**16)]
_Point = tuple[float, float, float]
_FARTHEST = 1e9


class NotOurs(Exception):
    """The page's client would not have sent this."""


class _Message(
    msgspec.Struct, frozen=True, tag_field="type", forbid_unknown_fields=True
):
    """A map with the name of its kind."""


class Camera(_Message, frozen=True, tag="ViewerCameraMessage"):
    """Where the visitor looks from; the first one says that the page is there."""

    wxyz: tuple[float, float, float, float]
    position: _Point
    fov: float
    near: float
    far: float
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Point
    up_direction: _Point


class Value(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The one property of an element that a hand changes."""

    value: bool | int | float | str


class Update(_Message, frozen=True, tag="GuiUpdateMessage"):
    """A button was pressed, a slider moved, a text changed."""

    uuid: _Uuid
    updates: Value


class Command(_Message, frozen=True, tag="CommandTriggerMessage"):
    """A hotkey was pressed."""

    uuid: _Uuid


Message = Camera | Update | Command
_decoder = msgspec.msgpack.Decoder(Message)
_encoder = msgspec.msgpack.Encoder()


def read(data: bytes) -> Message:
    """Read a message of a browser.

    Raises:
        NotOurs: it is none that the page sends.
    """
    try:
        message = _decoder.decode(data)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise NotOurs(str(error)) from None
    if not all(_is_sane(number) for number in _numbers(message)):
        raise NotOurs("a number is not finite, or too large")
    return message


def spelled(message: Message) -> bytes:
    """The message anew, so that viser reads what was checked, and nothing besides."""
    return _encoder.encode(message)


def _numbers(message: Message) -> tuple[float, ...]:
    if isinstance(message, Camera):
        lens = (message.fov, message.near, message.far)
        places = (*message.position, *message.look_at, *message.up_direction)
        return (*message.wxyz, *places, *lens)
    if isinstance(message, Update) and not isinstance(message.updates.value, str):
        return (message.updates.value,)
    return ()


def _is_sane(number: float) -> bool:
    return math.isfinite(number) and abs(number) <= _FARTHEST
