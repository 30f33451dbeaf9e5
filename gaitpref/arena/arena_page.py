"""The page of an arena: the order with intervals, and who won against whom."""

from __future__ import annotations

import html
from collections import defaultdict
from collections.abc import Iterable
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

PAGE_NAME = "index.html"
_CFG = FilmCfg(camera=CameraCfg(width_px=240, height_px=180), fps=12.5)
_MOST_SHOWN, _MOST_S = 4, 4.0


def write_arena_page(folder: Path, standing: Standing) -> Path:
    """Write `index.html` of the arena; gives its path."""
    names = [html.escape(player.name) for player in standing.players]
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
        f"<h2>By command</h2>{_shares(standing, 'command')}"
        f"<h2>By rater</h2>{_shares(standing, 'rater')}{_notes(standing)}</html>\n"
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
    """Of the answers about two, the share that prefers the row, ties half."""
    count = len(standing.players)
    wins = np.zeros((count, count))
    for each in standing.answers:
        match = each.match
        wins[match.first, match.second] += match.score
        wins[match.second, match.first] += 1 - match.score
    order = standing.ranking.order
    names = [html.escape(standing.players[number].name) for number in order]
    rows = []
    for row, name in zip(order, names, strict=True):
        cells = []
        for column in order:
            played = wins[row, column] + wins[column, row]
            told = f"{wins[row, column]:g} of {played:g}" if played else "-"
            cells.append(told)
        rows.append((name, *cells))
    return _table(("preferred to", *names), rows)


def _shares(standing: Standing, by: str) -> str:
    """Share of its answers in which each player is preferred, ties half."""
    scores: dict[str, dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    for each in standing.answers:
        told = each.rater
        if by == "command":
            told = "{:g} m/s ahead, {:g} m/s left, {:g} rad/s".format(*each.command)
        scores[told][each.match.first].append(each.match.score)
        scores[told][each.match.second].append(1 - each.match.score)
    order = standing.ranking.order
    rows = []
    for told, of_players in sorted(scores.items()):
        cells = [
            f"{np.mean(own):.0%} of {len(own)}" if (own := of_players[number]) else "-"
            for number in order
        ]
        rows.append((html.escape(told), *cells))
    names = [html.escape(standing.players[number].name) for number in order]
    return _table((by, *names), rows)


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
