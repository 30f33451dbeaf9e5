"""The page of a run: curves per round and a table, in one file that needs no server."""

from __future__ import annotations

import html
from collections.abc import Callable
from itertools import count, pairwise
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from data.errors import GaitprefError
from data.files.files import read_json, write_atomically
from data.files.telling import Tell, silent
from gaitpref.report import answer_credit, trust_section
from gaitpref.report.about_section import about_section
from gaitpref.report.answer_credit import answers_section
from gaitpref.report.film_section import film_section
from gaitpref.report.page_style import STYLE
from gaitpref.report.pictures import BLUE, GREY, panels, plain_axes, svg_of
from gaitpref.report.return_text import return_text
from gaitpref.report.trust_section import (
    alarm_section,
    approval_section,
    clips_section,
    decided_section,
    groups_section,
    standstill_section,
    trust_cells,
    verdict_section,
)
from gaitpref.report.verdict import play_command
from policy.training.checkpoint import load_policy

from .loop_cfg import LoopCfg, RunError
from .run_config import read_config
from .run_dir import Round

_PICTURES = 1 + 2 * trust_section.COUNT + answer_credit.COUNT
"""Before and after, the clips, the answers: those that take their time."""
PAGE_NAME = Path("report") / "index.html"
"""The page, from the directory of the run."""


def write_report(run: Path, tell: Tell = silent) -> Path:
    """Write `report/index.html` of the run; gives its path. `tell` gets how many of the
    pictures that take long are drawn.

    Raises:
        RunError: the directory holds no run, or no round is finished yet.
    """
    cfg = read_config(run)
    rounds = read_rounds(run)
    try:
        text = render(run, cfg, rounds, tell)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as why:
        raise RunError(
            f"the reports of the rounds of {run} are not what a loop writes "
            f"({type(why).__name__}: {why}); restore them from a copy"
        ) from why
    page = run / PAGE_NAME
    page.parent.mkdir(exist_ok=True)
    write_atomically(page, text.encode())
    return page


def read_rounds(run: Path) -> list[dict[str, Any]]:
    """What every finished round reported, in order.

    Raises:
        RunError: no round is finished yet.
        FileError: a report is damaged.
    """
    files = sorted((run / "rounds").glob("*/report.json"))
    if not files:
        raise RunError(
            f"{run} has no finished round yet: `gaitpref loop` with the command it was "
            f"started with goes on"
        )
    return [read_json(file) for file in files]


def render(
    run: Path, cfg: LoopCfg, rounds: list[dict[str, Any]], tell: Tell = silent
) -> str:
    """The page as HTML."""
    number = count(1)

    def drawn() -> None:
        tell(next(number), _PICTURES)

    first, last = rounds[0]["evaluation"], rounds[-1]["evaluation"]
    title = html.escape(f"gaitpref: {run.name}")
    criterion = html.escape(cfg.criterion)
    # A round whose answers do not agree is not trained on.
    trained = sum("training" in round for round in rounds[1:])
    done = f"{len(rounds) - 1} of {cfg.rounds} rounds answered, {trained} trained on"
    measured = (
        f"Return under <code>{criterion}</code>: {_interval(first)} with the first "
        f"policy, {_interval(last)} with the last. Tracking error "
        f"{first['tracking_error_m_s']:.2f} to {last['tracking_error_m_s']:.2f} m/s, "
        f"falls {first['falls_per_minute']:.2f} to {last['falls_per_minute']:.2f} "
        f"a minute."
    )
    settings = html.escape(
        f"base {cfg.base}, {cfg.labels} answers in {cfg.rounds} "
        f"round{'s' * (cfg.rounds != 1)} by the "
        f"{cfg.rater_words}, seed {cfg.seed}"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width"><title>{title}</title>'
        f"<style>{STYLE}</style><h1>{title}</h1>"
        f'<p class="lead">{settings}; {done}.</p>{verdict_section(run, rounds)}'
        f"<p>{measured}</p>{_before_and_after(run, cfg, rounds, drawn)}"
        f"{decided_section(rounds)}{standstill_section(rounds)}"
        f"{approval_section(rounds)}"
        f"{groups_section(rounds)}{alarm_section(rounds, cfg.wish)}"
        f'<div class="curves">{_curves(criterion, rounds)}</div>{_table(rounds)}'
        f"{clips_section(run, rounds, films=len(rounds) > cfg.rounds, drawn=drawn)}"
        f"{answers_section(run, rounds, drawn)}"
        f"<p>Evaluated on {last['episodes']} episodes a round. The learned return is "
        f"that of the reward a policy was trained against, which is new in every "
        f"round. {_meanings()}</p>{_about(run, rounds)}</html>\n"
    )


def _before_and_after(
    run: Path, cfg: LoopCfg, rounds: list[dict[str, Any]], drawn: Callable[[], None]
) -> str:
    """The first policy beside the one that stays; nothing before the run is over."""
    if len(rounds) <= cfg.rounds:
        return ""
    first, last = (Round(run, r["round"]).policy for r in (rounds[0], rounds[-1]))
    try:
        shas = load_policy(first).sha256, load_policy(last).sha256
        film = film_section(run, *shas, play=play_command(last, first))
        drawn()
        return film
    except GaitprefError as error:
        return f"<p>No film is shown: {html.escape(str(error))}</p>"


