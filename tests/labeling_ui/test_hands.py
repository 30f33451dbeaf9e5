"""What a rater's hands and eyes need: one page of one rater, test after test."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from labeling_ui.page.shortcuts import ASPECT_KEYS, SHORTCUTS, VERDICTS
from labeling_ui.questions.key_repeat import GuardCfg
from tests.helpers.contrast import contrasts, too_pale
from tests.helpers.label_browser import (
    WAIT_MS,
    Site,
    counted,
    keep_picture,
    launched,
    nothing_of_viser,
    opened,
    playwright,
)

if TYPE_CHECKING:
    from playwright.sync_api import CDPSession, Locator, Page, expect
else:
    expect = playwright.expect

pytestmark = pytest.mark.browser

IN_A_CURVE = (0.5, 0.25, 0.5)
"""What was asked for takes two lines."""
ANSWER_BELOW_HEAD = """() => {
  const top = (element) => element.getBoundingClientRect().top;
  const answer = [...document.querySelectorAll("#root button")].find(
    (button) => button.textContent.trim().startsWith("A better"));
  return top(answer) - top(document.querySelector("#root [data-gp-ready]"));
}"""
"""px, of one moment: the panel may scroll, and what is said is written anew."""
LINE_PX = 14
"""Less than a line of text takes."""
NAMELESS = """() => [...document.querySelectorAll(
  "#root button, #root input:not([type=hidden]), #root textarea, "
  + "#root canvas[data-engine], #root [role=slider], "
  + "#root [role=progressbar], #root [role=button]")]
  .filter((element) => element.checkVisibility())
  .filter((element) => !(element.ariaLabel || element.textContent.trim()
    || element.labels?.length))
  .map((element) => element.outerHTML.slice(0, 200))"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A page with many open pairs, which may be answered as fast as keys come."""
    any_time = GuardCfg(min_shown_s=0.0, repeat_gap_s=0.0, same_verdict_s=0.0)
    root = tmp_path_factory.mktemp("hands") / "set"
    site = Site(root, pairs=30, guard=any_time, command=IN_A_CURVE)
    with site.server:
        yield site


@pytest.fixture(scope="module")
def page(site: Site) -> Iterator["Page"]:
    """The page, its guidelines closed by the keyboard."""
    with launched() as browser:
        page = opened(browser, site, "ann", has_touch=True)
        page.get_by_role("dialog").wait_for()
        page.get_by_role("button", name="Got it").focus()
        page.keyboard.press("Enter")
        page.get_by_role("dialog").wait_for(state="detached")
        yield page
        page.context.close()


@pytest.fixture(scope="module")
def device(page: "Page") -> "CDPSession":
    """Changes the window without a new page."""
    return page.context.new_cdp_session(page)


def resize(
    device: "CDPSession",
    width: int,
    height: int,
    ratio: float = 1.0,
    *,
    mobile: bool = False,
) -> None:
    """Give the window another size in CSS pixels, and pixels of another size."""
    size = {"width": width, "height": height, "deviceScaleFactor": ratio}
    device.send("Emulation.setDeviceMetricsOverride", {**size, "mobile": mobile})


def pressed(page: "Page", name: str, key: str = "Enter") -> None:
    """Press a button as who has no mouse does."""
    button = page.get_by_role("button", name=name).first
    assert button.evaluate("button => button.tabIndex") >= 0
    button.focus()
    page.keyboard.press(key)


def answered(page: "Page", site: Site, change: int = 1) -> None:
    """Wait until the page counts what the store holds."""
    counted(page, len(site.answers()))


def test_the_tab_is_found_and_nothing_of_viser_is_seen(page: "Page") -> None:
    """Title and icon are ours; no server address, no settings of the scene."""
    assert page.title() == "gaitpref - Which one walks better?"
    icons = page.locator("link[rel=icon]")
    assert icons.count() == 1
    assert "1c5cbe" in (icons.get_attribute("href") or "")
    nothing_of_viser(page)


