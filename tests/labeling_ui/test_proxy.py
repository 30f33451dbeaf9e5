"""The proxy's own pages, and when it refuses to start."""

import asyncio
import re
import shutil
import socket
import ssl
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from aiohttp import web

from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from gaitpref.cli.main import main
from labeling_ui.questions.rater_figures import figures
from labeling_ui.web.checks import address_block, host_name, is_loopback, same_origin
from labeling_ui.web.pages import LINK_SCRIPT, guidelines_page, login_page
from labeling_ui.web.tokens import TokenStore
from labeling_ui.web.visitors import Attempts, Visitors
from tests.helpers.labeling_visitor import PROTOCOL, house
from tests.helpers.local_host import certificate, free_port
from tests.labeling_ui.test_figures import row


def start(root: Path, **cfg: Any) -> str:
    """Start a proxy and stop it; gives its address."""

    async def scenario() -> str:
        async with house(root, **cfg) as built:
            return built.url

    return asyncio.run(scenario())


@pytest.mark.parametrize(
    ("cfg", "message"),
    [
        ({"host": "0.0.0.0"}, r"nobody could log in to 0\.0\.0\.0: .* add NAME"),
        ({"host": "127.0.0.1"}, r"add NAME` makes a token \(alone on this machine"),
        ({"host": "192.0.2.1", "auth": False}, "--no-auth would open the page"),
        ({"host": "", "auth": False}, "--no-auth would open the page"),
        ({"auth": False, "cert": Path("c")}, "--cert and --key belong together"),
        (
            {"auth": False, "cert": Path("c"), "key": Path("k")},
            "c and k cannot be used for TLS",
        ),
    ],
)
def test_an_unsafe_start_is_refused(
    tmp_path: Path, cfg: dict[str, Any], message: str
) -> None:
    """In one line that names the way out."""
    with pytest.raises(GaitprefError, match=message) as caught:
        start(tmp_path, **cfg)
    assert "\n" not in str(caught.value)


def test_a_busy_port_is_named(tmp_path: Path) -> None:
    """And no other one is taken silently."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(GaitprefError, match=f"port {port} on 127.0.0.1 cannot be"):
            start(tmp_path, port=port, auth=False)


def test_others_are_warned_of_a_page_in_clear(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Whoever is on the way can read the tokens; alone on the machine nobody is."""
    assert start(tmp_path, auth=False).startswith("http://127.0.0.1:")
    assert not caplog.records
    TokenStore(tmp_path).add("ada")
    start(tmp_path, host="0.0.0.0")
    assert "cross the network unencrypted" in caplog.text


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the key")
def test_the_page_is_served_over_tls(tmp_path: Path) -> None:
    """With a cookie that never goes out in clear."""
    cert, key = certificate(tmp_path)
    trust = ssl.create_default_context(cafile=str(cert))
    token = TokenStore(tmp_path).add("ada")

    async def scenario() -> None:
        async with (
            house(tmp_path, host="localhost", cert=cert, key=key) as built,
            aiohttp.ClientSession() as browser,
            browser.post(
                f"{built.url}/login",
                data={"token": token},
                headers={"Origin": built.url},
                ssl=trust,
                allow_redirects=False,
            ) as response,
        ):
            assert built.url.startswith("https://localhost:")
            assert response.status == 303
            cookie = response.headers["Set-Cookie"]
            assert cookie.startswith("__Host-gaitpref-")
            assert "Secure" in cookie

    asyncio.run(scenario())