def _about(run: Path, rounds: list[dict[str, Any]]) -> str:
    first, last = (Round(run, r["round"]).policy for r in (rounds[0], rounds[-1]))
    live = ("live, while it goes on and afterwards", f"gaitpref watch {run}")
    curves = ("all curves", f"tensorboard --logdir {run}")
    beside = ("before and after, driven by you", play_command(last, first))
    return about_section(run, commands=(beside, live, curves))


def _interval(evaluation: dict[str, Any]) -> str:
    return return_text(evaluation["return_mean"], evaluation["return_ci95"])


def _curves(criterion: str, rounds: list[dict[str, Any]]) -> str:
    def evaluated(key: str) -> list[tuple[int, float]]:
        return [(r["round"], r["evaluation"][key]) for r in rounds]

    returns = _axes(f"Return under {criterion}")
    points = evaluated("return_mean")
    widths = [r["evaluation"]["return_ci95"] for r in rounds]
    returns.errorbar(*zip(*points, strict=True), yerr=widths, color=BLUE, capsize=3)

    learned = _axes("Learned return: before and after training on it")
    for before, after in pairwise(rounds):
        if "learned_return_next" in before and "learned_return" in after:
            pair = (before["learned_return_next"], after["learned_return"])
            learned.plot((before["round"], after["round"]), pair, "o-", color=BLUE)

    accuracy = _axes("Held-out accuracy of the reward")
    fits = [(r["round"], r["fit"]) for r in rounds if r.get("fit")]
    for number, fit in fits:
        if fit["held_out_accuracy"] is not None:
            low, high = fit["held_out_interval"]
            accuracy.plot((number, number), (low, high), color=GREY)
            accuracy.plot(number, fit["held_out_accuracy"], "o", color=BLUE)
    accuracy.axhline(0.5, color=GREY, linestyle=":")
    accuracy.set_ylim(0, 1.05)

    # Before a second round nothing was trained on a reward.
    figures = [returns, *([learned] if learned.lines else []), accuracy]
    for key, label in (
        ("tracking_error_m_s", "Tracking error, m/s"),
        ("falls_per_minute", "Falls per minute"),
        ("power_w", "Mechanical power, W"),
    ):
        axes = _axes(label)
        axes.plot(*zip(*evaluated(key), strict=True), "o-", color=BLUE)
        axes.set_ylim(bottom=0)
        figures.append(axes)
    for axes in figures:
        axes.set_xlim(-0.3, rounds[-1]["round"] + 0.3)
    return "".join(f"<figure>{svg_of(axes)}</figure>" for axes in figures)


def _axes(title: str) -> Axes:
    axes = panels((3.4,), (2.0,))[0, 0]
    axes.set_xlabel("round", fontsize=9)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return plain_axes(axes, title)


_HEADS = {
    "round": "",
    "steps": "that the policy was trained for",
    "answers": "the reward was fitted to",
    "held-out accuracy": "on episodes the model of their fold has not seen",
    "calibration error": "how far a told probability is from how often it is so",
    "on own clips": "answers about the round's clips foreseen from those before",
    "far": "motion farther from every clip judged before than 95 % of those are from "
    "one another",
    "return": "mean on a fixed grid of commands, without exploration noise, with its "
    "95 % interval",
    "tracking error": "how far the velocity is from what was told",
    "falls/min": "falls a minute",
    "drift": "KL divergence per step from the policy of the round before",
    "score's share": "of the learned reward in all that was paid at the end",
    "spread": "of the reward's ensemble, in deviations of the reward",
}
"""Columns of the table, and what they mean."""


def _meanings() -> str:
    """The same for who cannot point at a head."""
    told = [f"{head.capitalize()}: {means}." for head, means in _HEADS.items() if means]
    return html.escape(" ".join(told))


def _table(rounds: list[dict[str, Any]]) -> str:
    heads = "".join(
        f'<th title="{html.escape(means)}">{html.escape(head)}</th>'
        if means
        else f"<th>{html.escape(head)}</th>"
        for head, means in _HEADS.items()
    )
    rows = "".join(
        f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in _cells(r))}</tr>"
        for r in rounds
    )
    return f"<table><tr>{heads}</tr>{rows}</table>"


def _cells(round: dict[str, Any]) -> tuple[str, ...]:
    evaluation, fit = round["evaluation"], round.get("fit")
    training = round.get("training", {})
    drift = training.get("policy/reference_kl", 0.0)
    share, spread = training.get("share/score"), training.get("reward/spread")
    accuracy = "-"
    if fit and fit["held_out_accuracy"] is not None:
        low, high = fit["held_out_interval"]
        accuracy = f"{fit['held_out_accuracy']:.2f} ({low:.2f} to {high:.2f})"
    return (
        str(round["round"]),
        f"{round['policy_steps']:,}",
        str(fit["answers"]) if fit else "-",
        accuracy,
        *trust_cells(round),
        _interval(evaluation),
        f"{evaluation['tracking_error_m_s']:.3f} m/s",
        f"{evaluation['falls_per_minute']:.2f}",
        f"{drift:.1f} nats" if drift else "-",
        "-" if share is None else f"{share:.0%}",
        "-" if spread is None else f"{spread:.2f}",
    )
