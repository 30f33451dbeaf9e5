"""What a stranger can do to a bare viser server, tried on the page: all of it fails."""

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aiohttp
import pytest
import viser

from labeling_ui.web.proxied import lock_down, new_secret, only_for, proxied_rater
from labeling_ui.web.tokens import TokenStore
from labeling_ui.web.websocket_relay import CLOSE_LOGGED_OUT, CLOSE_REPLACED
from tests.helpers.labeling_visitor import (
    House,
    close_code,
    first,
    house,
    open_socket,
    send,
)


@dataclass
class Page:
    """A real viser server whose page is a greeting and a button."""

    server: viser.ViserServer
    secret: str
    pressed: list[str] = field(default_factory=list)
    pressed_now: threading.Event = field(default_factory=threading.Event)

    @property
    def port(self) -> int:
        return self.server.get_port()

    def greet(self, client: viser.ClientHandle) -> None:
        rater = proxied_rater(self.server, client.client_id, self.secret)
        if rater is None:
            return
        client.gui.add_markdown(f"hello {rater}")
        button = client.gui.add_button(f"Better, says {rater}")

        @button.on_click
        def _(_: Any) -> None:
            self.pressed.append(rater)
            self.pressed_now.set()


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    secret = new_secret()
    with only_for(secret):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    lock_down(server)
    page = Page(server, secret)
    server.on_client_connect(page.greet)
    yield page
    server.stop()


@pytest.fixture(autouse=True)
def nothing_pressed(page: Page) -> None:
    page.pressed.clear()
    page.pressed_now.clear()


@asynccontextmanager
async def guarded(
    page: Page, root: Path, **cfg: Any
) -> AsyncIterator[tuple[House, str]]:
    """The proxy before the page, and ada's token."""
    token = TokenStore(root).add("ada")
    async with house(root, upstream_port=page.port, secret=page.secret, **cfg) as built:
        yield built, token


def is_greeting(message: dict[str, Any]) -> bool:
    return "hello" in str(message.get("props", {}).get("_markdown", ""))


def is_button(message: dict[str, Any]) -> bool:
    return message["type"] == "GuiButtonMessage"


def press(uuid: str) -> dict[str, Any]:
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": True}}


def test_a_rater_gets_the_page_and_its_button_works(page: Page, tmp_path: Path) -> None:
    """Without this, all the attacks would fail for nothing."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            assert await built.login(token) == 303
            status, text, headers = await built.get("/")
            assert status == 200
            assert "<title>gaitpref - " in text
            assert "eval'" not in headers["Content-Security-Policy"].replace(
                "'wasm-unsafe-eval'", ""
            )
            socket = await built.enter()
            button = await first(socket, is_button)
            assert button is not None
            assert button["props"]["label"] == "Better, says ada"
            await send(socket, press(button["uuid"]))
            assert await asyncio.to_thread(page.pressed_now.wait, 5.0)
            assert page.pressed == ["ada"]
            await socket.close()

    asyncio.run(scenario())


def test_without_a_login_there_is_nothing(page: Page, tmp_path: Path) -> None:
    """No page, no socket, no figures; only the form, the guidelines are inside too."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, _):
            assert await built.knock() == 401
            for path in ("/", "/figures", "/guidelines"):
                status, text, headers = await built.get(path)
                assert (status, headers["Location"], text) == (303, "/login", "")
            assert (await built.get("/login"))[0] == 200
            healthy = json.loads((await built.get("/healthz"))[1])
            assert (healthy["status"], healthy["here"]) == ("ok", False)

    asyncio.run(scenario())