def test_our_own_pages(tmp_path: Path) -> None:
    """Log in, read the guidelines, look at the figures, log out."""
    token = TokenStore(tmp_path).add("ada")
    guidelines = tmp_path / "guidelines.md"
    guidelines.write_text("# Look at the feet\n\n| a | b |\n|---|---|\n| 1 | 2 |\n")
    rows = [row("ada", n, 1.0, shown_ms=3000, second=10 * n) for n in range(4)]

    async def scenario() -> None:
        async with house(
            tmp_path,
            guidelines=guidelines,
            figures_of=lambda name: figures(rows, name),
        ) as built:
            status, text, headers = await built.get("/login")
            assert status == 200
            assert 'method="post"' in text
            assert re.findall("<script>(.*?)</script>", text, re.DOTALL) == [
                LINK_SCRIPT
            ]
            assert headers["X-Frame-Options"] == "DENY"
            assert headers["Server"] == "gaitpref"
            assert "default-src 'none'" in headers["Content-Security-Policy"]
            assert await built.login(f" {token}\n") == 303
            assert (await built.get("/login"))[0] == 303
            text = (await built.get("/guidelines"))[1]
            assert "<h1>Look at the feet</h1>" in text
            guidelines.write_text("Look at the *back*.")
            assert "<em>back</em>" in (await built.get("/guidelines"))[1]
            guidelines.unlink()
            assert "<em>back</em>" in (await built.get("/guidelines"))[1]
            guidelines.write_text("# Look at the feet")
            assert "<td>2</td>" in text
            guidelines.write_text("# Look at the hips")
            assert "hips" in (await built.get("/guidelines"))[1]
            text = (await built.get("/figures"))[1]
            for expected in ("ada", "360", "3.0 s", "100% of 4", "Log out"):
                assert expected in text
            async with built.browser.post(
                f"{built.url}/logout", headers={"Origin": built.url}
            ) as response:
                assert response.url.path == "/login"
            assert (await built.get("/figures"))[0] == 303
            assert (await built.get("/nothing"))[0] == 404

    asyncio.run(scenario())


def test_a_page_that_is_not_up_yet_is_said_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The socket is refused with a status, not with a traceback."""
    monkeypatch.setattr("labeling_ui.web.websocket_relay._REACH_S", 0.5)

    async def scenario() -> None:
        async with house(tmp_path, auth=False, upstream_port=free_port()) as built:
            assert await built.knock() == 502
            assert (await built.get("/"))[0] == 502

    asyncio.run(scenario())


def test_who_leaves_while_viser_is_reached_leaves_no_trace(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A browser gives up and tries again, as often as the machine is slow."""

    async def scenario() -> None:
        reached, go = asyncio.Event(), asyncio.Event()

        async def slow(request: web.Request) -> web.StreamResponse:
            reached.set()
            await go.wait()
            viser = web.WebSocketResponse(protocols=[PROTOCOL])
            await viser.prepare(request)
            async for _ in viser:
                pass
            return viser

        app = web.Application()
        app.router.add_get("/", slow)
        runner = web.AppRunner(app, shutdown_timeout=0.1)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        port = runner.addresses[0][1]
        async with house(tmp_path, auth=False, upstream_port=port) as built:
            knocking = asyncio.create_task(built.knock())
            await reached.wait()
            knocking.cancel()
            await asyncio.sleep(0.2)
            go.set()
            await asyncio.sleep(0.2)
            assert len(built.proxy._relay._visitors) == 0
        await runner.cleanup()

    asyncio.run(scenario())
    assert not [record for record in caplog.records if record.exc_info]


def test_who_comes_while_the_server_stops_is_told_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A browser tries again all the time, also between the last page and the port."""

    async def scenario() -> None:
        async with house(tmp_path, auth=False) as built:
            await built.proxy._relay.stop()
            assert await built.knock() == 502
            assert (await built.get("/"))[0] == 502

    asyncio.run(scenario())
    assert not [record for record in caplog.records if record.exc_info]


def test_a_file_that_breaks_meanwhile_is_no_traceback(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody is let in, the log says which file, and a mended one is read again."""
    token = TokenStore(tmp_path).add("ada")
    guidelines = tmp_path / "guidelines.md"
    guidelines.write_text("# Look")

    async def scenario() -> None:
        async with house(tmp_path, guidelines=guidelines) as built:
            assert await built.login(token) == 303
            guidelines.unlink()
            assert "<h1>Look</h1>" in (await built.get("/guidelines"))[1]
            tokens = built.tokens.path.read_bytes()
            built.tokens.path.write_text('{"key": "", "raters": {}}')
            assert await built.login(token) == 503
            assert await built.knock() == 503
            for path in ("/", "/figures", "/login"):
                status, text, _ = await built.get(path)
                assert (status, "tell whoever runs it" in text) == (503, True)
            built.tokens.path.write_bytes(tokens)
            assert await built.login(token) == 303

    asyncio.run(scenario())
    assert "raters.json cannot be used (its key is not" in caplog.text
    assert "guidelines.md" in caplog.text
    assert not [record for record in caplog.records if record.exc_info]


