"""Footfalls and curves of both clips as SVG, with a playhead that moves by itself.

The browser animates the playhead, so that it costs nothing while the clips play: the
server sends a line once a round, and where the clock is paused, moved or changes its
speed.

Shapes: T steps of a clip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from data.episodes.stances import stance_phases
from data.features import LEGS
from labeling_ui.scene.clip_motion import Motion
from labeling_ui.scene.obedience import Obeyed
from labeling_ui.scene.scene import COLOURS, NAMES, rgb8

from .playback import Playback
from .theme import SIDE_RGBS

FALL_CSS = "#e03131"
_ROW = 9.0
_GAP = 3.0
_TURN_RAD = 0.02
"""Less is no turn that anybody asked for."""
_STYLE = """<style>
.gp{font-size:11px;line-height:1.2;color:inherit}
.gp svg{display:block;width:100%;overflow:visible}
.gp .t{opacity:.14}
.gp .row{display:flex;align-items:center;gap:8px;height:48px;margin:0 0 6px}
.gp .key{flex:0 0 16px;font-weight:700;text-align:center;font-size:13px;
border-radius:3px}
.gp .went{flex:0 0 76px;font-size:11px;line-height:12px}
.gp .legs{flex:0 0 26px;font-size:9px;line-height:12px;opacity:.75;text-align:right}
.gp .area{position:relative;flex:1}
.gp .title{display:flex;justify-content:space-between;height:16px;opacity:.75}
.gp .cols{display:flex;gap:14px;margin-left:58px}
.gp .axis{display:flex;justify-content:space-between;height:14px;
margin:0 84px 0 58px;opacity:.75;font-size:10px}
.gp .over{position:absolute;right:84px;top:0;height:0}
.gp .head{position:absolute;top:0;width:2px;margin-left:-1px;border-radius:1px;
background:currentColor;opacity:.85;pointer-events:none}
.gp .gait{position:absolute;left:0;right:0;top:46px;height:9px;font-size:8px;
line-height:9px}
.gp .gait span{position:absolute;overflow:hidden;white-space:nowrap;padding-left:2px;
box-sizing:border-box;border-left:1px solid currentColor}
.gp .speed{position:absolute;left:4px;top:108px;font-size:10px;opacity:.75}
</style>"""
FOOTFALLS_PX, CURVES_PX, TITLE_PX = 108, 48, 16
"""Heights of the drawings, which their playheads span, and of a curve's title."""


@dataclass(frozen=True)
class Curve:
    """One quantity of both clips."""

    title: str
    left: np.ndarray
    """[T] of clip A."""
    right: np.ndarray
    """[T] of clip B."""


def footfalls(left: Motion, right: Motion, duration_s: float) -> str:
    """The feet on the ground over time: a bar is a foot that stands."""
    rows = "".join(
        _row(
            side,
            _contact_svg(
                motion.contact, motion.dt_s, duration_s, side, fell=motion.fell
            )
            + _gait_words(motion, duration_s),
            went_words(motion.obeyed),
        )
        for side, motion in enumerate((left, right))
    )
    return _framed(rows, duration_s)


def live_footfalls(contacts: list[np.ndarray], dt_s: float, duration_s: float) -> str:
    """The last `duration_s` of each robot's `contacts` [T, 4], newest to the right."""
    rows = "".join(
        _row(
            side,
            _contact_svg(contact, dt_s, duration_s, side, fell=False),
        )
        for side, contact in enumerate(contacts)
    )
    return f'{_STYLE}<div class="gp">{rows}</div>'


def curves(left: Motion, right: Motion, duration_s: float) -> str:
    """Speed, height and torque of both clips over time, beside one another."""
    table = (
        Curve("forward speed, m/s", left.speed_m_s, right.speed_m_s),
        Curve("base height, m", left.height_m, right.height_m),
        Curve("mean joint torque, N m", left.torque_nm, right.torque_nm),
    )
    dts = (left.dt_s, right.dt_s)
    columns = "".join(_curve(curve, dts, duration_s) for curve in table)
    return (
        f'{_STYLE}<div class="gp" style="padding-bottom:10px">'
        f'<div class="cols">{columns}</div></div>'
    )


def playhead(playback: Playback) -> str:
    """A line through the footfalls, which are drawn right below; and the speed."""
    words = f"{playback.speed:g}x" + ("" if playback.playing else " paused")
    return (
        f'{_STYLE}<div class="gp" style="position:relative;height:0;z-index:1">'
        f'<div class="speed">{words}</div><div class="over" style="left:58px">'
        f"{_line(playback, FOOTFALLS_PX)}</div></div>"
    )


def curve_playheads(playback: Playback) -> str:
    """A line through each of the curves, which are drawn right below."""
    line = (
        f'<div style="position:relative;flex:1;top:{TITLE_PX}px">'
        f"{_line(playback, CURVES_PX)}</div>"
    )
    return (
        f'{_STYLE}<div class="gp" style="position:relative;height:0;z-index:1">'
        f'<div class="cols">{3 * line}</div></div>'
    )


