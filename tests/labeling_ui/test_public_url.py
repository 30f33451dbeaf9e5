"""The page behind a reverse proxy, at a path of its own and at the root."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from multidict import CIMultiDictProxy
from yarl import URL

from benchmarks.visitor import Visitor
from benchmarks.walks import walking_dataset
from data.datasets.dataset import Dataset
from gaitpref.cli.commands.loop import page_of_loop
from gaitpref.cli.main import main, parse
from gaitpref.cli.options import options
from labeling_ui.web.checks import address_block, visitor_address
from labeling_ui.web.public_url import parse_public_url
from labeling_ui.web.tokens import TokenStore
from labeling_ui.web.websocket_relay import CLOSE_GOING_AWAY
from tests.helpers.labeling_visitor import PROTOCOL, House, house
from tests.helpers.local_host import free_port
from tests.helpers.reverse_proxy import NAME, ReverseProxy, reverse_proxy

PUBLIC = "https://label.example.org/gait"
Scenario = Callable[["Front"], Awaitable[None]]


@dataclass(frozen=True)
class Labeling:
    """`gaitpref label` as a process."""

    process: subprocess.Popen[str]
    said: list[str]
    """What it said when the page was up."""


@contextmanager
def labeling(root: Path, *options: str) -> Iterator[Labeling]:
    """The page of the data set at `root`; it is ended by SIGTERM."""
    log = root.with_suffix(".log")
    with log.open("wb") as errors:
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "gaitpref",
                "label",
                "--dataset",
                root,
                *options,
            ],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
    assert process.stdout is not None
    said: list[str] = []
    try:
        for line in process.stdout:
            said.append(line.strip())
            if "a login link for one more" in line:
                break
        assert said, log.read_text()
        yield Labeling(process, said)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 0
        assert "Traceback" not in log.read_text()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


async def stores_an_answer(url: str, token: str, proxy: ReverseProxy) -> None:
    """Log in, open the socket where the page's own client opens it, and answer."""
    visitor = Visitor(url, token, proxy.connector)
    page = asyncio.create_task(visitor.run())
    async with asyncio.timeout(60):
        work = asyncio.create_task(visitor.until_moving())
        await asyncio.wait({page, work}, return_when=asyncio.FIRST_COMPLETED)
        if page.done():
            page.result()
        await visitor.press("Close the dialog")
        await asyncio.sleep(0.7)
        await visitor.press("A better")
        await visitor.until_answered(1)
    page.cancel()
    await asyncio.gather(page, return_exceptions=True)


async def looks_around(origin: str, path: str, proxy: ReverseProxy) -> None:
    """Every address a browser is sent to lies under the path."""
    async with aiohttp.ClientSession(connector=proxy.connector()) as browser:

        async def get(address: str) -> tuple[int, str, str]:
            async with browser.get(origin + address, allow_redirects=False) as answer:
                location = answer.headers.get("Location", "")
                return answer.status, location, await answer.text()

        assert (await get(f"{path}/"))[:2] == (303, f"{path}/login")
        if path:
            assert (await get(f"{path}?darkMode=1"))[:2] == (303, f"{path}/?darkMode=1")
        status, _, text = await get(f"{path}/login")
        assert (status, 'action="login"' in text, 'href="/' in text) == (
            200,
            True,
            False,
        )


async def is_patient_with_everybody_alone(
    origin: str, path: str, token: str, proxy: ReverseProxy
) -> None:
    """Wrong tokens of an address keep no other out, and nobody can lend another."""

    async def login(browser: aiohttp.ClientSession, given: str) -> int:
        async with browser.post(
            f"{origin}{path}/login",
            data={"token": given},
            headers={"Origin": origin, "X-Forwarded-For": "127.0.0.1"},
            allow_redirects=False,
        ) as answer:
            return answer.status

    async with (
        aiohttp.ClientSession(connector=proxy.connector("127.0.0.2")) as guessing,
        aiohttp.ClientSession(connector=proxy.connector()) as honest,
    ):
        tries = [await login(guessing, f"wrong{number}") for number in range(11)]
        assert tries == [401] * 10 + [429]
        assert await login(honest, token) == 303


async def visits(origin: str, path: str, token: str, proxy: ReverseProxy) -> None:
    """Everything a proxy has to be good for."""
    await looks_around(origin, path, proxy)
    await stores_an_answer(f"{origin}{path}", token, proxy)
    await is_patient_with_everybody_alone(origin, path, token, proxy)
    # TLS takes its leave after a session is closed.
    await asyncio.sleep(0.3)


