"""What one rater, or a stranger, can do to another rater: nothing."""

import asyncio
import logging
import ssl
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import aiohttp
import msgspec
import pytest
from aiohttp import web
from viser import _messages

from benchmarks import attack_page
from benchmarks.attacks.inputs import FOREIGN, WRONG
from benchmarks.visitor import Visitor
from benchmarks.walks import walking_dataset
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.limits import page_limits as limits
from labeling_ui.limits.pace import Bucket
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.rater_session import QueueCfg
from labeling_ui.web.browser_messages import NotOurs, read, spelled
from labeling_ui.web.log_limit import LOGGERS, LogLimit, limited_log
from labeling_ui.web.tokens import TokenStore
from labeling_ui.web.visitors import Departures
from labeling_ui.web.websocket_relay import (
    CLOSE_FLOOD,
    CLOSE_LOGGED_OUT,
    CLOSE_REPLACED,
)
from tests.helpers.labeling_visitor import CAMERA, close_code, house, open_socket, send
from tests.helpers.local_host import certificate

AT_ONCE = QueueCfg(guard=GuardCfg(min_shown_s=0, repeat_gap_s=0, same_verdict_s=0))


async def until(condition: Callable[[], bool], within_s: float = 30.0) -> None:
    """Wait; a busy machine takes long."""
    async with asyncio.timeout(within_s):
        while not condition():
            await asyncio.sleep(0.02)


def test_attacks_are_held() -> None:
    """A few inputs of each kind, on a real server with few open files."""
    # On a machine that does other things too, an answer takes longer.
    results = attack_page.main(attack_page.Options(quick=True, slow_s=2.0))
    assert [result for result in results if result.got_through] == []
    assert len({result.kind for result in results}) == 10
    assert len(results) >= 25


def test_of_thirty_pages_at_once_one_stays_and_none_after_a_revocation(
    tmp_path: Path,
) -> None:
    """Each of the others is told why, although most were still being opened."""
    dataset = walking_dataset(tmp_path / "set", pairs=2)
    tokens = TokenStore(tmp_path / "set")
    token = tokens.add("ada")

    async def scenario(url: str) -> None:
        jar = aiohttp.CookieJar(unsafe=True)
        async with aiohttp.ClientSession(cookie_jar=jar) as browser:
            headers = {"Origin": url}
            form = {"token": token}
            async with browser.post(f"{url}/login", data=form, headers=headers):
                pass
            opening = [open_socket(browser, url) for _ in range(30)]
            sockets = await asyncio.gather(*opening)
            for socket in sockets:
                with suppress(ConnectionError):
                    await send(socket, CAMERA)
            ending = [asyncio.create_task(close_code(socket)) for socket in sockets]
            await until(lambda: sum(not task.done() for task in ending) == 1)
            await asyncio.sleep(0.5)
            codes = [task.result() for task in ending if task.done()]
            assert codes == [CLOSE_REPLACED] * 29
            (last,) = [task for task in ending if not task.done()]
            tokens.revoke("ada")
            assert await asyncio.wait_for(last, 3.0) == CLOSE_LOGGED_OUT

    with LabelServer(dataset, LabelCfg(port=0)) as server:
        asyncio.run(scenario(server.url))


@pytest.mark.parametrize("way", ["revoked", "logged out", "replaced"])
def test_a_page_ends_that_is_only_being_opened(tmp_path: Path, way: str) -> None:
    """viser takes its time with the handshake; meanwhile the rater is out."""

    async def scenario() -> None:
        reached = asyncio.Event()

        async def slow(request: web.Request) -> web.StreamResponse:
            reached.set()
            await asyncio.sleep(60)
            raise AssertionError

        app = web.Application()
        app.router.add_get("/", slow)
        runner = web.AppRunner(app, shutdown_timeout=0.1)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        port = runner.addresses[0][1]
        token = TokenStore(tmp_path).add("ada")
        async with house(tmp_path, upstream_port=port) as built:
            await built.login(token)
            (cookie,) = built.browser.cookie_jar
            kept = {"Cookie": f"{cookie.key}={cookie.value}"}
            opening = asyncio.create_task(built.enter())
            await reached.wait()
            again: asyncio.Task[Any] | None = None
            if way == "revoked":
                built.tokens.revoke("ada")
            elif way == "logged out":
                headers = {"Origin": built.url}
                await built.browser.post(f"{built.url}/logout", headers=headers)
            else:
                again = asyncio.create_task(built.enter())
            expected = CLOSE_REPLACED if way == "replaced" else CLOSE_LOGGED_OUT
            socket = await asyncio.wait_for(opening, 3.0)
            assert await close_code(socket) == expected
            if again is not None:
                again.cancel()
            else:
                assert await built.knock(**kept) == 401, "nor with the old cookie"
                if way == "logged out":
                    assert await built.login(token) == 303, "but by logging in"
                    assert (await built.get("/login"))[0] == 303
        await runner.cleanup()

    asyncio.run(scenario())


