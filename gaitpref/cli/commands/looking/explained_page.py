"""One page with the pictures of what a reward likes, and the words to them."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

from gaitpref.report.page_style import STYLE


def explained_page(title: str, pictures: Sequence[tuple[Path, str, str]]) -> str:
    """The page of SVG files, their words, and how commands name what is shown, for who
    points at these; it needs none of the files."""
    title = html.escape(title)
    figures = "".join(
        f'<figure>{_inline(path)}<figcaption title="{html.escape(name)}">'
        f"{html.escape(words)}</figcaption></figure>"
        for path, words, name in pictures
    )
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{title}</title><style>{STYLE}</style></head><body><h1>{title}</h1>"
        '<p class="lead">Of a clip: the reward of each step, what adds to it, and '
        "which foot stands. Of an answer: what the left clip, A, is paid more than the "
        "right one, in rows that each add up to the whole.</p>"
        f'<div class="curves">{figures}</div></body></html>\n'
    )


def _inline(path: Path) -> str:
    text = path.read_text()
    return text[text.index("<svg") :]
