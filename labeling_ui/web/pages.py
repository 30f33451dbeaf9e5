"""Log in, guidelines, my figures: pages that work without JavaScript."""

from __future__ import annotations

import html
import math

from markdown_it import MarkdownIt

from labeling_ui.questions.rater_figures import RaterFigures, Share
from labeling_ui.questions.rater_table import quarters_told

CSS = """
:root { color-scheme: light dark; --ink: #1a1d21; --soft: #5c6570; --paper: #fff;
  --line: #d9dee3; --accent: #1971c2; --bad: #c92a2a; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e8ea; --soft: #9aa4ae;
  --paper: #16191d; --line: #343a40; --accent: #4dabf7; --bad: #ff8787; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, sans-serif; }
main { max-width: 42rem; margin: 0 auto; padding: 3rem 1.25rem; }
main.narrow { max-width: 24rem; padding-top: 18vh; }
h1 { font-size: 1.5rem; margin: 0 0 .5rem; } h2 { font-size: 1.15rem; }
p.soft, td.soft { color: var(--soft); } p.bad { color: var(--bad); }
a { color: var(--accent); }
label { display: block; font-weight: 600; margin: 1.5rem 0 .4rem; }
input { width: 100%; font: inherit; padding: .6rem .7rem; color: inherit;
  background: transparent; border: 1px solid var(--line); border-radius: .4rem; }
button { font: inherit; font-weight: 600; margin-top: 1rem; padding: .6rem 1.4rem;
  color: var(--paper); background: var(--accent); border: 0; border-radius: .4rem;
  cursor: pointer; }
:focus-visible { outline: 3px solid var(--accent); outline-offset: 2px; }
table { border-collapse: collapse; width: 100%; margin: 1.5rem 0; }
th, td { text-align: left; padding: .5rem .75rem .5rem 0; vertical-align: top;
  border-bottom: 1px solid var(--line); }
td.number { text-align: right; font-variant-numeric: tabular-nums;
  white-space: nowrap; }
pre, code { font-family: ui-monospace, monospace; font-size: .9em; }
pre { overflow-x: auto; } img { max-width: 100%; }
svg { width: 100%; height: 6rem; fill: var(--accent); }
form.quiet button { background: none; color: var(--soft); padding: 0;
  font-weight: 400; text-decoration: underline; }
"""

LINK_SCRIPT = """
const link = /^#token=([\\w-]{1,200})$/.exec(location.hash);
if (link) {
  history.replaceState(null, "", location.pathname);
  document.getElementById("token").value = link[1];
  document.querySelector("form").submit();
}
"""
"""Logs in with the token of a link. What follows a # goes to no server and no log; the
address forgets it at once."""

_MARKDOWN = MarkdownIt("commonmark", {"html": False}).enable("table")


def login_page(complaint: str = "") -> str:
    """The form that asks for a token."""
    bad = f'<p class="bad" role="alert">{html.escape(complaint)}</p>'
    return _page(
        "Log in",
        '<h1>gaitpref</h1><p class="soft">Which gait is better?</p>'
        f"{bad if complaint else ''}"
        '<form method="post" action="login">'
        '<label for="token">Your token</label>'
        '<input id="token" name="token" type="password" required autofocus '
        'autocomplete="current-password" maxlength="200">'
        "<button>Log in</button></form>"
        '<p class="soft">The owner of the data set makes one with '
        "<code>gaitpref raters --dataset DIR add NAME</code>.</p>"
        f"<script>{LINK_SCRIPT}</script>",
        css_class="narrow",
    )


def full_page(places: int, wait_s: float | None) -> str:
    """What a rater reads for whom there is no place.

    Args:
        places: How many there are.
        wait_s: How often one becomes free; None where that is not known yet.
    """
    if wait_s is None:
        when = "Nobody has left yet: come back in half an hour."
    elif (minutes := math.ceil(wait_s / 60)) == 1:
        when = "Lately one became free every minute: come back in a minute."
    else:
        when = (
            f"Lately one became free every {minutes} minutes: come back in {minutes} "
            "minutes."
        )
    taken = "The only place is" if places == 1 else f"All {places} places are"
    return _page(
        "All places are taken",
        f"<h1>{taken} taken</h1><p>{when}</p>"
        '<p class="soft">Or leave this page open: it asks again every minute, and lets '
        "you in when there is a place. Your answers so far are kept.</p>",
        css_class="narrow",
    )