def test_the_keyboard_alone_presses_everything(page: "Page", site: Site) -> None:
    """Enter and Space press what has the focus; folders and history are reached."""
    pressed(page, "A better [2]")
    counted(page, 1)
    pressed(page, "Can't tell [0]", key=" ")
    counted(page, 2)
    assert site.answers()[0].choice == "skip"
    folder = page.get_by_role("button", name="Last answers")
    assert folder.get_attribute("aria-expanded") == "false"
    pressed(page, "Last answers")
    entry = page.get_by_role("button", name=re.compile(" A better$")).first
    entry.wait_for()
    entry.focus()
    page.keyboard.press("Enter")
    page.get_by_text("Reopened: you said “a better”.").wait_for()
    pressed(page, "Keep the earlier answer [K]", key=" ")
    page.get_by_text("Reopened").wait_for(state="detached")
    assert len(site.answers()) == 2
    pressed(page, "Last answers", key=" ")


def test_a_clicked_button_does_not_take_the_space_bar(page: "Page", site: Site) -> None:
    """Space then plays or pauses, and answers nothing."""
    before = len(site.answers())
    page.get_by_role("button", name="B better [4]").click()
    counted(page, before + 1)
    page.keyboard.press(" ")
    page.get_by_text("1x paused").wait_for()
    page.keyboard.press(" ")
    page.get_by_text("1x paused").wait_for(state="detached")
    assert len(site.answers()) == before + 1


def test_dialogs_take_digits_enter_and_escape(page: "Page", site: Site) -> None:
    before = len(site.answers())
    page.keyboard.press("f")
    page.get_by_role("dialog").wait_for()
    page.keyboard.press("2")
    counted(page, before + 1)
    assert site.answers()[0].reason == "Too short to judge"
    page.keyboard.press("f")
    field = page.get_by_role("dialog").locator("input")
    field.click()
    page.keyboard.press("Enter")
    page.get_by_text("Write the reason first.").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for(state="detached")
    page.keyboard.press("f")
    field.click()
    page.keyboard.type("3 legs")
    page.keyboard.press("Enter")
    counted(page, before + 2)
    assert site.answers()[0].reason == "3 legs"


def test_what_differed_is_told_after_the_answer(page: "Page", site: Site) -> None:
    """While it is read, no key answers."""
    before = len(site.answers()) + 1
    page.keyboard.press("4")
    counted(page, before)
    page.keyboard.press("6")
    told = page.get_by_role("dialog")
    # By chance they differ or do not.
    told.get_by_text(
        re.compile("^(You had these two|They differ in nothing)")
    ).wait_for()
    page.keyboard.press("2")
    page.keyboard.press("Escape")
    told.wait_for(state="detached")
    assert len(site.answers()) == before


def test_no_key_does_two_things() -> None:
    keys = [
        *(verdict.key for verdict in VERDICTS),
        *(aspect.key for aspect in ASPECT_KEYS),
        *(shortcut.key for shortcut in SHORTCUTS.values()),
    ]
    assert len(keys) == len(set(keys))


def test_the_map_of_the_keys(page: "Page", site: Site) -> None:
    """While it is open, no key answers; a line of it is seen on wide screens."""
    before = len(site.answers())
    assert page.locator("#gp-strip").is_visible()
    page.keyboard.press("?")
    page.get_by_role("dialog", name="Keys").wait_for()
    page.get_by_text("Because of steadiness").wait_for()
    page.keyboard.press("2")
    page.keyboard.press("Escape")
    page.get_by_role("dialog", name="Keys").wait_for(state="hidden")
    page.keyboard.press("3")
    counted(page, before + 1)
    assert site.answers()[0].choice == "equal"


