"""What is thrown at the labeling page: requests, handshakes and messages."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import msgspec
from viser import _messages

from benchmarks.visitor import CAMERA

MARK = "mark-of-an-attacker"
"""Stands in every hostile message; nobody else's page may ever be sent it."""
_BODY = b"\r\nContent-Type: application/x-www-form-urlencoded\r\n"
_POST = b"POST /login HTTP/1.1\r\nHost: HOST\r\nOrigin: http://HOST" + _BODY
_GET = b"GET / HTTP/1.1\r\nHost: HOST\r\n"
_KEY = b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
_UPGRADE = _GET + b"Upgrade: websocket\r\nConnection: Upgrade\r\n"

REQUESTS: dict[str, bytes] = {
    "no host": b"GET / HTTP/1.1\r\n\r\n",
    "two hosts": _GET + b"Host: evil.example\r\n\r\n",
    "foreign host": b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n",
    "host with a path": b"GET / HTTP/1.1\r\nHost: HOST/x\r\n\r\n",
    "absolute address": b"GET http://evil.example/ HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "proxy to elsewhere": b"CONNECT evil.example:443 HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "unknown method": b"BREW / HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "delete": b"DELETE / HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "trace": b"TRACE / HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "HTTP/0.9": b"GET /\r\n\r\n",
    "HTTP/2 preface": b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    "HTTP/9.9": b"GET / HTTP/9.9\r\nHost: HOST\r\n\r\n",
    "TLS hello": bytes.fromhex("16030100a5010000a10303") + bytes(160),
    "SSH hello": b"SSH-2.0-OpenSSH_9.9\r\n",
    "bytes of nothing": b"\x00" * 4096,
    "line feeds": b"\n" * 4096,
    "long address": b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "long header": _GET + b"X: " + b"a" * 100_000 + b"\r\n\r\n",
    "many headers": _GET + b"".join(b"X%d: 1\r\n" % n for n in range(5000)) + b"\r\n",
    "header without a name": _GET + b": x\r\n\r\n",
    "folded header": _GET + b"X: a\r\n b\r\n\r\n",
    "NUL in a header": _GET + b"X: a\x00b\r\n\r\n",
    "lone carriage return": _GET + b"X: a\rSet-Cookie: b\r\n\r\n",
    "way out of the folder": b"GET /../../etc/passwd HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "coded way out": b"GET /%2e%2e/%2e%2e/etc/passwd HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "NUL in the address": b"GET /%00 HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "newline in the address": b"GET /%0d%0aX:y HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "range of the page": _GET + b"Range: bytes=0-99999999999\r\n\r\n",
    "length and chunks": _POST
    + b"Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "negative length": _POST + b"Content-Length: -1\r\n\r\n",
    "endless length": _POST + b"Content-Length: 99999999999999999999\r\n\r\n",
    "two lengths": _POST + b"Content-Length: 1\r\nContent-Length: 2\r\n\r\nab",
    "chunk of no size": _POST + b"Transfer-Encoding: chunked\r\n\r\nzz\r\n\r\n",
    "huge chunk": _POST + b"Transfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n",
    "unknown coding": _POST + b"Transfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n",
    "form over the limit": _POST + b"Content-Length: 65536\r\n\r\n" + b"a" * 65536,
    "thousand fields": _POST + b"Content-Length: 2000\r\n\r\n" + b"a&" * 1000,
    "expectation": _POST + b"Expect: 100-continue\r\nContent-Length: 7\r\n\r\n",
    "unknown expectation": _POST + b"Expect: coffee\r\nContent-Length: 0\r\n\r\n",
    "logout by a link": b"GET /logout HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "post without an origin": b"POST /logout HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "two cookies": _GET + b"Cookie: a=b; a=c\r\nCookie: a=d\r\n\r\n",
    "long cookie": _GET + b"Cookie: a=" + b"b" * 8000 + b"\r\n\r\n",
    "socket without a key": _UPGRADE + b"Origin: http://HOST\r\n\r\n",
    "socket of version 0": _UPGRADE + _KEY + b"Sec-WebSocket-Version: 0\r\n\r\n",
    "socket without an origin": _UPGRADE + _KEY + b"Sec-WebSocket-Version: 13\r\n\r\n",
    "upgrade to h2c": _GET + b"Connection: Upgrade\r\nUpgrade: h2c\r\n\r\n",
    "post that upgrades": _POST
    + b"Upgrade: websocket\r\nConnection: Upgrade\r\nContent-Length: 9\r\n\r\n",
    "thousand requests in a line": (_GET + b"\r\n") * 1000,
}
"""Bytes on a fresh connection; HOST stands for the server's own."""

HALF: dict[str, bytes] = {
    "silence": b"",
    "half a line": b"GET / HT",
    "half a header": _GET + b"X-Half: ",
    "half a form": _POST + b"Content-Length: 100\r\n\r\ntoken=",
    "half a chunk": _POST + b"Transfer-Encoding: chunked\r\n\r\n64\r\ntok",
    "half a handshake": _UPGRADE,
}
"""What 300 connections send, and then wait."""