def guidelines_page(markdown: str) -> str:
    """The project's guidelines; HTML in the Markdown is shown, not run."""
    return _page("Guidelines", _MARKDOWN.render(markdown) + _BACK)


def figures_page(figures: RaterFigures, *, can_leave: bool) -> str:
    """A rater's own figures, with what they mean.

    Args:
        can_leave: Whether raters log in: say who it is, and offer to log out.
    """
    rows = "".join(
        f"<tr><th>{name}</th><td class='number'>{html.escape(value)}</td>"
        f"<td class='soft'>{meaning}</td></tr>"
        for name, value, meaning in _figure_rows(figures)
    )
    leave = (
        '<form class="quiet" method="post" action="logout"><button>Log out</button>'
        "</form>"
    )
    name = f"<p class='soft'>{html.escape(figures.rater_id)}</p>" if can_leave else ""
    return _page(
        "My figures",
        f"<h1>My figures</h1>{name}"
        f"<table>{rows}</table>{_pace_chart(figures.pace_s)}"
        "<p class='soft'>They tell how reliable the answers are. "
        "Nobody is ranked, and nothing is kept from you.</p>"
        f"{_BACK}{leave if can_leave else ''}",
    )


_BACK = '<p><a href="./">To the pairs</a></p>'


def _pace_chart(pace_s: tuple[float, ...]) -> str:
    """Median seconds per answer over the last hour of work, as bars; "" of too few."""
    if len(pace_s) < 2:
        return ""
    most, width = max(pace_s), 100 / len(pace_s)
    bars = "".join(
        f'<rect x="{index * width:.1f}" y="{60 - 56 * value / most:.1f}" '
        f'width="{width - 1:.1f}" height="{56 * value / most:.1f}">'
        f"<title>{value:.1f} s</title></rect>"
        for index, value in enumerate(pace_s)
    )
    return (
        "<h2>Seconds per answer, last hour of work</h2>"
        '<svg viewBox="0 0 100 60" preserveAspectRatio="none" role="img" '
        f'aria-label="from {pace_s[0]:.1f} s to {pace_s[-1]:.1f} s">{bars}</svg>'
        f"<p class='soft'>from {pace_s[0]:.1f} s, on the left, to {pace_s[-1]:.1f} s "
        "now; much shorter bars may say that it is time for a break</p>"
    )


def _figure_rows(figures: RaterFigures) -> list[tuple[str, str, str]]:
    def number(value: float | None, form: str) -> str:
        return "-" if value is None else form.format(value)

    def share(part: Share) -> str:
        return number(part.share, "{:.0%}") + (f" of {part.of}" if part.of else "")

    return [
        ("Answers", str(figures.answers), "that count now"),
        ("Answers per hour", number(figures.per_hour, "{:.0f}"), "pauses left out"),
        (
            "Median time per answer",
            number(figures.median_s, "{:.1f} s"),
            "half of your answers took less",
        ),
        ("Answers under 2 s", share(figures.fast), "perhaps too fast to have looked"),
        (
            "Chosen left",
            share(figures.left),
            "of your preferences; sides are drawn by lot, so about 50 % is fair",
        ),
        (
            "Said why",
            share(figures.why),
            "of your preferences, with one tap on what decided; you need not",
        ),
        (
            "Agrees with yourself",
            share(figures.self_consistency),
            "same answer when a pair came back with the sides swapped",
        ),
        (
            "Agrees with the known answer",
            share(figures.gold),
            "where everybody sees it who looks, as that one robot falls",
        ),
        (
            "Agrees with others",
            share(figures.agreement),
            "same answer to the same pair",
        ),
        (
            "The same, by quarters",
            quarters_told(figures.agreed) or "-",
            "known answers and those of others, in the order you gave yours; of fewer "
            "than ten in a quarter it would be chance",
        ),
        (
            "Agreement beyond chance",
            number(figures.alpha, "{:.2f}"),
            "Krippendorff's alpha: 1 is full agreement, 0 is chance",
        ),
    ]


def _page(title: str, body: str, *, css_class: str = "") -> str:
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title} · gaitpref</title><style>{CSS}</style></head>"
        f'<body><main class="{css_class}">{body}</main></body></html>\n'
    )