def test_the_open_entry_of_the_history_is_marked(page: "Page", site: Site) -> None:
    """In words, for a screen reader, and in another colour; until it is answered."""
    before = len(site.answers())
    for number, key in enumerate("24", start=1):
        page.keyboard.press(key)
        counted(page, before + number)
    pressed(page, "Last answers")
    past = page.get_by_role("button", name=re.compile("^[0-9]{2}:[0-9]{2} · "))
    marked = page.locator("#root button[aria-current=true]")
    assert marked.count() == 0
    past.nth(1).click()
    expect(marked).to_have_text(re.compile(" · open$"), timeout=WAIT_MS)
    paint = "button => getComputedStyle(button).backgroundColor"
    assert past.nth(1).get_attribute("aria-current") == "true"
    assert past.nth(1).evaluate(paint) != past.nth(0).evaluate(paint)
    page.keyboard.press("k")
    expect(marked).to_have_count(0, timeout=WAIT_MS)
    pressed(page, "Last answers")


def said(page: "Page") -> tuple[str, str, str]:
    """Note, confidence and what decides, as the page shows them."""
    shown = page.locator("[data-gp-why]").get_attribute("data-gp-why") or ""
    sure = page.get_by_label("how sure").first.input_value()
    return page.locator("#root textarea").first.input_value(), sure, shown


@pytest.mark.parametrize("back", ["undo", "reopen"])
def test_remarks_come_back_with_their_question(
    page: "Page", site: Site, back: str
) -> None:
    """And are stored with the new answer, unless they were changed."""
    before = len(site.answers())
    page.locator("#root textarea").first.click()
    page.keyboard.type(f"B drags a foot, {back}")
    page.keyboard.press("Escape")
    for key in "8y2":
        page.keyboard.press(key)
    counted(page, before + 1)
    assert said(page) == ("", "not stated", "")
    if back == "undo":
        page.keyboard.press("z")
        counted(page, before)
    else:
        pressed(page, "Last answers")
        page.get_by_role("button", name=re.compile(" A better$")).first.click()
        page.get_by_text("Reopened").wait_for()
        pressed(page, "Last answers")
    page.get_by_text("Because of rhythm: now answer").wait_for()
    note = f"B drags a foot, {back}"
    assert said(page) == (note, "fairly sure [8]", "rhythm")
    page.keyboard.press("9")
    page.keyboard.press("5")
    page.get_by_text("Because of rhythm").wait_for(state="detached")
    counted(page, before + 1)
    newest = site.answers()[0]
    assert (newest.note, newest.confidence, newest.why) == (note, 0.95, "rhythm")
    assert newest.choice != "skip"
    assert (newest.supersedes is not None) == (back == "reopen")


def test_a_busy_tab_stores_the_whole_note(page: "Page", site: Site) -> None:
    """What is typed is sent a little later than a key is, the later the busier."""
    before = len(site.answers())
    slow = page.context.new_cdp_session(page)
    slow.send("Emulation.setCPUThrottlingRate", {"rate": 20})
    page.locator("#root textarea").first.click()
    page.keyboard.type("A limps")
    page.keyboard.press("Escape")
    page.keyboard.press("2")
    slow.send("Emulation.setCPUThrottlingRate", {"rate": 1})
    counted(page, before + 1)
    assert site.answers()[0].note == "A limps"
    assert said(page)[0] == ""


def test_a_moment_is_marked_and_taken_back(page: "Page", site: Site) -> None:
    """While the clips stand still; it comes back with the question."""
    before = len(site.answers())
    marked = page.get_by_text(re.compile("^Marked [0-9.]+ s: now answer"))
    page.keyboard.press("j")
    page.keyboard.press("x")
    marked.wait_for()
    page.keyboard.press("x")
    marked.wait_for(state="detached")
    pressed(page, "Mark this moment [X]")
    marked.wait_for()
    page.keyboard.press("2")
    counted(page, before + 1)
    (moment,) = site.answers()[0].here_s
    page.keyboard.press("z")
    counted(page, before)
    page.get_by_text(f"Marked {moment:.2f} s: now answer").wait_for()
    keep_picture(page, "marked.png")
    page.keyboard.press("2")
    counted(page, before + 1)
    assert site.answers()[0].here_s == (moment,)