@pytest.mark.parametrize("cookie", ["", "ada", "ada.9999999999.", "..", "ada.x.y", "ä"])
def test_a_made_up_cookie_opens_nothing(
    page: Page, tmp_path: Path, cookie: str
) -> None:
    """Neither nonsense nor a signature that is missing."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, _):
            port = built.url.rpartition(":")[2]
            assert await built.knock(Cookie=f"gaitpref-{port}={cookie}") == 401

    asyncio.run(scenario())


def test_a_cookie_cannot_be_altered_or_kept_for_ever(
    page: Page, tmp_path: Path
) -> None:
    """Another name, a later end, another server, two weeks later: all refused."""
    now_s = [1_000_000.0]

    async def scenario() -> None:
        async with guarded(page, tmp_path, now_s=lambda: now_s[0]) as (built, token):
            built.tokens.add("bob")
            await built.login(token)
            (cookie,) = built.browser.cookie_jar
            rater, expires, signature = cookie.value.split(".")
            built.browser.cookie_jar.clear()

            async def status_of(value: str) -> int:
                return await built.knock(Cookie=f"{cookie.key}={value}")

            assert await status_of(cookie.value) == 101
            assert await status_of(f"bob.{expires}.{signature}") == 401
            assert await status_of(f"{rater}.{int(expires) + 1}.{signature}") == 401
            now_s[0] += 14 * 86_400 + 1
            assert await status_of(cookie.value) == 401

    asyncio.run(scenario())


def test_the_cookie_is_out_of_reach_of_scripts_and_other_sites(
    page: Page, tmp_path: Path
) -> None:
    """HttpOnly, SameSite=Strict, for this port."""

    async def scenario() -> None:
        async with (
            guarded(page, tmp_path) as (built, token),
            built.browser.post(
                f"{built.url}/login",
                data={"token": token},
                headers={"Origin": built.url},
                allow_redirects=False,
            ) as response,
        ):
            cookie = response.headers["Set-Cookie"]
            assert "HttpOnly" in cookie
            assert "SameSite=Strict" in cookie
            assert token not in cookie
            assert response.headers["Location"] == "/"

    asyncio.run(scenario())


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "", "http://127.0.0.1:1", "file://"]
)
def test_other_sites_cannot_use_a_raters_browser(
    page: Page, tmp_path: Path, origin: str
) -> None:
    """Cross-site websockets and forms are refused, although the cookie is right."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            assert await built.knock() == 101
            assert await built.knock(Origin=origin) == 403
            for path in ("/login", "/logout"):
                async with built.browser.post(
                    built.url + path, data={"token": token}, headers={"Origin": origin}
                ) as response:
                    assert response.status == 403
            async with built.browser.post(f"{built.url}/logout") as response:
                assert response.status == 403, "no origin is none of ours"

    asyncio.run(scenario())


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("evil.example:8080", 403),
        ("127.0.0.1.evil.example", 403),
        ("localhost@evil.example", 400),
        ("a b", 400),
    ],
)
def test_a_foreign_name_for_this_machine_is_refused(
    page: Page, tmp_path: Path, host: str, status: int
) -> None:
    """DNS rebinding: the evil page's origin equals its host, but it is not ours."""

    async def scenario() -> None:
        async with guarded(page, tmp_path, auth=False) as (built, _):
            assert await built.knock(Host=host, Origin=f"http://{host}") == status
            assert (await built.get("/", Host=host))[0] == status
            port = built.url.rpartition(":")[2]
            name = f"localhost:{port}"
            assert await built.knock(Host=name, Origin=f"http://{name}") == 101

    asyncio.run(scenario())


