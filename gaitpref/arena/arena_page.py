"""The page of an arena: the order with intervals, who won against whom, and what single
commands and raters say."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.files.files import write_atomically
from gaitpref.film.camera import CameraCfg
from gaitpref.film.reel import FilmCfg
from gaitpref.film.sources import shot_of_clip
from gaitpref.report.film_section import moving
from gaitpref.report.page_style import STYLE
from gaitpref.report.pictures import BLUE, GREY, plain_axes, svg_of

from .arena import Standing
from .parts import LEAST, Part, Share, of_command, of_rater, parts_of

PAGE_NAME = "index.html"
_CFG = FilmCfg(camera=CameraCfg(width_px=240, height_px=180), fps=12.5)
_MOST_SHOWN, _MOST_S = 4, 4.0


def write_arena_page(folder: Path, standing: Standing) -> Path:
    """Write `index.html` of the arena; gives its path."""
    names = [html.escape(player.name) for player in standing.players]
    by_command = parts_of(standing.answers, of_command)
    by_rater = parts_of(standing.answers, of_rater)
    text = (
        f'<!doctype html><html lang="en"><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width">'
        f"<title>Arena: {', '.join(names)}</title><style>{STYLE}</style>"
        f'<h1>Arena</h1><p class="lead">{html.escape(standing.sentence)}.</p>'
        f"{_film(folder, standing)}"
        f'<div class="curves"><figure>{_intervals(standing)}</figure></div>'
        f"<p>Strengths by Bradley and Terry, in logits: who has one more is preferred "
        f"in 73 % of answers. Lines are 95 % of a bootstrap of the questions.</p>"
        f"<h2>Who is preferred to whom</h2>{_matrix(standing)}"
        f"<h2>By command</h2>{_parts(standing, 'command', by_command)}"
        f"<h2>By rater</h2>{_parts(standing, 'rater', by_rater)}"
        f"<p>Strengths and intervals as above, among those asked about in the row; "
        f"from {LEAST} questions about a player on.</p>{_notes(standing)}</html>\n"
    )
    write_atomically(folder / PAGE_NAME, text.encode())
    return folder / PAGE_NAME


def _film(folder: Path, standing: Standing) -> str:
    """The best of them under one command, side by side."""
    dataset = Dataset.open(folder / "dataset")
    shots = []
    for number in standing.ranking.order[:_MOST_SHOWN]:
        player = standing.players[number]
        own = [e for e in dataset.entries() if e.meta.policy_sha256 == player.sha256]
        entry = min(own, key=lambda e: (-e.meta.command[0], e.meta.env_index))
        steps = min(entry.num_steps, round(_MOST_S / entry.meta.control_dt_s))
        clip = Clip(entry.sha256, 0, steps)
        shots.append(shot_of_clip(dataset, clip, player.name))
    return f'<figure class="film">{moving(tuple(shots), _CFG)}</figure>'


def _intervals(standing: Standing) -> str:
    ranking = standing.ranking
    count = len(ranking.order)
    figure = Figure(figsize=(5, 0.6 + 0.45 * count), layout="constrained")
    axes = plain_axes(figure.subplots(), "Strength, logits")
    for row, number in enumerate(ranking.order):
        ends = ranking.low[number], ranking.high[number]
        if np.isfinite(ends).all():
            axes.plot(ends, (row, row), color=GREY, linewidth=3)
        axes.plot(ranking.strengths[number], row, "o", color=BLUE)
    axes.set_yticks(range(count), [standing.players[n].name for n in ranking.order])
    axes.invert_yaxis()
    return svg_of(axes)


def _matrix(standing: Standing) -> str:
    """Of the answers about two, how many prefer the row, ties half."""
    wins, names = standing.wins, _names_in_order(standing)
    played = wins + wins.T
    rows = [
        (
            name,
            *(
                f"{won:g} of {all_:g}" if all_ else "-"
                for won, all_ in zip(*of_row, strict=True)
            ),
        )
        for name, *of_row in zip(names, wins, played, strict=True)
    ]
    return _table(("preferred to", *names), rows)


def _parts(standing: Standing, head: str, parts: Sequence[Part]) -> str:
    """A row for each part: strengths with intervals, and the share of the answers."""
    rows = [
        (
            html.escape(_about(part)),
            *(_cell(part.shares.get(number)) for number in standing.ranking.order),
        )
        for part in parts
    ]
    return _table((head, *_names_in_order(standing)), rows)


def _about(part: Part) -> str:
    if isinstance(part.about, str):
        return part.about
    return "{:g} m/s ahead, {:g} m/s left, {:g} rad/s".format(*part.about)


def _cell(share: Share | None) -> str:
    if share is None:
        return "-"
    counted = f"preferred in {share.preferred:.0%} of {share.answers}"
    if share.strength is None or share.interval is None:
        return f"too few for a strength<br>{counted}"
    low, high = share.interval
    return f"{share.strength:+.2f} ({low:+.2f} to {high:+.2f})<br>{counted}"


def _names_in_order(standing: Standing) -> list[str]:
    players = standing.players
    return [html.escape(players[number].name) for number in standing.ranking.order]


def _notes(standing: Standing) -> str:
    said = [
        f"<li>{html.escape(_names(standing, each.match.first, each.match.second))}: "
        f"{html.escape(each.note)}</li>"
        for each in standing.answers
        if each.note
    ]
    return f"<h2>What was said</h2><ul>{''.join(said)}</ul>" if said else ""


def _names(standing: Standing, first: int, second: int) -> str:
    """Both players of a match: A is the first."""
    a, b = standing.players[first].name, standing.players[second].name
    return f"{a} (A), {b} (B)"


def _table(heads: Iterable[str], rows: Iterable[tuple[str, ...]]) -> str:
    body = "".join(
        f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows
    )
    return f"<table><tr>{''.join(f'<th>{h}</th>' for h in heads)}</tr>{body}</table>"
