"""What no browser sends: every request is answered, none with a fault of ours."""

from __future__ import annotations

import asyncio
import gzip
import logging
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

import pytest
from aiohttp import web

from labeling_ui.web.tokens import TokenStore
from tests.helpers.labeling_visitor import house

FORM = b"application/x-www-form-urlencoded"
PART = b'--x\r\nContent-Disposition: form-data; name="token"'
SOCKET = {
    b"Upgrade": b"websocket",
    b"Connection": b"Upgrade",
    b"Sec-WebSocket-Key": b"dGhlIHNhbXBsZSBub25jZQ==",
    b"Sec-WebSocket-Version": b"13",
    b"Sec-WebSocket-Protocol": b"viser-v1.1.1",
}
Request = tuple[bytes, bytes, dict[bytes, bytes], bytes]
"""Method, path, headers and body."""


def cookies() -> Iterable[Request]:
    """`PORT` stands for the port of the page."""
    for value in (
        b"\xff",
        b"ada.9999999999.\xff",
        b"ada.9999999999.\xc3\xa4",
        b"\xff.9999999999.x",
        b"ada." + b"9" * 5000 + b"." + b"0" * 64,
        "ada.٣٣٣٣٣٣٣٣٣٣.".encode() + b"0" * 64,
        b"ada.9999999999." + b"0" * 64,
        b'"ada.9999999999.\\377"',
        b"a=b;" * 1000,
        b"; ; =; \x01",
    ):
        yield b"GET", b"/", {b"Cookie": b"gaitpref-PORT=" + value}, b""
        yield b"GET", b"/", SOCKET | {b"Cookie": b"gaitpref-PORT=" + value}, b""


def origins() -> Iterable[Request]:
    for value in (
        b"http://[", b"http://]", b"http://[::1", b"http://a b", b"\xff", b"://", b"",
        b"http://\xe2\x84\x80.com", b"http://127.0.0.1:99999999",
        b"http://[" + b":" * 300,
    ):  # fmt: skip
        yield b"POST", b"/login", {b"Origin": value}, b"token=x"
        yield b"GET", b"/", SOCKET | {b"Origin": value}, b""
    yield b"POST", b"/login", {b"Origin": b"http://HOST\r\nOrigin: http://evil"}, b"x"


def hosts() -> Iterable[Request]:
    for value in (
        b"", b"\xff", b"[", b"[::1", b"[]", b"127.0.0.1:", b"127.0.0.1:\xd9\xa3", b"..",
        b"a" * 5000, b"%31", b"127.0.0.1, evil.example", b"[fe80::1%25lo]", b"127.1",
        b"2130706433", b"localhost.", b"user@localhost", b"HOST\r\nHost: evil",
    ):  # fmt: skip
        yield b"GET", b"/login", {b"Host": value}, b""


def forms() -> Iterable[Request]:
    multipart = (b"", b"; boundary=x", b"; boundary=", b"; boundary=" + b"b" * 200)
    charsets = (
        b"foo", b"utf-16", b"zlib", b"\0", b"idna", b"punycode", b"hex", b"undefined",
        b"\xff", b"unicode_escape",
    )  # fmt: skip
    kinds = [b"multipart/form-data" + boundary for boundary in multipart]
    kinds += [FORM + b"; charset=" + charset for charset in charsets]
    kinds += [FORM, b"application/json", b"\xff", b";", b"text/plain;;;=", b""]
    bodies = (
        b"token=abc", b"\xff\xfe\xfd", b"token=%ff%fe", PART + b"\r\n\r\nabc",
        b"--x\r\n\r\nabc\r\n--x--\r\n", b"&" * 16_000, b"token=a&" * 2000, b"\0" * 50,
        PART + b'; filename="a"\r\nContent-Transfer-Encoding: base64\r\n\r\n!\r\n--x--',
        PART + b"\r\nContent-Type: text/plain; charset=zlib\r\n\r\nabc\r\n--x--\r\n",
        b"token=%00", b"token=%ed%a0%80", b"", b"x" * 20_000,
    )  # fmt: skip
    for kind in kinds:
        for body in bodies:
            yield b"POST", b"/login", {b"Content-Type": kind}, body


def encodings() -> Iterable[Request]:
    bomb = gzip.compress(bytes(20_000_000))
    for name in (b"gzip", b"deflate", b"br", b"zstd", b"foo", b"\xff", b"gzip, gzip"):
        for body in (b"garbage", b"\x1f\x8b\x08\0\0\0\0\0\0\3garbage", bomb):
            headers = {b"Content-Type": FORM, b"Content-Encoding": name}
            yield b"POST", b"/login", headers, body
    for name in (b"foo", b"\xff", b"100-continue"):
        for path in (b"/login", b"/nothing"):
            yield b"POST", path, {b"Expect": name}, b"token=x"
    for name in (b"chunked", b"gzip, chunked", b"chunked, chunked", b"foo"):
        yield b"POST", b"/login", {b"Transfer-Encoding": name}, b"zz\r\n\r\n"
    for size in (b"1" + b"0" * 30, b"-1", b"x"):
        yield b"POST", b"/login", {b"Content-Length": size}, b"token=x"