def _line(playback: Playback, height_px: int) -> str:
    """An upright line at the moment of the clock, moving if the clock runs."""
    if not playback.playing:
        place = f"left:{100 * playback.time_s / playback.duration_s:.2f}%"
        return f'<div class="head" style="height:{height_px}px;{place}"></div>'
    share = 100 * playback.duration_s / playback.speed / playback.cycle_s
    frames = f"0%{{left:0}}{share:.2f}%{{left:100%}}100%{{left:100%}}"
    # A negative delay starts the animation where the clock is now.
    run = (
        f"gp {playback.cycle_s:.3f}s linear -{playback.cycle_position_s:.3f}s infinite"
    )
    return (
        f"<style>@keyframes gp{{{frames}}}</style>"
        f'<div class="head" style="height:{height_px}px;animation:{run}"></div>'
    )


def _framed(rows: str, duration_s: float) -> str:
    """The rows and the time axis below."""
    ticks = np.linspace(0, duration_s, 5)
    axis = "".join(f"<span>{tick:.2g} s</span>" for tick in ticks)
    return f'{_STYLE}<div class="gp">{rows}<div class="axis">{axis}</div></div>'


def went_words(obeyed: Obeyed | None) -> str:
    """How far a clip came of what it was asked for."""
    if obeyed is None:
        return ""
    lines = []
    if obeyed.asked_m > 0.0:
        lines += [f"went {obeyed.went_m:.2f} m", f"of {obeyed.asked_m:.2f} m"]
    if abs(obeyed.asked_rad) > _TURN_RAD:
        # What turned the wrong way has a minus.
        turned = math.copysign(1.0, obeyed.asked_rad) * obeyed.turned_rad
        lines += [
            f"turned {math.degrees(turned):.0f}°",
            f"of {math.degrees(abs(obeyed.asked_rad)):.0f}°",
        ]
    return "<br>".join(lines)


def _gait_words(motion: Motion, duration_s: float) -> str:
    """Which gait ran when, below the feet; nothing where there is one."""
    parts = []
    for index, (name, first, last) in enumerate(motion.gaits):
        left, wide = (
            100 * each * motion.dt_s / duration_s for each in (first, last - first)
        )
        shade = ".28" if index % 2 else ".14"
        parts.append(
            f'<span title="{name}" style="left:{left:.2f}%;width:{wide:.2f}%;'
            f'background:rgba(128,128,128,{shade})">{name}</span>'
        )
    return f'<div class="gait">{"".join(parts)}</div>' if parts else ""


def _row(side: int, svg: str, went: str = "") -> str:
    letter = "#fff" if side == 0 else "#000"
    chip = "#{:02x}{:02x}{:02x}".format(*SIDE_RGBS[side])
    return (
        f'<div class="row"><div class="key" style="background:{chip};color:{letter}">'
        f'{NAMES[side]}</div><div class="legs">{_legs()}</div>'
        f'<div class="area">{svg}</div><div class="went">{went}</div></div>'
    )


def _legs() -> str:
    return "<br>".join(LEGS)


def _contact_svg(
    contact: np.ndarray, dt_s: float, duration_s: float, side: int, *, fell: bool
) -> str:
    """Four bars, one a leg; the part of the clock behind the clip stays empty."""
    height = 4 * (_ROW + _GAP)
    length = len(contact) * dt_s / duration_s * 1000
    bars = []
    for leg in range(4):
        y = leg * (_ROW + _GAP) + _GAP / 2
        bars.append(
            f'<rect class="t" x="0" y="{y}" width="{length:.1f}" height="{_ROW}" '
            f'rx="1" fill="currentColor"/>'
        )
        for first, last in stance_phases(contact[:, leg]):
            x = first * dt_s / duration_s * 1000
            wide = (last - first) * dt_s / duration_s * 1000
            bars.append(
                f'<rect x="{x:.1f}" y="{y}" width="{wide:.1f}" height="{_ROW}" '
                f'fill="{_css(side)}"/>'
            )
    if fell:
        bars.append(
            f'<rect x="{length - 5:.1f}" y="0" width="5" height="{height}" '
            f'fill="{FALL_CSS}"><title>falls here</title></rect>'
        )
    return (
        f'<svg viewBox="0 0 1000 {height}" height="{height}" '
        f'preserveAspectRatio="none">{"".join(bars)}</svg>'
    )


def _curve(curve: Curve, dts: tuple[float, float], duration_s: float) -> str:
    both = np.concatenate([curve.left, curve.right])
    both = both[np.isfinite(both)]
    low, high = (float(both.min()), float(both.max())) if len(both) else (0.0, 0.0)
    span = max(high - low, 1e-6)
    told = f"{low:.2f} to {high:.2f}" if len(both) else "not measured"
    lines = []
    for side, values in enumerate((curve.left, curve.right)):
        # On hardware nobody may have measured it.
        if not np.isfinite(values).all():
            continue
        x = np.arange(1, len(values) + 1) * dts[side] / duration_s * 1000
        y = 46 - 44 * (values - low) / span
        points = " ".join(f"{a:.0f},{b:.1f}" for a, b in zip(x, y, strict=True))
        lines.append(
            f'<polyline points="{points}" fill="none" stroke="{_css(side)}" '
            'stroke-width="2" vector-effect="non-scaling-stroke"/>'
        )
    return (
        f'<div style="flex:1"><div class="title">{curve.title}'
        f"<span>{told}</span></div>"
        '<svg viewBox="0 0 1000 48" height="48" preserveAspectRatio="none">'
        '<rect class="t" width="1000" height="48" fill="currentColor"/>'
        f"{''.join(lines)}</svg></div>"
    )


def _css(side: int) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb8(COLOURS[side]))
