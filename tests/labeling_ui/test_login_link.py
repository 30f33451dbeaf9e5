"""A link that logs in: by a click, or scanned from a terminal."""

from __future__ import annotations

from pathlib import Path

import pytest

from data.errors import GaitprefError
from labeling_ui.web.login_link import login_link, qr_lines, require_url
from tests.helpers.label_browser import Site, launched


@pytest.mark.browser
def test_a_link_logs_in_and_its_token_stays_in_no_address(tmp_path: Path) -> None:
    site = Site(tmp_path / "set", pairs=3)
    with site.server, launched() as browser:
        context = browser.new_context()
        page = context.new_page()
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(login_link(site.server.url, site.tokens["ann"]))
        # Who may come in is settled before the page itself, which takes long to draw.
        page.wait_for_url(f"{site.server.url}/", wait_until="commit")
        assert site.tokens["ann"] not in page.url
        assert not any(site.tokens["ann"] in url for url in asked)
        (cookie,) = context.cookies()
        assert cookie.get("value", "").startswith("ann.")
        context.clear_cookies()
        page.goto(login_link(site.server.url, "x" * 32))
        page.get_by_text("This token is not known.").wait_for()
        assert context.cookies() == []


def test_the_link_can_be_scanned() -> None:
    """A square of at least a version of 33 modules, two rows of it in each line."""
    lines = qr_lines(login_link("https://gaits.example.org/a/", "t" * 32))
    assert len({len(line) for line in lines}) == 1
    assert len(lines) == -(-len(lines[0]) // 2)
    assert len(lines[0]) >= 33


@pytest.mark.parametrize("url", ["ftp://x", "gaits", "http://", "http://a#b", "http:["])
def test_an_address_of_no_page_is_refused(url: str) -> None:
    with pytest.raises(GaitprefError, match="is no address of a page"):
        require_url(url)