def test_what_was_said_waits_while_an_earlier_answer_is_open(
    page: "Page", site: Site
) -> None:
    """Also where the browser had no time to keep it."""
    if not site.answers():
        page.keyboard.press("3")
        counted(page, 1)
    page.keyboard.press("b")
    page.get_by_text("Because of feet").wait_for()
    pressed(page, "Last answers")
    page.get_by_role("button", name=re.compile("Equally good$")).last.click()
    page.get_by_text("Reopened").wait_for()
    page.evaluate("sessionStorage.clear()")
    page.keyboard.press("k")
    page.get_by_text("Reopened").wait_for(state="detached")
    page.get_by_text("Because of feet").wait_for()
    pressed(page, "Last answers")
    page.keyboard.press("b")
    page.get_by_text("Because of feet").wait_for(state="detached")


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 720)])
def test_answers_stand_still(
    page: "Page", site: Site, device: "CDPSession", width: int, height: int
) -> None:
    """Whatever is said above them, which a phone shows all the same."""
    if not site.answers():
        page.keyboard.press("3")
        counted(page, 1)
    resize(device, width, height)
    said = page.locator("[data-gp-ready]")
    side = "clientWidth" if height > width else "clientHeight"
    scene = page.locator("#root canvas[data-engine]")
    expect(scene).to_have_js_property(side, min(width, height), timeout=WAIT_MS)

    def top() -> float:
        return page.evaluate(ANSWER_BELOW_HEAD)

    first = top()
    asked = said.locator("b", has_text="m/s, turning left 0.50 rad/s")
    asked.wait_for()
    assert asked.evaluate("b => b.offsetHeight") > 2 * LINE_PX
    page.keyboard.press("b")
    page.get_by_text("Because of feet").wait_for()
    assert top() == first
    assert said.evaluate("head => head.scrollHeight <= head.clientHeight")
    pressed(page, "Last answers")
    page.get_by_role("button", name=re.compile("Equally good$")).last.click()
    page.get_by_text("Reopened").wait_for()
    assert top() == first
    page.keyboard.press("k")
    page.get_by_text("Reopened").wait_for(state="detached")
    pressed(page, "Last answers")
    assert top() == first
    # The reason is kept for the open question; the page of the next size has none.
    page.get_by_text("Because of feet").wait_for()
    page.keyboard.press("b")
    page.get_by_text("Because of feet").wait_for(state="detached")


def test_a_screen_reader_is_told(page: "Page", site: Site) -> None:
    """Every element has a name, and what an answer led to is said."""
    assert page.evaluate(NAMELESS) == []
    before = len(site.answers())
    page.keyboard.press("1")
    counted(page, before + 1)
    live = page.locator("#gp-live")
    expect(live).to_have_text(
        re.compile(f"{before + 1} answers stored.*Asked: forward")
    )
    assert live.get_attribute("role") == "status"


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_what_is_written_can_be_read(page: "Page", theme: str) -> None:
    """By the colours that the page really has, with all folders and dialogs open."""
    root = page.locator("html")
    if root.get_attribute("data-mantine-color-scheme") != theme:
        page.keyboard.press("m")
        expect(root).to_have_attribute("data-mantine-color-scheme", theme)
    pressed(page, "View and help")
    page.keyboard.press("p")
    page.get_by_text("base height, m").wait_for()
    page.wait_for_timeout(400)  # Folders fade in.
    keep_picture(page, f"labeling-page-{theme}.png")
    found = contrasts(page)
    page.keyboard.press("f")
    page.get_by_role("dialog").get_by_text("Too short").wait_for()
    page.wait_for_timeout(400)
    found += contrasts(page)
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for(state="detached")
    for key, says in (("h", "Got it [escape]"), ("6", "Go on [escape]")):
        page.keyboard.press(key)
        page.get_by_role("dialog").get_by_text(says).wait_for()
        page.wait_for_timeout(400)
        found += contrasts(page, "[role=dialog]")
        page.keyboard.press("Escape")
        page.get_by_role("dialog").wait_for(state="detached")
    page.keyboard.press("?")
    page.get_by_role("dialog", name="Keys").wait_for()
    found += contrasts(page, "#gp-keys")
    page.keyboard.press("Escape")
    page.keyboard.press("p")
    pressed(page, "View and help")
    assert len(found) > 160
    assert too_pale(found) == {}