@pytest.mark.parametrize("path", ["/gait", ""])
@pytest.mark.parametrize("kind", ["nginx", "caddy"])
def test_the_documented_block_works(tmp_path: Path, kind: str, path: str) -> None:
    """Login, socket and answer through a real proxy, by the real command."""
    port, page_port = free_port(), free_port()
    root = tmp_path / "set"
    dataset = walking_dataset(root, pairs=3)
    token = TokenStore(root).add("ann")
    origin = f"https://{NAME}:{port}"
    with (
        reverse_proxy(
            kind, tmp_path, port=port, page_port=page_port, path=path
        ) as proxy,
        labeling(
            root, "--port", str(page_port), "--public-url", f"{origin}{path}"
        ) as page,
    ):
        assert page.said[0] == f"the labeling page is at {origin}{path}/"
        assert page.said[1].endswith(f"pass it on to http://127.0.0.1:{page_port}")
        asyncio.run(visits(origin, path, token, proxy))
    with Dataset.open(dataset.root).answers() as store:
        assert store.count(rater_id="ann") == 1


@dataclass(frozen=True)
class Front:
    """A page behind a proxy, spoken to as the proxy would."""

    built: House
    token: str

    async def ask(
        self, method: str, path: str, *, host: str = NAME, **headers: str
    ) -> tuple[int, str, CIMultiDictProxy[str]]:
        """Status, text and headers."""
        inner = self.built.proxy.notices[1].split()[-1]
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        async with self.built.browser.request(
            method,
            inner + path,
            headers={"Host": host} | given,
            data={"token": self.token} if method == "POST" else None,
            allow_redirects=False,
        ) as answer:
            return answer.status, await answer.text(), answer.headers


def behind(root: Path, url: str, scenario: Scenario, **cfg: Any) -> None:
    """Play a scenario at a page whose public address is `url`."""
    token = TokenStore(root).add("ann")

    async def play() -> None:
        async with house(root, public_url=parse_public_url(url), **cfg) as built:
            await scenario(Front(built, token))

    asyncio.run(play())


@pytest.mark.parametrize(
    ("url", "name", "rest"),
    [
        (PUBLIC, "__Secure-", {"Path=/gait", "Secure"}),
        ("https://label.example.org", "__Host-", {"Path=/", "Secure"}),
        ("http://label.example.org/a/b", "", {"Path=/a/b"}),
    ],
)
def test_a_cookie_stays_where_the_page_is(
    tmp_path: Path, url: str, name: str, rest: set[str]
) -> None:
    """Given and taken back; a browser refuses a prefix without its path."""
    origin = str(URL(url).origin())

    async def scenario(front: Front) -> None:
        for path, taken in (("/login", False), ("/logout", True)):
            path = parse_public_url(url).path + path
            status, _, headers = await front.ask("POST", path, Origin=origin)
            assert status == 303
            cookie, *more = headers["Set-Cookie"].split("; ")
            assert cookie.startswith(f"{name}gaitpref-")
            assert ("Max-Age=0" in more) == taken
            assert {word for word in more if word[:4] in ("Path", "Secu")} == rest

    behind(tmp_path, url, scenario)


@pytest.mark.parametrize("taken_away", [False, True])
def test_every_address_lies_under_the_path(tmp_path: Path, taken_away: bool) -> None:
    """Also where the proxy takes the path away before it asks."""
    path = "" if taken_away else "/gait"

    async def scenario(front: Front) -> None:
        for page in ("/", "/figures", "/guidelines"):
            status, _, headers = await front.ask("GET", path + page)
            assert (status, headers["Location"]) == (303, "/gait/login")
        status, _, headers = await front.ask(
            "POST", f"{path}/login", Origin=f"https://{NAME}"
        )
        assert (status, headers["Location"]) == (303, "/gait/")
        cookie = headers["Set-Cookie"].partition(";")[0]
        status, _, headers = await front.ask("GET", f"{path}/login", Cookie=cookie)
        assert (status, headers["Location"]) == (303, "/gait/")
        status, _, headers = await front.ask("GET", f"{path}/?x=1", Cookie=cookie)
        assert (status, headers["Location"]) == (303, "/gait/")
        for page in ("/figures", "/guidelines"):
            status, text, _ = await front.ask("GET", path + page, Cookie=cookie)
            assert status == 200
            assert 'href="./"' in text
            assert 'href="/' not in text
            assert 'action="/' not in text
        assert (await front.ask("GET", "/gaitother"))[0] == 404

    behind(tmp_path, PUBLIC, scenario)


