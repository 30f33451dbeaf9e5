"""The figures of raters as a table in words, with what each column means."""

from __future__ import annotations

from collections.abc import Sequence

from data.files.shown import shown

from .rater_figures import RaterFigures, Share

_HEADS = (
    ("answers", ""),
    ("answers", "per hour"),
    ("median", "time"),
    ("chosen", "left"),
    ("says", "why"),
    ("agrees with", "itself"),
    ("known", "answers"),
    ("agrees with", "others"),
    ("beyond", "chance"),
    ("agreement", "by quarters"),
    ("seconds an answer,", "over the last hour"),
)
_LEGEND = (
    "answers per hour: pauses of more than five minutes left out",
    "median time: half of the answers took less",
    "chosen left: of the preferences; sides are drawn by lot, so 50 % is fair",
    "says why: of the preferences, with one tap on what decided; nobody has to",
    "agrees with itself: own pairs that came back, with the sides swapped",
    "known answers: as where one robot falls (`gaitpref raters gold` shows them)",
    "agrees with others: answers of two people to one pair that say the same",
    "beyond chance: Krippendorff's alpha; 1 is full agreement, 0 is chance",
    "agreement by quarters: known answers and those of others, in the order given, "
    "where each has ten; 16 % up or down are chance",
    "seconds an answer: medians, the oldest first; a bar that shrinks is a rater who "
    "speeds up",
)
_BARS = "▁▂▃▄▅▆▇█"


def table_of(raters: Sequence[RaterFigures]) -> list[str]:
    """Lines: two of heads, one a rater, then the legend."""
    rows = [_cells(of_rater) for of_rater in raters]
    widths = [
        max(len(text) for text in (*head, *(row[1][column] for row in rows)))
        for column, head in enumerate(_HEADS)
    ]
    names = max(5, *(len(name) for name, _ in rows))

    def line(name: str, cells: Sequence[str]) -> str:
        filled = (text.rjust(width) for text, width in zip(cells, widths, strict=True))
        return "  ".join([name.ljust(names), *filled]).rstrip()

    heads = [
        line(name, [head[n] for head in _HEADS]) for n, name in ((0, "rater"), (1, ""))
    ]
    return [*heads, *(line(*row) for row in rows), "", *_LEGEND]


def _cells(of_rater: RaterFigures) -> tuple[str, list[str]]:
    def percent(share: Share) -> str:
        return "-" if share.share is None else f"{share.share:.0%} of {share.of}"

    def number(value: float | None, form: str) -> str:
        return "-" if value is None else form.format(value)

    return shown(of_rater.rater_id), [
        str(of_rater.answers),
        number(of_rater.per_hour, "{:.0f}"),
        number(of_rater.median_s, "{:.1f} s"),
        percent(of_rater.left),
        percent(of_rater.why),
        percent(of_rater.self_consistency),
        percent(of_rater.gold),
        percent(of_rater.agreement),
        number(of_rater.alpha, "{:.2f}"),
        quarters_told(of_rater.agreed) or "-",
        _pace(of_rater.pace_s),
    ]


def quarters_told(agreed: Sequence[Share]) -> str:
    """The share of each quarter; nothing where there is none."""
    return ", ".join(f"{part.share or 0:.0%}" for part in agreed)


def _pace(pace_s: Sequence[float]) -> str:
    """Bars of the medians, and the first and last of them."""
    if not pace_s:
        return "-"
    most = max(max(pace_s), 1e-9)
    bars = "".join(_BARS[round(7 * value / most)] for value in pace_s)
    return f"{bars} {pace_s[0]:.1f} to {pace_s[-1]:.1f} s"