def _filled(kind: Any) -> dict[str, Any]:
    """A message of viser with something in every field."""
    plain: dict[str, Any] = {"int": 1, "float": 1.0, "bool": True, "str": MARK}
    fields = {
        field.name: plain.get(str(field.type), MARK)
        for field in dataclasses.fields(kind)
        if field.init
    }
    return fields | {"type": kind.__name__}


OURS = ("ViewerCameraMessage", "GuiUpdateMessage", "CommandTriggerMessage")
FOREIGN: dict[str, bytes] = {
    kind.__name__: msgspec.msgpack.encode(_filled(kind))
    for kind in _messages.Message.get_subclasses()
    if kind.__name__ not in OURS
}
"""Every message viser knows and the page does not send."""


def _camera(**changes: Any) -> bytes:
    return msgspec.msgpack.encode(CAMERA | changes)


def _update(uuid: Any = MARK, **updates: Any) -> bytes:
    return msgspec.msgpack.encode(
        {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}
    )


def _nested(depth: int) -> bytes:
    return b"\x91" * depth + b"\xc0"


WRONG: dict[str, bytes | str] = {
    "nothing": b"",
    "text": '{"type": "CommandTriggerMessage", "uuid": "x"}',
    "JSON": b'{"type": "CommandTriggerMessage", "uuid": "x"}',
    "ones": b"\xff" * 100,
    "half a map": _camera()[:-5],
    "two messages": _camera() * 2,
    "ten thousand lists": _nested(10_000),
    "a million lists": _nested(1_000_000),
    "map of 4 billion": b"\xdf\xff\xff\xff\xff",
    "text of 4 billion": b"\xdb\xff\xff\xff\xff" + b"a" * 100,
    "text that is no UTF-8": b"\x82\xa4type\xa3\xff\xfe\xfd\xa4uuid\xa1x",
    "pickle": b"\x80\x04cos\nsystem\n(S'true'\ntR.",
    "extension type": b"\xc7\x05\x01hello",
    "no type": msgspec.msgpack.encode({"uuid": MARK}),
    "type that is a number": msgspec.msgpack.encode({"type": 7}),
    "type with a path": msgspec.msgpack.encode({"type": "../Message"}),
    "type of the base": msgspec.msgpack.encode({"type": "Message"}),
    "private type": msgspec.msgpack.encode({"type": "_GuiUpdateMessage"}),
    "camera that is nowhere": _camera(position=(math.nan, 0.0, 0.0)),
    "camera that is infinite": _camera(look_at=(math.inf, 0.0, 0.0)),
    "camera of 1e300": _camera(far=1e300),
    "camera of two numbers": _camera(position=(0.0, 1.0)),
    "camera of a thousand": _camera(position=(0.0,) * 1000),
    "camera of text": _camera(wxyz="1000"),
    "screen below nothing": _camera(image_width=-1),
    "screen of a billion": _camera(image_width=10**9),
    "screen of 1e30": _camera(image_height=1e30),
    "screen of half a pixel": _camera(image_height=0.5),
    "camera with more": _camera(owner=MARK),
    "camera without a place": msgspec.msgpack.encode(
        {key: value for key, value in CAMERA.items() if key != "position"}
    ),
    "callback set": _update(update_cb=[]),
    "element hidden": _update(visible=False),
    "value and more": _update(value=True, visible=False),
    "no value": _update(),
    "value of nothing": _update(value=None),
    "value that is a list": _update(value=[1] * 1000),
    "value that is a map": _update(value={"a": 1}),
    "value of bytes": _update(value=b"x"),
    "value that is no number": _update(value=math.nan),
    "value without end": _update(value=-math.inf),
    "value of 1e300": _update(value=1e300),
    "element without a name": _update(uuid=None, value=True),
    "element that is a list": _update(uuid=[MARK], value=True),
    "element with a long name": _update(uuid=MARK * 100, value=True),
    "command without a name": msgspec.msgpack.encode({"type": OURS[2]}),
    "command that is a number": msgspec.msgpack.encode({"type": OURS[2], "uuid": 1}),
    "command with more": msgspec.msgpack.encode(
        {"type": OURS[2], "uuid": MARK, "excluded_self_client": 1}
    ),
    "two megabytes": bytes(2**21),
}
"""Messages that no page sends; the sender's page is closed."""

UNKNOWN: dict[str, bytes] = {
    "camera without a screen": _camera(image_width=0, image_height=0),
    "button of nobody": _update(value=True),
    "text of nobody": _update(value=MARK * 1000),
    "number of nobody": _update(value=3.5),
    "command of nobody": msgspec.msgpack.encode({"type": OURS[2], "uuid": MARK}),
    "empty name": _update(uuid="", value=True),
    "far camera": _camera(position=(1e8, -1e8, 1e8)),
}
"""Messages that are spelled right and mean nothing: nothing happens."""
