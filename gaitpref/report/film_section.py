"""What the page of a run shows of the robot: before and after, side by side, moving."""

from __future__ import annotations

import base64
import html
from dataclasses import replace
from pathlib import Path

from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.errors import GaitprefError
from gaitpref.film.camera import CameraCfg, NoRenderer
from gaitpref.film.reel import FilmCfg, film, webp_of
from gaitpref.film.shot import Shot
from gaitpref.film.sources import before_and_after, shot_of_clip
from gaitpref.film.stick_figure import stick_figures

_CFG = FilmCfg(camera=CameraCfg(width_px=320, height_px=240), fps=12.5)
_CLIPS = FilmCfg(camera=CameraCfg(width_px=240, height_px=180), fps=12.5)
_MOST_S, _MOST_FRAMES = 6.0, 120
"""A page stays below 5 MB."""


def film_section(run: Path, first: str, last: str, *, play: str) -> str:
    """First and last policy, by their SHA-256, under the same command; nothing where
    the run's data set does not show both. `play` is the command that drives them."""
    try:
        shots = before_and_after(
            Dataset.open(run / "dataset"), first, last, most_s=_MOST_S
        )
    except GaitprefError as error:
        return f"<p>No film is shown: {html.escape(str(error))}</p>"
    if shots is None:
        return ""
    return (
        f'<h2>Before and after</h2><figure class="film">{moving(shots, _CFG)}'
        f"<figcaption>The same command from an equal start. Drive both yourself: "
        f"<code>{html.escape(play)}</code></figcaption></figure>"
    )


def film_of_clip(dataset: Dataset, clip: Clip) -> str:
    """A clip as a picture that moves."""
    shot = shot_of_clip(dataset, clip)
    return moving((shot,), pace_of_clip(shot))


def pace_of_clip(shot: Shot) -> FilmCfg:
    """How a clip is filmed: a long one in fewer pictures a second."""
    return replace(_CLIPS, fps=min(_CLIPS.fps, _MOST_FRAMES / shot.duration_s))


def moving(shots: tuple[Shot, ...], cfg: FilmCfg) -> str:
    """HTML of the shots side by side: a film, or stick figures where this machine
    cannot draw one."""
    said = html.escape(" beside ".join(shot.caption or "a clip" for shot in shots))
    try:
        picture = webp_of(film(shots, cfg), cfg.fps)
    except NoRenderer:
        return stick_figures(shots)
    encoded = base64.b64encode(picture).decode()
    return f'<img alt="{said}" src="data:image/webp;base64,{encoded}">'