def paths() -> Iterable[Request]:
    for path in (
        b"/%ff", b"/\xff", b"/?%ff=%ff", b"/?\xff", b"/?a=%0d%0aX: y", b"/?%00", b"//",
        b"/?" + b"a&" * 3000, b"/..", b"/%2e%2e", b"*", b"http://evil.example/", b"",
        b"http://[/", b"//[", b"/login;x", b"/?darkMode=%ff&x",
        b"/?darkMode=%ed%a0%80&x",
        b"/?initialCameraUp=%0d%0a&x", b"?", b"login", b"/a\0", b"http://a:99999999/",
        b"/?darkMode=%F0%9F%98%80&x=1",
    ):  # fmt: skip
        yield b"GET", path, {}, b""
    for method in (b"HEAD", b"TRACE", b"OPTIONS", b"PUT", b"CONNECT", b"FOO", b"F\xff"):
        yield method, b"/", {}, b""
        yield method, b"/login", {}, b""


def handshakes() -> Iterable[Request]:
    """Where nobody has to log in, so that all of it is looked at."""
    odd: dict[bytes, tuple[bytes, ...]] = {
        b"Sec-WebSocket-Protocol": (
            b"", b"viser-v", b"viser-v\xff", b"viser-v" + b"1" * 5000, b"viser-v 1",
            b"viser-v;", b'viser-v"x"', "viser-vä".encode(), b"viser-v\x7f",
            b"viser-v1.1.1, \xff", b"viser-v1," * 500,
        ),
        b"Sec-WebSocket-Key": (b"", b"x", b"\xff", b"\xc3\xa4" * 12, b"=" * 24),
        b"Sec-WebSocket-Version": (b"", b"0", b"\xff", b"9" * 100, b"13, 8"),
        b"Sec-WebSocket-Extensions": (
            b"permessage-deflate; server_max_window_bits=" + b"9" * 5000, b";;;",
            b"\xff",
        ),
        b"Upgrade": (b"h2c", b"\xff"),
        b"Accept-Encoding": (b"\xff", b"gzip;q=x", b"x" * 7000, b"gzip\x7f"),
    }  # fmt: skip
    for name, values in odd.items():
        for value in values:
            yield b"GET", b"/", SOCKET | {name: value}, b""
    for value in odd[b"Accept-Encoding"]:
        yield b"GET", b"/", {b"Accept-Encoding": value}, b""


async def answered(port: int, request: Request) -> bytes:
    """The first line of the answer; empty where the server hangs up."""
    method, path, given, body = request
    host = b"127.0.0.1:%d" % port
    headers = {b"Host": host, b"Origin": b"http://" + host} | given
    if body and not {b"Content-Length", b"Transfer-Encoding"} & set(headers):
        headers[b"Content-Length"] = b"%d" % len(body)
    lines = [method + b" " + path + b" HTTP/1.1"]
    lines += [name + b": " + value for name, value in headers.items()]
    text = b"\r\n".join(lines).replace(b"PORT", b"%d" % port).replace(b"HOST", host)
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(text + b"\r\n\r\n" + body)
        return (await asyncio.wait_for(reader.readline(), 30)).strip()
    except ConnectionError:
        return b""
    finally:
        writer.close()
        with suppress(ConnectionError):
            await writer.wait_closed()


async def viser_before(request: web.Request) -> web.StreamResponse:
    """What stands in for viser: it takes what the relay hands on."""
    if "Upgrade" not in request.headers:
        return web.Response(text="<head><script></script></head>the page")
    socket = web.WebSocketResponse(protocols=["viser-v1.1.1"])
    await socket.prepare(request)
    async for _ in socket:
        pass
    return socket


@pytest.mark.parametrize(
    "kind", [cookies, origins, hosts, forms, encodings, paths, handshakes]
)
def test_no_request_is_a_fault_of_ours(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    kind: Callable[[], Iterable[Request]],
) -> None:
    """It is refused, or does no harm; the log has a line of it, and no traceback."""
    caplog.set_level(logging.DEBUG)
    TokenStore(tmp_path).add("ada")
    requests = list(kind())

    async def scenario() -> list[bytes]:
        app = web.Application()
        app.router.add_get("/", viser_before)
        runner = web.AppRunner(app, shutdown_timeout=0.1)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        async with house(
            tmp_path,
            auth=kind is not handshakes,
            upstream_port=runner.addresses[0][1],
            login_failures_per_minute=10_000,
        ) as built:
            port = int(built.url.rpartition(":")[2])
            heads = [await answered(port, request) for request in requests]
            assert (await built.get("/healthz"))[0] == 200
        await runner.cleanup()
        return heads

    heads = asyncio.run(scenario())
    for request, head in zip(requests, heads, strict=True):
        assert not head.startswith((b"HTTP/1.0 5", b"HTTP/1.1 5")), request
        if request[0] == b"POST" and kind is not encodings:
            assert head.split()[1] in (b"400", b"401", b"403", b"413"), request
        if b"Cookie" in request[2]:
            assert head.split()[1] in (b"303", b"401", b"400"), request
    ours = [record for record in caplog.records if record.name.startswith("label")]
    theirs = [record for record in caplog.records if record.name == "aiohttp.server"]
    loud = [record for record in theirs if record.levelno >= logging.WARNING]
    assert not [record for record in (*ours, *loud) if record.exc_info]
    assert not [record for record in (*ours, *loud) if "\n" in record.getMessage()]
    if kind in (origins, hosts, forms):
        assert len([*ours, *loud]) <= len(requests)
