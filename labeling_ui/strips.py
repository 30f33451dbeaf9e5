"""Footfalls and curves of both clips as SVG, with a playhead that moves by itself.

The browser animates the playhead, so that it costs nothing while the clips play: the
server sends the drawing anew only when the clock is paused, moved, or changes its speed.

Shapes: T steps of a clip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data.features import LEGS

from .motion import Motion
from .playback import Playback
from .scene import COLOURS, NAMES, rgb8

FALL_CSS = "#e03131"
_ROW = 9.0
_GAP = 3.0
_STYLE = """<style>
.gp{position:relative;font:11px/1.2 inherit;color:inherit}
.gp svg{display:block;width:100%;overflow:visible}
.gp .t{opacity:.14}.gp .head{position:absolute;top:0;bottom:0;width:2px;
margin-left:-1px;background:currentColor;opacity:.85;border-radius:1px}
.gp .row{display:flex;align-items:center;gap:8px;margin:3px 0}
.gp .key{flex:0 0 16px;font-weight:700;text-align:center;font-size:13px}
.gp .legs{flex:0 0 18px;font-size:9px;line-height:12px;opacity:.65;text-align:right}
.gp .area{position:relative;flex:1}
.gp .lane{position:absolute;top:0;bottom:0;left:58px;right:0;pointer-events:none}
.gp .axis{display:flex;justify-content:space-between;margin:1px 0 0 58px;opacity:.6;
font-size:10px}
</style>"""


@dataclass(frozen=True)
class Curve:
    """One quantity of both clips."""

    title: str
    left: np.ndarray
    """[T] of clip A."""
    right: np.ndarray
    """[T] of clip B."""


def footfalls(left: Motion, right: Motion, playback: Playback) -> str:
    """The feet on the ground over time: a bar is a foot that stands."""
    rows = "".join(
        _row(NAMES[side], _css(side), _legs(), _contact_svg(motion, playback, side))
        for side, motion in enumerate((left, right))
    )
    return _framed(rows, playback)


def curves(left: Motion, right: Motion, playback: Playback) -> str:
    """Speed, height and torque of both clips over time."""
    table = (
        Curve("forward speed, m/s", left.speed_m_s, right.speed_m_s),
        Curve("base height, m", left.height_m, right.height_m),
        Curve("joint torque, N m", left.torque_nm, right.torque_nm),
    )
    dts = (left.dt_s, right.dt_s)
    rows = "".join(_curve_row(curve, dts, playback) for curve in table)
    return _framed(rows, playback)


def _framed(rows: str, playback: Playback) -> str:
    """The rows, the playhead over all of them, and the time axis below."""
    ticks = np.linspace(0, playback.duration_s, 5)
    axis = "".join(f"<span>{tick:.1f} s</span>" for tick in ticks)
    return (
        f'{_STYLE}<div class="gp" data-speed="{playback.speed:g}">{rows}'
        f'<div class="lane">{_playhead(playback)}</div>'
        f'<div class="axis">{axis}</div></div>'
    )


def _playhead(playback: Playback) -> str:
    here = 100 * playback.time_s / playback.duration_s
    if not playback.playing:
        return f'<div class="head" style="left:{here:.2f}%"></div>'
    end = 100 * (1 - (playback.cycle_s - playback.duration_s / playback.speed)
                 / playback.cycle_s)  # fmt: skip
    # A negative delay starts the animation where the clock is now.
    return (
        f"<style>@keyframes gp{{0%{{left:0}}{end:.2f}%{{left:100%}}100%{{left:100%}}}}"
        f'</style><div class="head" style="animation:gp {playback.cycle_s:.3f}s linear '
        f'-{playback.cycle_position_s:.3f}s infinite"></div>'
    )


def _row(name: str, colour: str, legend: str, svg: str) -> str:
    return (
        f'<div class="row"><div class="key" style="color:{colour}">{name}</div>'
        f'<div class="legs">{legend}</div><div class="area">{svg}</div></div>'
    )


def _legs() -> str:
    return "<br>".join(LEGS)


def _contact_svg(motion: Motion, playback: Playback, side: int) -> str:
    """Four bars, one a leg; the part of the clock behind the clip stays empty."""
    height = 4 * (_ROW + _GAP)
    bars = []
    for leg in range(4):
        y = leg * (_ROW + _GAP) + _GAP / 2
        width = motion.duration_s / playback.duration_s * 1000
        bars.append(
            f'<rect class="t" x="0" y="{y}" width="{width:.1f}" height="{_ROW}" '
            f'rx="1" fill="currentColor"/>'
        )
        for first, last in stance_phases(motion.contact[:, leg]):
            x = first * motion.dt_s / playback.duration_s * 1000
            wide = (last - first) * motion.dt_s / playback.duration_s * 1000
            bars.append(
                f'<rect x="{x:.1f}" y="{y}" width="{wide:.1f}" height="{_ROW}" '
                f'fill="{_css(side)}"/>'
            )
    if motion.fell:
        x = motion.duration_s / playback.duration_s * 1000
        bars.append(
            f'<rect x="{x - 5:.1f}" y="0" width="5" height="{height}" '
            f'fill="{FALL_CSS}"><title>falls here</title></rect>'
        )
    return (
        f'<svg viewBox="0 0 1000 {height}" height="{height}" '
        f'preserveAspectRatio="none">{"".join(bars)}</svg>'
    )


def stance_phases(contact: np.ndarray) -> list[tuple[int, int]]:
    """First step and step behind the last of every stretch of `contact` [T]."""
    edges = np.diff(np.concatenate([[0], contact.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def _curve_row(curve: Curve, dts: tuple[float, float], playback: Playback) -> str:
    both = np.concatenate([curve.left, curve.right])
    low, high = float(both.min()), float(both.max())
    span = max(high - low, 1e-6)
    lines = []
    for side, values in enumerate((curve.left, curve.right)):
        x = np.arange(1, len(values) + 1) * dts[side] / playback.duration_s * 1000
        y = 38 - 36 * (values - low) / span
        points = " ".join(f"{a:.0f},{b:.1f}" for a, b in zip(x, y, strict=True))
        lines.append(
            f'<polyline points="{points}" fill="none" stroke="{_css(side)}" '
            f'stroke-width="2" vector-effect="non-scaling-stroke"/>'
        )
    svg = (
        '<svg viewBox="0 0 1000 40" height="40" preserveAspectRatio="none">'
        f'<line class="t" x1="0" y1="39" x2="1000" y2="39" stroke="currentColor"/>'
        f"{''.join(lines)}</svg>"
    )
    legend = f"{high:.2f}<br><br>{low:.2f}"
    return (
        f'<div style="margin-left:58px;opacity:.75">{curve.title}</div>'
        f'<div class="row" style="gap:8px"><div class="legs" style="flex-basis:42px">'
        f'{legend}</div><div class="area">{svg}</div></div>'
    )


def _css(side: int) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb8(COLOURS[side]))
