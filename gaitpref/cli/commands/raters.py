"""`gaitpref raters`: who may log in, and how well the raters agree."""

from __future__ import annotations

import json
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from data.answers import curation
from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from data.files.shown import shown
from gaitpref.cli.options import options
from gaitpref.cli.shared.dataset_argument import open_dataset
from gaitpref.cli.shared.next_of_answers import next_fit
from gaitpref.cli.shared.next_of_raters import next_of_raters
from gaitpref.console.extras import require
from gaitpref.console.progress import console
from gaitpref.console.terminal import say
from labeling_ui.questions.known_answers import known_answers
from labeling_ui.questions.rater_doubts import doubts
from labeling_ui.questions.rater_figures import (
    RaterFigures,
    Share,
    all_figures,
    figures,
    human_rows,
    objections,
)
from labeling_ui.questions.rater_presence import seen_of
from labeling_ui.questions.rater_table import table_of
from labeling_ui.web.login_link import login_link, qr_lines, require_url
from labeling_ui.web.tokens import TokenStore, require_name


def run(command: options.Raters) -> int:
    """Run the command; gives the exit code."""
    dataset = open_dataset(command)
    tokens = TokenStore(dataset.root)
    match command.action:
        case "add":
            _add(command, dataset, tokens)
        case "revoke":
            name = _name(command)
            tokens.revoke(name)
            values = {"revoked": name}
            _show(command, values, [f"{name} is logged out for good"])
            _next(command, dataset, values)
        case "list":
            _next(command, dataset, _list(command, dataset, tokens))
        case "stats":
            _next(command, dataset, _stats(command, dataset))
        case "groups":
            groups = require("gaitpref.raters.rater_groups", "fit")
            values, lines = groups.told_of_groups(dataset)
            _show(command, values, lines)
            _next(command, dataset, values)
        case "compare":
            trust = require("gaitpref.programs.program_trust", "fit")
            with dataset.answers_copy() as store:
                values, lines = trust.told_of_programs(store)
            _show(command, values, lines)
            _next(command, dataset, values)
        case "leave-out" | "take-in":
            _teaching(command, dataset)
        case "gold":
            _gold(command, dataset)
    return 0


def _add(command: options.Raters, dataset: Dataset, tokens: TokenStore) -> None:
    name = _name(command)
    require_name(name)
    with dataset.answers() as store:
        # Tells at once if the name belongs to a simulated rater.
        store.add_rater(name, "human")
    require_url(command.url)
    token = tokens.add(name)
    link = login_link(command.url, token)
    lines = [
        token,
        f"This is the token of {name}; it is not shown again. This link logs in with "
        "it, so give it to nobody else:",
        link,
        *qr_lines(link),
    ]
    _show(command, {"name": name, "token": token, "link": link}, lines)
    if not command.json:
        console.next(f"`gaitpref label --dataset {command.dataset}` serves the page")


def _list(
    command: options.Raters, dataset: Dataset, tokens: TokenStore
) -> dict[str, Any]:
    known, now = tokens.names(), datetime.now(UTC)
    with dataset.answers_copy() as store:
        seen = {name: seen_of(store, name, now) for name in known}
        out = curation.left_out(store)
    raters = [
        {"name": name, "since": token.created_utc, "left_out": name in out}
        | asdict(seen[name])
        for name, token in known.items()
    ]
    lines = [
        f"{name:<20} {seen[name].answers:>6} answers, {seen[name].words(now)}, token "
        f"of {token.created_utc[:10]}" + ", left out" * (name in out)
        for name, token in known.items()
    ]
    hint = f"nobody has a token; `gaitpref raters --dataset {dataset.root} add NAME`"
    values = {"raters": raters}
    _show(command, values, lines or [f"{hint} makes one"])
    return values


def _teaching(command: options.Raters, dataset: Dataset) -> None:
    """Leave a rater out, or take the rater in again."""
    name, out = _name(command), command.action == "leave-out"
    with dataset.answers() as store:
        curation.leave_out(store, name, datetime.now(UTC), out=out)
        answers = store.count(rater_id=name)
    told = "are kept and teach nothing, from the next fit on" if out else "teach again"
    _show(
        command,
        {"name": name, "left_out": out, "answers": answers},
        [f"the {answers} answers of {name} {told}"],
    )
    if not command.json:
        console.next(next_fit(dataset))


