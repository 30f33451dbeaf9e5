"""What a sweep came to as one page that needs no server, and as files for programs."""

from __future__ import annotations

import html
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from data.files.files import write_atomically
from gaitpref.loop.run_report import PAGE_NAME
from gaitpref.report.page_style import STYLE
from gaitpref.report.pictures import BLUE, GREY, plain_axes, svg_of

from .run_sweep import SweepResult
from .sweep_cell import SweepDir
from .sweep_plan import CRITERION, value_text
from .sweep_table import SweepMean, as_csv, as_json, cells_of, heads, means


def write_sweep(root: Path, result: SweepResult) -> Path:
    """Write index.html, results.csv and results.json of a sweep; gives the page."""
    places = SweepDir(root)
    write_atomically(places.rows, as_csv(result.rows).encode())
    write_atomically(places.results, as_json(result).encode())
    write_atomically(places.page, render(places, result).encode())
    return places.page


def render(places: SweepDir, result: SweepResult) -> str:
    """The page as HTML."""
    groups = means(result.rows)
    title = html.escape(f"gaitpref: {places.root.absolute().name}")
    told = f"{len(result.rows)} loops finished, {len(result.failures)} failed"
    pictures = "".join(f"<figure>{svg}</figure>" for svg in _pictures(groups))
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width"><title>{title}</title>'
        f'<style>{STYLE}</style><h1>{title}</h1><p class="lead">{told}.</p>'
        f"{_failures(places, result)}"
        f"{_table(heads(groups), map(cells_of, groups)) if groups else ''}"
        f'<div class="curves">{pictures}</div>'
        f"<p>Means over seeds, with the 95 % interval of Student's t, which takes what "
        f"seeds give for normal; one seed has none. The return is that of the last "
        f"policy under the criterion, gained what it is above that of the policy the "
        f"run started from, and both are of a fixed grid of commands, without "
        f"exploration noise. Off by: its tracking error, the distance between velocity "
        f"and command. Better: runs that say so of how they ended, by answers "
        f"that were kept for it, of those that say anything.</p>"
        f"<h2>Loops</h2>{_links(places, result)}</html>\n"
    )


def _table(names: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = "".join(
        f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in line)}</tr>"
        for line in lines
    )
    return (
        f"<table><tr>{''.join(f'<th>{html.escape(n)}</th>' for n in names)}</tr>"
        f"{rows}</table>"
    )


def _failures(places: SweepDir, result: SweepResult) -> str:
    if not result.failures:
        return ""
    items = "".join(
        f"<li>{html.escape(name)}: {html.escape(why)} "
        f'(<a href="{places.log(name).relative_to(places.root)}">log</a>)</li>'
        for name, why in result.failures.items()
    )
    return f'<div class="alarm"><p>Not finished:</p><ul>{items}</ul></div>'


def _links(places: SweepDir, result: SweepResult) -> str:
    items = "".join(
        f'<li><a href="{places.run(row.name).relative_to(places.root) / PAGE_NAME}">'
        f"{html.escape(row.name)}</a>: {row.start_return:.2f} to "
        f"{row.final_return:.2f}</li>"
        for row in result.rows
    )
    return f"<ul>{items}</ul>"


def _pictures(groups: Sequence[SweepMean]) -> Iterable[str]:
    """Returns of each criterion: every seed a dot, means with their intervals."""
    by_criterion: dict[str, list[SweepMean]] = defaultdict(list)
    for group in groups:
        by_criterion[value_text(group.settings[CRITERION])].append(group)
    for criterion, own in by_criterion.items():
        figure = Figure(figsize=(4.6, 0.9 + 0.45 * len(own)), layout="constrained")
        axes = plain_axes(figure.subplots(), f"Return under {criterion}")
        for place, group in enumerate(reversed(own)):
            found = [row.final_return for row in group.rows]
            axes.plot(found, [place] * len(found), ".", color=GREY)
            mean = group.figure("final_return")
            axes.errorbar(
                mean.mean, place, xerr=mean.half_width, fmt="o", color=BLUE, capsize=3
            )
        axes.set_yticks(range(len(own)), [_label(group) for group in reversed(own)])
        axes.set_ylim(-0.6, len(own) - 0.4)
        yield svg_of(axes)


def _label(group: SweepMean) -> str:
    told = [
        f"{name.rpartition('.')[2]} {value_text(value)}"
        for name, value in group.settings.items()
        if name != CRITERION
    ]
    return ", ".join(told) or "as it is"