def test_the_login_page_names_a_command_that_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As it is written there, but for the names."""
    Dataset.create(tmp_path / "set")
    (command,) = re.findall("<code>gaitpref (.*?)</code>", login_page())
    words = command.replace("DIR", str(tmp_path / "set")).replace("NAME", "ada")
    assert main(words.split()) == 0
    token = capsys.readouterr().out.split()[0]
    assert TokenStore(tmp_path / "set").rater_of(token) == "ada"


def test_guidelines_cannot_bring_scripts() -> None:
    """HTML in the Markdown is shown as text, and links only lead to pages."""
    page = guidelines_page(
        "<script>alert(1)</script> <img src=x onerror=alert(1)> "
        "[x](javascript:alert(1)) [y](data:text/html,z)"
    )
    assert "<script" not in page
    assert "<img" not in page
    assert 'href="javascript' not in page
    assert 'href="data' not in page


def test_a_complaint_is_text() -> None:
    """Whatever it quotes."""
    assert "&lt;b&gt;" in login_page("<b>")


def test_hosts_origins_and_addresses() -> None:
    """The small decisions, one by one."""
    for host in ("localhost", "127.0.0.1", "127.9.9.9", "::1", "[::1]", "LOCALHOST"):
        assert is_loopback(host)
    for host in ("0.0.0.0", "::", "", "10.0.0.1", "lab", "localhost.evil.example"):
        assert not is_loopback(host)
    assert host_name("lab:8080") == "lab"
    assert host_name("[::1]:8080") == "[::1]"
    for host in ("", "a/b", "a@b", "a:b", "a b", "lab:8080:1"):
        assert host_name(host) is None
    assert same_origin("https://lab:8080", "LAB:8080")
    assert not same_origin("ftp://lab:8080", "lab:8080")
    assert not same_origin(None, "lab:8080")
    assert address_block("192.0.2.7") == "192.0.2.7"
    assert address_block("2001:db8::1") == address_block("2001:db8::ffff")
    assert address_block("2001:db8::1") != address_block("2001:db8:0:1::1")
    assert address_block(None) == "unknown"


def test_visitors_come_and_go() -> None:
    """The newest of a rater's stay; a full house turns only new raters away."""
    visitors: Visitors[int] = Visitors(per_rater=2, in_all=3)
    assert visitors.enter(1, "ada") == []
    assert visitors.enter(2, "ada") == []
    assert visitors.enter(3, "ada") == [1]
    assert visitors.enter(4, "bob") == []
    assert visitors.enter(5, "cy") is None
    assert visitors.enter(6, "ada") == [2]
    assert (visitors.of("ada"), visitors.everybody()) == ([3, 6], [3, 4, 6])
    visitors.leave(4)
    visitors.leave(99)
    assert visitors.enter(5, "cy") == []
    assert len(visitors) == 3


def test_attempts_are_forgotten_after_a_minute() -> None:
    """And are counted for every address alone."""
    attempts = Attempts(per_minute=2)
    attempts.failed("a", 0.0)
    attempts.failed("a", 30.0)
    assert attempts.wait_s("a", 40.0) == 20.0
    assert attempts.wait_s("b", 40.0) == 0.0
    assert attempts.wait_s("a", 60.0) == 0.0