@pytest.mark.parametrize(
    ("host", "origin", "status"),
    [
        (NAME, f"https://{NAME}", 303),
        # As nginx sends it without a line about it, and with $host of another port.
        ("127.0.0.1:8080", f"https://{NAME}", 303),
        (f"{NAME}:8443", f"https://{NAME}", 303),
        (NAME.upper(), f"https://{NAME.upper()}", 303),
        (NAME, f"http://{NAME}", 403),
        (NAME, f"https://{NAME}:8443", 403),
        (NAME, "https://evil.example", 403),
        (NAME, "null", 403),
        ("evil.example", f"https://{NAME}", 403),
        (f"{NAME}.evil.example", f"https://{NAME}.evil.example", 403),
        (f"evil.{NAME}", f"https://evil.{NAME}", 403),
        # A page of the visitor's own machine, behind a proxy that hides the Host.
        ("127.0.0.1:8080", "http://127.0.0.1:8080", 403),
    ],
)
def test_only_the_public_page_may_act(
    tmp_path: Path, host: str, origin: str, status: int
) -> None:
    """Host and Origin are those of the public address."""

    async def scenario(front: Front) -> None:
        said, text, _ = await front.ask("POST", "/gait/login", host=host, Origin=origin)
        assert said == status
        if host.endswith("evil.example"):
            assert f"{PUBLIC}/ (--public-url)" in text

    behind(tmp_path, PUBLIC, scenario)


@pytest.mark.parametrize("auth", [True, False])
def test_a_foreign_host_is_told_the_option(tmp_path: Path, auth: bool) -> None:
    """Whoever puts a proxy before the page sees at once what is missing."""
    TokenStore(tmp_path).add("ann")

    async def scenario() -> None:
        async with house(tmp_path, auth=auth) as built:
            status, text, _ = await built.get("/", Host=NAME)
            assert status == 403
            assert "--public-url" in text
            assert (f"https://{NAME}" in text) == auth
            assert ("tokens in place of --no-auth" in text) != auth

    asyncio.run(scenario())


def test_who_lends_an_address_is_still_counted(tmp_path: Path) -> None:
    """Without a proxy nobody is believed; with one, only what the proxy wrote."""

    async def guess(front: Front, forwarded: str) -> int:
        given = Front(front.built, "wrong")
        status, _, _ = await given.ask(
            "POST",
            "/gait/login",
            Origin=f"https://{NAME}",
            X_Forwarded_For=forwarded,
        )
        return status

    async def scenario(front: Front) -> None:
        for number in range(3):
            assert await guess(front, f"192.0.2.{number}, 198.51.100.1") == 401
        assert await guess(front, "198.51.100.1") == 429
        assert await guess(front, "198.51.100.2") == 401
        for nonsense in ("\xe4", "a" * 1000, ",,,"):
            assert await guess(front, nonsense) == 401
        assert await guess(front, "no address either") == 429

    behind(tmp_path, PUBLIC, scenario, login_failures_per_minute=3)

    async def without_a_proxy() -> None:
        async with house(tmp_path, login_failures_per_minute=3) as built:
            statuses = []
            for number in range(4):
                async with built.browser.post(
                    f"{built.url}/login",
                    data={"token": "wrong"},
                    headers={
                        "Origin": built.url,
                        "X-Forwarded-For": f"192.0.2.{number}",
                    },
                ) as answer:
                    statuses.append(answer.status)
            assert statuses == [401, 401, 401, 429]

    asyncio.run(without_a_proxy())


def test_only_a_proxy_on_this_machine_is_believed() -> None:
    """Whatever way IPv4 is written."""
    for peer in ("127.0.0.1", "::1", "::ffff:127.0.0.1"):
        assert visitor_address(peer, ["a", "b, 192.0.2.1"], proxied=True) == "192.0.2.1"
        assert visitor_address(peer, ["192.0.2.1"], proxied=False) == peer
        assert visitor_address(peer, [], proxied=True) == peer
    for peer in ("192.0.2.7", None):
        assert visitor_address(peer, ["192.0.2.1"], proxied=True) == peer
    assert address_block("::ffff:192.0.2.1") == "192.0.2.1"


