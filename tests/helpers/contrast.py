"""How well what is written on a page can be read, by the colours that it really has."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

_AA = 4.5
"""Least contrast of text, WCAG 2.2, 1.4.3 (AA)."""
_THEME = "data-mantine-color-scheme"
_CONTRASTS = """(within) => {
  const parse = (text) => {
    const found = text.match(/[\\d.]+/g).map(Number);
    const scale = text.startsWith("color(") ? 255 : 1;
    const [r, g, b] = found.slice(0, 3).map((part) => part * scale);
    return [r, g, b, found[3] ?? 1];
  };
  const over = (top, below) => top.slice(0, 3).map(
    (part, index) => part * top[3] + below[index] * (1 - top[3]));
  const light = (rgb) => {
    const [r, g, b] = rgb.map((part) => part / 255).map(
      (part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  // What a page has where it says nothing: white, or nearly black in the dark.
  const probe = document.body.appendChild(document.createElement("i"));
  probe.style.backgroundColor = "Canvas";
  const canvas = parse(getComputedStyle(probe).backgroundColor).slice(0, 3);
  probe.remove();
  const found = [];
  const walk = document.createTreeWalker(
    document.querySelector(within), NodeFilter.SHOW_TEXT);
  for (let text = walk.nextNode(); text; text = walk.nextNode()) {
    const own = text.parentElement;
    const box = own.getBoundingClientRect();
    if (!text.data.trim() || !box.width || !box.height || !own.checkVisibility()
        || own.closest("[inert], [disabled], [data-disabled], script, style, template")
        || box.width < 2) continue;
    const chain = [];
    for (let at = own; at; at = at.parentElement) chain.push(at);
    let below = canvas;
    let opacity = 1;
    for (const at of chain.reverse()) {
      const style = getComputedStyle(at);
      below = over(parse(style.backgroundColor), below);
      opacity *= Number(style.opacity);
    }
    const style = getComputedStyle(own);
    const ink = parse(own.closest("svg text") ? style.fill : style.color);
    const shown = over([...ink.slice(0, 3), ink[3] * opacity], below);
    const [high, low] = [light(shown), light(below)].sort((a, b) => b - a);
    found.push([text.data.trim().slice(0, 40), (high + 0.05) / (low + 0.05)]);
  }
  return found;
}"""


def contrasts(page: Page, within: str = "body") -> list[tuple[str, float]]:
    """Every piece of text that is seen, and its contrast to what lies below it."""
    return [(text, ratio) for text, ratio in page.evaluate(_CONTRASTS, within)]


def require_readable_cover(page: Page, *, least: int = 2) -> None:
    """Of what lies over the page, light and dark."""
    for theme in ("light", "dark", page.locator("html").get_attribute(_THEME)):
        page.evaluate(
            "([name, theme]) => document.documentElement.setAttribute(name, theme)",
            [_THEME, theme or "light"],
        )
        found = contrasts(page, "#gp-cover")
        assert len(found) >= least
        assert too_pale(found) == {}


def too_pale(found: list[tuple[str, float]]) -> dict[str, float]:
    """What of it is hard to read, and its contrast."""
    return {text: round(ratio, 2) for text, ratio in found if ratio < _AA}