@pytest.mark.parametrize(
    "query",
    [
        "websocket=ws://evil.example",
        "%77ebsocket=ws://evil.example",
        "playbackPath=http://evil.example/x.viser",
        "darkMode&websocket=ws://evil.example",
        "websocket=a&websocket=b",
        "anything=1",
    ],
)
def test_a_link_cannot_turn_the_page_to_a_foreign_server(
    page: Page, tmp_path: Path, query: str
) -> None:
    """The parameter is dropped, and the page could not connect there anyway."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            url = f"/?{query}"
            status, _, headers = await built.get(url)
            assert status == 303
            assert headers["Location"] in ("/", "/?darkMode=")
            status, _, headers = await built.get("/?darkMode=1&fixedDpr=0.5")
            assert status == 200
            policy = headers["Content-Security-Policy"]
            (connect,) = [p for p in policy.split("; ") if p.startswith("connect-src")]
            host = built.url.removeprefix("http://")
            allowed = f"connect-src 'self' data: blob: ws://{host} wss://{host}"
            assert connect == allowed
            assert "script-src-attr 'none'" in policy

    asyncio.run(scenario())


def test_the_page_has_one_address(page: Page, tmp_path: Path) -> None:
    """There is no other path by which its file, or a file beside it, comes out."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            for path in (
                "/index.html?websocket=ws://evil.example",
                "//evil.example/",
                "/%2e%2e/%2e%2e/etc/passwd",
                "/./index.html",
                "/static",
            ):
                status, text, _ = await built.get(path)
                assert status == 404, path
                assert "Viser" not in text

    asyncio.run(scenario())


def test_behind_the_proxy_nobody_is_let_in(page: Page, tmp_path: Path) -> None:
    """Another user, or a foreign web page, finds viser's port, and a closed door."""

    async def scenario() -> None:
        url = f"http://127.0.0.1:{page.port}"
        async with aiohttp.ClientSession() as browser:
            for headers in (
                {},
                {"X_Rater": "ada"},
                {"X_Rater": "ada", "X_Proxy_Secret": "x"},
                {"X_Rater": "ada", "X_Proxy_Secret": ""},
                {"X_Rater": "ada", "X_Proxy_Secret": page.secret + "x"},
                {"Upgrade": "WebSocket"},
            ):
                with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                    await open_socket(browser, url, **headers)
                assert refused.value.status == 403
            for path in ("/", "/index.html", "/nothing"):
                async with browser.get(url + path) as response:
                    assert response.status == 403
                    assert await response.read() == b""
        assert not page.server._websock_server._live_connections

    asyncio.run(scenario())


def test_a_rater_cannot_be_another(page: Page, tmp_path: Path) -> None:
    """Headers a browser sends are not passed on."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            built.tokens.add("bob")
            await built.login(token)
            socket = await built.enter(X_Rater="bob", X_Proxy_Secret=page.secret)
            greeting = await first(socket, is_greeting)
            assert greeting is not None
            assert "hello ada" in str(greeting)
            await socket.close()

    asyncio.run(scenario())


def test_a_rater_cannot_press_anothers_button(page: Page, tmp_path: Path) -> None:
    """Not even knowing its secret name."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            hers = await built.enter()
            button = await first(hers, is_button)
            assert button is not None
            assert await built.login(built.tokens.add("eve")) == 303
            mine = await built.enter()
            assert await first(mine, is_button) is not None
            await send(mine, press(button["uuid"]))
            update = {"type": "GuiUpdateMessage", "uuid": button["uuid"]}
            await send(mine, update | {"updates": {"update_cb": 0, "visible": False}})
            await asyncio.sleep(0.5)
            assert page.pressed == []
            await send(hers, press(button["uuid"]))
            assert await asyncio.to_thread(page.pressed_now.wait, 5.0)
            assert page.pressed == ["ada"], "her button still works"
            await hers.close()
            await mine.close()

    asyncio.run(scenario())


def test_nobody_can_open_a_public_tunnel(page: Page, tmp_path: Path) -> None:
    """A rater asks for it; no server outside is ever called."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            socket = await built.enter()
            assert await first(socket, is_button) is not None
            await send(socket, {"type": "ShareUrlRequest"})

            def is_answer(message: dict[str, Any]) -> bool:
                return message["type"] == "ShareUrlUpdated"

            answer = await first(socket, is_answer, within_s=2.0)
            assert answer is None or answer["share_url"] is None
            assert page.server._share_tunnel is None
            await socket.close()

    asyncio.run(scenario())


@pytest.mark.parametrize("garbage", [b"", b"\xff" * 100, b'{"type": "x"}', "text"])
def test_garbage_ends_only_the_connection_it_came_on(
    page: Page, tmp_path: Path, garbage: bytes | str
) -> None:
    """Others notice nothing."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            hers = await built.enter()
            button = await first(hers, is_button)
            assert button is not None
            await built.login(built.tokens.add("eve"))
            mine = await built.enter()
            if isinstance(garbage, str):
                await mine.send_str(garbage)
            else:
                await mine.send_bytes(garbage)
            assert await close_code(mine) in (1003, 1011)
            await send(hers, press(button["uuid"]))
            assert await asyncio.to_thread(page.pressed_now.wait, 5.0)
            await hers.close()

    asyncio.run(scenario())