@pytest.mark.parametrize(
    ("url", "wrong"),
    [
        ("label.example.org", "does not begin with https://"),
        ("", "does not begin with https://"),
        ("ftp://label.example.org", "does not begin with https://"),
        ("https:/label.example.org", "does not begin with https://"),
        ("https://ann:secret@label.example.org", "has a user or a password"),
        ("https://ann@label.example.org", "has a user or a password"),
        ("https://label.example.org/gait?x=1", "has a query"),
        ("https://label.example.org/gait?", "has a query"),
        ("https://label.example.org/#top", "has a query or a fragment"),
        ("https://label.example.org/../gait", "with . or .."),
        ("https://label.example.org/gait/./x", "with . or .."),
        ("https://label.example.org//gait", "has a path of other than"),
        ("https://label.example.org/gait//", "has a path of other than"),
        ("https://label.example.org/ga%69t", "has a path of other than"),
        ("https://label.example.org/{x}", "has a path of other than"),
        ("https://label.example.org/gait\n", "has a path of other than"),
        ("https://label.example.org:0", "has no port of 1 to 65535"),
        ("https://label.example.org:99999", "has no port of 1 to 65535"),
        ("https://label.example.org:x", "has no host name"),
        ("https://", "has no host name"),
        ("https:///gait", "has no host name"),
        ("https://[::1", "has no host name"),
        ("https://lübeck.example", "has no host name"),
        ("https://label example.org", "has no host name"),
    ],
)
def test_what_is_no_address_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], url: str, wrong: str
) -> None:
    """In one line, before anything is opened."""
    Dataset.create(tmp_path / "set")
    label = ["label", "--dataset", str(tmp_path / "set"), "--public-url", url]
    assert main(label) == 2
    said = capsys.readouterr().err
    assert wrong in said
    assert "https://label.example.org/gait" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("https://Label.Example.org:443/", "https://label.example.org/"),
        ("HTTP://lab:80/Gait/", "http://lab/Gait/"),
        ("https://[2001:db8::1]:8443/a/b", "https://[2001:db8::1]:8443/a/b/"),
    ],
)
def test_an_address_is_read_as_browsers_write_it(text: str, read: str) -> None:
    """Names in lower case, without the usual port."""
    assert str(parse_public_url(text)) == read


def test_without_tokens_nothing_is_public(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Everybody who reaches the proxy would be the same rater."""
    Dataset.create(tmp_path / "set")
    label = ["label", "--dataset", str(tmp_path / "set"), "--public-url", PUBLIC]
    assert main([*label, "--no-auth", "--port", "0"]) == 2
    assert "leave it out, or leave out --public-url" in capsys.readouterr().err


def test_what_travels_in_clear_is_said_on_the_console(tmp_path: Path) -> None:
    """To the network, and from the browser to the proxy."""
    Dataset.create(tmp_path / "set")
    TokenStore(tmp_path / "set").add("ann")
    given = ("--host", "0.0.0.0", "--port", "0", "--public-url", "http://lab.example")
    with labeling(tmp_path / "set", *given) as page:
        clear = [
            line for line in page.said if "answers and tokens travel in clear" in line
        ]
    assert len(clear) == 2
    assert "--cert and --key" in clear[0]
    assert "http://lab.example/" in clear[1]


def test_the_page_of_the_loop_takes_it_too(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And says where it has to be passed on to."""
    dataset = Dataset.create(tmp_path / "set")
    TokenStore(dataset.root).add("ann")
    command = parse(["loop", "--run", "x", "--rater", "human", "--public-url", PUBLIC])
    assert isinstance(command, options.Loop)
    command = replace(command, page=replace(command.page, port=free_port()))
    # It would slow down all tests that follow.
    monkeypatch.setattr(os, "nice", lambda by: 0)
    with page_of_loop(command, dataset):
        said = capsys.readouterr().err
    assert f"the labeling page is at {PUBLIC}/" in said
    assert f"pass it on to http://127.0.0.1:{command.page.port}" in said


def test_sigterm_ends_a_page_people_are_at(tmp_path: Path) -> None:
    """Quietly, though some come and go in that very moment."""
    root = tmp_path / "set"
    walking_dataset(root, pairs=3)
    tokens = [TokenStore(root).add(f"rater{number}") for number in range(4)]

    async def comes_and_goes(url: str, token: str) -> None:
        async with aiohttp.ClientSession(
            cookie_jar=aiohttp.CookieJar(unsafe=True), headers={"Origin": url}
        ) as browser:
            async with browser.post(f"{url}/login", data={"token": token}):
                pass
            with suppress(aiohttp.ClientConnectorError):
                while True:
                    with suppress(aiohttp.WSServerHandshakeError):
                        socket = await browser.ws_connect(url, protocols=[PROTOCOL])
                        await socket.close()
                    async with browser.get(url):
                        pass

    async def scenario(page: Labeling) -> None:
        url = page.said[0].split()[-1]
        visitor = Visitor(url, tokens[0])
        there = asyncio.create_task(visitor.run())
        restless = [
            asyncio.create_task(comes_and_goes(url, token)) for token in tokens[1:]
        ]
        async with asyncio.timeout(60):
            await visitor.until_moving()
            page.process.send_signal(signal.SIGTERM)
            await asyncio.to_thread(page.process.wait)
            await asyncio.gather(there, *restless, return_exceptions=True)
        assert visitor.close_code == CLOSE_GOING_AWAY

    with labeling(root, "--port", "0") as page:
        asyncio.run(scenario(page))