@pytest.mark.parametrize(
    ("width", "height", "ratio"),
    [(1024, 700, 1), (1024, 700, 2), (1280, 720, 1), (1440, 900, 1), (3840, 2160, 0.5)],
)
def test_the_strip_is_as_wide_as_the_scene(
    page: "Page", device: "CDPSession", width: int, height: int, ratio: float
) -> None:
    """In CSS pixels, also where the window changes while it is open."""
    resize(device, width, height, ratio)
    panel = page.locator("[data-dock-region=right]")
    strip = page.locator("[data-floating-window]")
    expect(panel).to_have_js_property("offsetHeight", height)

    def fits() -> bool:
        docked, below = box(panel), box(strip)
        gap = docked["x"] - below["x"] - below["width"]
        return 0 <= gap <= 40 and below["x"] <= 20 and below["y"] > height / 3

    for _ in range(100):
        if fits():
            return
        page.wait_for_timeout(100)
    raise AssertionError((box(panel), box(strip)))


def box(element: "Locator") -> Any:
    """Where it is, CSS pixels."""
    found = element.bounding_box()
    assert found is not None
    return found


def test_a_tablet_is_touched(page: "Page", device: "CDPSession", site: Site) -> None:
    resize(device, 1024, 768)
    before = len(site.answers())
    assert not page.locator("#gp-small").is_visible()
    page.get_by_role("button", name="B much better [5]").tap()
    counted(page, before + 1)


@pytest.mark.parametrize(("width", "height"), [(390, 844), (844, 390), (360, 640)])
def test_a_phone_has_room_for_both_clips_and_all_answers(
    page: "Page", device: "CDPSession", site: Site, width: int, height: int
) -> None:
    """Answers below the scene or beside it, every one under a thumb."""
    resize(device, width, height, mobile=True)
    before = len(site.answers())
    scene = page.locator("#root canvas[data-engine]")
    upright = height > width
    side, length = ("clientWidth", width) if upright else ("clientHeight", height)
    expect(scene).to_have_js_property(side, length, timeout=WAIT_MS)
    if not upright:
        expect(page.locator("[data-dock-region=right]")).to_be_in_viewport(ratio=0.9)
    answers = [page.get_by_role("button", name=f"[{key}]") for key in "123450"]
    for answer in answers:
        found = box(answer)
        assert found["height"] >= 44
        assert found["width"] >= 130
        assert found["x"] >= 0
        assert found["x"] + found["width"] <= width
        assert found["y"] >= 0
        assert found["y"] + found["height"] <= height
        if upright:
            assert found["y"] >= box(scene)["height"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    answers[3].tap()
    counted(page, before + 1)


def test_a_tiny_window_is_told_kindly(page: "Page", device: "CDPSession") -> None:
    """Who wants to goes on all the same."""
    resize(device, 300, 280)
    page.get_by_role("heading", name="A larger screen, please").wait_for()
    page.get_by_role("button", name="Try it all the same").click()
    page.get_by_role("heading", name="A larger screen").wait_for(state="hidden")


def test_the_ghost_is_seen_and_goes(page: "Page", device: "CDPSession") -> None:
    """Its meshes come only when it is asked for."""
    resize(device, 1280, 720)
    ghost = page.locator('[data-scene-node="/ghost_A"]')
    assert ghost.count() == 0
    page.keyboard.press("v")
    ghost.first.wait_for(state="attached")