def test_a_message_of_more_than_a_megabyte_is_refused(
    page: Page, tmp_path: Path
) -> None:
    """It is not even read to its end."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            socket = await built.enter()
            await socket.send_bytes(bytes(2**20 + 1))
            assert await close_code(socket) == 1009

    asyncio.run(scenario())


def test_the_newest_window_of_a_rater_wins(page: Page, tmp_path: Path) -> None:
    """So one rater cannot fill the house."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            old = await built.enter()
            assert await first(old, is_greeting) is not None
            new = await built.enter()
            assert await close_code(old) == CLOSE_REPLACED
            assert await first(new, is_greeting) is not None
            await new.close()

    asyncio.run(scenario())


def test_there_is_room_for_so_many(page: Page, tmp_path: Path) -> None:
    """The next one is told so, and may come in when somebody has left."""

    async def scenario() -> None:
        async with guarded(page, tmp_path, max_clients=2) as (built, token):
            sockets = []
            for name in ("bob", "cy"):
                await built.login(built.tokens.add(name))
                sockets.append(await built.enter())
            assert (await built.get("/"))[0] == 200, "whose page is open has a place"
            await built.login(token)
            status, text, headers = await built.get("/")
            assert status == 503
            assert "All 2 places are taken" in text
            assert "come back in half an hour" in text
            assert int(headers["Retry-After"]) == 1800
            assert await built.knock() == 503
            await sockets[0].close()
            await asyncio.sleep(0.2)
            assert (await built.get("/"))[0] == 200
            assert await built.knock() == 101
            await sockets[1].close()

    asyncio.run(scenario())


def test_tokens_cannot_be_guessed_quickly(page: Page, tmp_path: Path) -> None:
    """Ten wrong ones a minute; then not even the right one is looked at."""
    now_s = [1_000_000.0]

    async def scenario() -> None:
        async with guarded(page, tmp_path, now_s=lambda: now_s[0]) as (built, token):
            tries = [built.login(f"wrong{n}") for n in range(20)]
            statuses = await asyncio.gather(*tries)
            assert sorted(statuses) == [401] * 10 + [429] * 10
            assert await built.login(token) == 429
            now_s[0] += 59
            assert await built.login(token) == 429
            now_s[0] += 1
            assert await built.login(token) == 303

    asyncio.run(scenario())


def test_a_form_cannot_fill_the_memory(page: Page, tmp_path: Path) -> None:
    """Nor come as a file."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, _):
            file = aiohttp.FormData()
            file.add_field("token", b"x" * 10, filename="token.txt")
            for data in ({"token": "x" * 100_000}, file):
                async with built.browser.post(
                    f"{built.url}/login", data=data, headers={"Origin": built.url}
                ) as response:
                    assert response.status in (401, 413)

    asyncio.run(scenario())


def test_a_revoked_rater_is_thrown_out(page: Page, tmp_path: Path) -> None:
    """The open page is closed, and the cookie is worthless."""

    async def scenario() -> None:
        async with guarded(page, tmp_path) as (built, token):
            await built.login(token)
            socket = await built.enter()
            assert await first(socket, is_greeting) is not None
            built.tokens.revoke("ada")
            assert await close_code(socket) == CLOSE_LOGGED_OUT
            assert await built.knock() == 401
            assert await built.login(token) == 401

    asyncio.run(scenario())