def test_no_answer_follows_a_revocation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not even while the page is still open: it is asked where the answer is stored."""
    monkeypatch.setattr(limits, "WATCH_S", 3600.0)
    dataset = walking_dataset(tmp_path / "set", pairs=5)
    tokens = TokenStore(tmp_path / "set")
    token = tokens.add("ada")

    async def scenario(url: str) -> None:
        visitor = Visitor(url, token)
        page = asyncio.create_task(visitor.run())
        await visitor.until_moving()
        await visitor.press("Close the dialog")
        await visitor.press("A better")
        await visitor.until_answered(1)
        tokens.revoke("ada")
        for command in ("A better", "Undo", "B better"):
            await visitor.press(command)
        await until(lambda: any("logged out" in t for t in visitor.texts.values()))
        page.cancel()

    with LabelServer(dataset, LabelCfg(port=0, queue=AT_ONCE)) as server:
        asyncio.run(scenario(server.url))
    with dataset.answers() as store:
        assert store.count() == 1


def test_a_flood_is_slowed_and_closed_and_a_fast_hand_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A held key and a camera that moves at 60 Hz go on for longer than a flood may."""
    monkeypatch.setattr(limits, "FLOOD_S", 0.5)
    dataset = walking_dataset(tmp_path / "set", pairs=3)

    async def scenario(url: str) -> None:
        visitor = Visitor(url, None)
        page = asyncio.create_task(visitor.run())
        await visitor.until_moving()
        await visitor.press("Close the dialog")
        begin = time.monotonic()
        for number in range(180):
            await visitor._send(CAMERA)
            if number % 2:
                await visitor.press("Step on")
            await asyncio.sleep(max(0.0, begin + number / 60 - time.monotonic()))
        await visitor.press("A better")
        await visitor.until_answered(1)
        assert not page.done()
        sent = 0
        with suppress(ConnectionError):
            while not page.done() and sent < 100_000:
                await visitor.press("Step on")
                # A send that need not wait lets nothing else run, and a goodbye that
                # is never read cannot be known.
                await asyncio.sleep(0)
                sent += 1
        await asyncio.wait_for(page, 10.0)
        assert visitor.close_code == CLOSE_FLOOD

    with LabelServer(dataset, LabelCfg(port=0, auth=False, queue=AT_ONCE)) as server:
        asyncio.run(scenario(server.url))


HALF = {
    "nothing": b"",
    "half a header": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ",
    "half a form": b"POST /login HTTP/1.1\r\nHost: HOST\r\nOrigin: http://HOST\r\n"
    b"Content-Length: 99\r\n\r\ntoken=",
    "half a form of a socket": b"POST /login HTTP/1.1\r\nHost: HOST\r\n"
    b"Origin: http://HOST\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Content-Length: 99\r\n\r\ntoken=",
}


@pytest.mark.parametrize("half", HALF)
def test_what_is_sent_by_half_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, half: str
) -> None:
    """However slowly the rest trickles in."""
    monkeypatch.setattr(limits, "REQUEST_S", 0.5)
    TokenStore(tmp_path).add("ada")

    async def scenario() -> None:
        async with house(tmp_path) as built:
            host = built.url.removeprefix("http://")
            address, _, port = host.partition(":")
            reader, writer = await asyncio.open_connection(address, int(port))
            writer.write(HALF[half].replace(b"HOST", host.encode()))

            async def trickle() -> None:
                with suppress(ConnectionError):
                    while half != "nothing":
                        await asyncio.sleep(0.1)
                        writer.write(b"x")
                        await writer.drain()

            trickling = asyncio.create_task(trickle())
            with suppress(ConnectionError):
                await asyncio.wait_for(reader.read(), 8.0)
            trickling.cancel()
            writer.close()

    asyncio.run(scenario())