def _gold(command: options.Raters, dataset: Dataset) -> None:
    """Show which answers are known, ask about a pair whose answer is, or end that."""
    if command.withdraw:
        _withdraw(command, dataset)
        return
    if command.known is None and command.name is not None:
        raise GaitprefError(
            f"which answer to {command.name} is known? `--known a`, b, or equal; "
            "`--withdraw` takes back one that was"
        )
    if command.known is not None:
        with dataset.answers() as store:
            pair = curation.find_pair(store, _name(command))
            added = curation.ask_known(store, pair, command.known)
        told = "asks about the same clips, swapped; it measures raters, teaches nothing"
        values = {"pair_id": added.pair_id, "known": added.gold}
        _show(command, values, [f"{added.pair_id[:12]} {told}"])
        _next_film(command, added.pair_id)
        return
    with dataset.answers_copy() as store:
        found = known_answers(
            store.pairs(), human_rows(store), curation.withdrawn(store)
        )
    values = [asdict(of_pair) for of_pair in found]
    lines = [str(of_pair) for of_pair in found]
    _show(command, {"known": values}, lines or ["no answer is known"])
    if found:
        _next_film(command, found[0].pair_id)
    elif not command.json:
        console.next(
            f"`gaitpref pairs --dataset {command.dataset} --gold 2` adds two questions"
        )


def _withdraw(command: options.Raters, dataset: Dataset) -> None:
    if command.known is not None:
        raise GaitprefError("--known adds a question, --withdraw ends one; give one")
    with dataset.answers() as store:
        pair = curation.find_pair(store, _name(command))
        curation.withdraw_known(store, pair, datetime.now(UTC))
    told = "is asked no more and measures nobody; its answers are kept"
    values = {"pair_id": pair.pair_id, "withdrawn": True}
    _show(command, values, [f"{pair.pair_id[:12]} {told}"])


def _next_film(command: options.Raters, pair_id: str) -> None:
    if not command.json:
        console.next(
            f"`gaitpref film --dataset {command.dataset} --pair {pair_id[:12]} "
            "--out known.gif` shows it"
        )


def _stats(command: options.Raters, dataset: Dataset) -> dict[str, Any]:
    with dataset.answers_copy() as store:
        rows, out = human_rows(store), curation.left_out(store)
    names = sorted({answer.rater_id for _, answer in rows})
    raters = [figures(rows, name) for name in names]
    together = all_figures(rows)
    doubted = {each.rater_id: doubts(rows, each) for each in raters}
    values = {
        "raters": [
            _as_json(of_rater)
            | {
                "doubts": doubted[of_rater.rater_id],
                "left_out": of_rater.rater_id in out,
            }
            for of_rater in raters
        ],
        "all": _as_json(together),
        "objections": dict(objections(rows)),
    }
    lines = table_of([*raters, together])
    lines += [told for name in names for told in doubted[name]]
    lines += [f"{name} is left out: the answers teach nothing" for name in sorted(out)]
    lines += [f"wrong with pairs: {said} ({n} x)" for said, n in objections(rows)[:10]]
    _show(command, values, lines)
    return values


def _as_json(of_rater: RaterFigures) -> dict[str, Any]:
    """The figures with every share spelled out beside its counts."""
    values = asdict(of_rater)
    for name in values:
        part = getattr(of_rater, name)
        if isinstance(part, Share):
            values[name] = asdict(part) | {"share": part.share}
    return values


def _name(command: options.Raters) -> str:
    if command.name is None:
        raise GaitprefError(
            f"whom? `gaitpref raters --dataset {command.dataset} {command.action} NAME`"
        )
    return command.name


def _next(command: options.Raters, dataset: Dataset, values: dict[str, Any]) -> None:
    text = next_of_raters(command.action, dataset, values)
    if text and not command.json:
        console.next(text)


def _show(command: options.Raters, values: dict[str, Any], lines: list[str]) -> None:
    if command.json:
        print(json.dumps(values))
        return
    for line in lines:
        say(shown(line))