@pytest.mark.parametrize("tls", [False, True])
def test_silent_connections_keep_nobody_out(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    tls: bool,
) -> None:
    """The oldest goes for the newest, also before it agreed on an encryption."""
    monkeypatch.setattr(limits, "WAITING", 8)
    token = TokenStore(tmp_path).add("ada")
    cfg: dict[str, Any] = {}
    trust: Any = True
    if tls:
        cert, key = certificate(tmp_path)
        trust = ssl.create_default_context(cafile=str(cert))
        cfg = {"cert": cert, "key": key}

    async def scenario() -> None:
        async with house(tmp_path, host="localhost", **cfg) as built:
            port = int(built.url.rpartition(":")[2])
            silent = [
                await asyncio.open_connection("localhost", port) for _ in range(40)
            ]
            async with (
                aiohttp.ClientSession() as browser,
                browser.post(
                    f"{built.url}/login",
                    data={"token": token},
                    headers={"Origin": built.url},
                    ssl=trust,
                    allow_redirects=False,
                ) as response,
            ):
                assert response.status == 303
            first, _ = silent[0]
            with suppress(ConnectionError):
                assert await asyncio.wait_for(first.read(), 5.0) == b""
            for _, writer in silent:
                writer.close()

    with limited_log():
        asyncio.run(scenario())
    lines = [r for r in caplog.records if "silent" in r.getMessage()]
    assert 1 <= len(lines) <= limits.LOG_LINES_PER_MINUTE
    assert not [record for record in caplog.records if record.exc_info]


def test_a_rater_cannot_ask_for_pages_without_end(tmp_path: Path) -> None:
    """Figures take the processor from those who answer."""
    token = TokenStore(tmp_path).add("ada")

    async def scenario() -> None:
        async with house(tmp_path) as built:
            await built.login(token)
            asked = [built.get("/figures") for _ in range(60)]
            statuses = [status for status, _, _ in await asyncio.gather(*asked)]
            assert statuses.count(200) >= limits.REQUESTS_AT_ONCE
            assert set(statuses) == {200, 429}

    asyncio.run(scenario())


def test_the_log_says_how_much_it_leaves_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Twenty lines a minute from one place, and others beside."""
    now_s = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    limit = LogLimit()

    def line(number: int) -> logging.LogRecord:
        return logging.LogRecord("x", 30, "file", number, "hello %s", ("you",), None)

    assert sum(limit.filter(line(1)) for _ in range(100)) == 20
    assert limit.filter(line(2))
    now_s[0] = 61.0
    again = line(1)
    assert limit.filter(again)
    assert again.getMessage() == "hello you (80 such lines left out)"


def test_who_finds_no_place_is_told_when_one_becomes_free() -> None:
    """By how often one did in the last hour; a reload is no departure."""
    departures = Departures(since_s=0.0)
    assert departures.wait_s(100.0) is None
    departures.left(came_s=100.0, now_s=130.0)
    assert departures.wait_s(130.0) is None
    for now_s in (600.0, 900.0, 1200.0):
        departures.left(came_s=100.0, now_s=now_s)
    assert departures.wait_s(1200.0) == 400.0
    assert departures.wait_s(4600.0) == 3600.0
    assert departures.wait_s(9000.0) is None


def test_a_bucket_fills_by_itself() -> None:
    """It tells how long to wait, and for how long it has been pressed."""
    bucket = Bucket(per_s=10.0, at_once=4.0)
    assert [bucket.taken(0.0) for _ in range(5)] == [True] * 4 + [False]
    assert bucket.wait_s(0.0) == pytest.approx(0.1)
    assert bucket.wait_s(0.1) == pytest.approx(0.0)
    bucket.take(0.1, cost=10.0)
    assert bucket.wait_s(0.1) == pytest.approx(1.0)
    assert bucket.pressed_s(0.5) == pytest.approx(0.5)
    assert bucket.pressed_s(2.0) == 0.0
    assert [bucket.taken(99.0) for _ in range(5)] == [True] * 4 + [False]


@pytest.mark.parametrize(
    "message",
    [
        CAMERA | {"position": (1, 0, -3), "image_width": 1280},
        {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": True}},
        {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": 3}},
        {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": "ä\n😀"}},
        {"type": "CommandTriggerMessage", "uuid": "a"},
    ],
)
def test_what_the_page_says_reaches_viser_as_it_was(message: dict[str, Any]) -> None:
    """Whole numbers come without a point, as browsers spell them."""
    packed = msgspec.msgpack.encode(message)
    told = _messages.Message.deserialize(spelled(read(packed)))
    assert told == _messages.Message.deserialize(packed)


@pytest.mark.parametrize("name", [*FOREIGN, *WRONG])
def test_what_the_page_does_not_say_is_none_of_ours(name: str) -> None:
    """All that viser knows besides, and all that only looks like it."""
    data = FOREIGN.get(name, WRONG.get(name))
    with pytest.raises(NotOurs):
        read(data.encode() if isinstance(data, str) else data or b"")


def test_whatever_the_page_writes_to_the_log_is_limited() -> None:
    root = Path(limits.__file__).parents[1]
    writing = {
        ".".join(("labeling_ui", *path.relative_to(root).with_suffix("").parts))
        for path in root.rglob("*.py")
        if "getLogger(__name__)" in path.read_text()
    }
    assert writing == {name for name in LOGGERS if name.startswith("labeling_ui")}
