"""All that the live page tells of a run, as plain values; nothing of it is written.

Only finished files and those that grow at their end are read, so that a run never
notices. A file that is not whole yet, or any more, is told at the next look.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from data.errors import GaitprefError
from data.files.files import read_file, read_json
from data.files.lock import LOCK_NAME
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.policy_stage import partial_of, planned_steps
from gaitpref.loop.run_config import CONFIG_NAME, read_config
from gaitpref.loop.run_dir import Round
from gaitpref.loop.run_report import PAGE_NAME
from gaitpref.report.journal import Journal, read_journal
from gaitpref.report.verdict import Verdict
from policy.training.training_dir import POLICY_NAME, RESUME_NAME

from .event_files import LAG, RETURN, TRACKING, Scalars
from .run_stage import Answered, Place, answers_of, place_in

_MOST_POINTS = 400
"""Of a curve; a screen shows no more."""


class RunReader:
    """Reads a run or a training again and again, each time what is new."""

    def __init__(self, run: Path, *, now_s: Callable[[], float] = time.time) -> None:
        self._run, self._now_s = run, now_s
        self._scalars: dict[Path, Scalars] = {}

    def read(self) -> dict[str, Any]:
        """What is known now."""
        found: dict[str, Any] = {
            "name": self._run.resolve().name,
            "place": str(self._run),
            "running": _is_running(self._run),
            "report": (self._run / PAGE_NAME).exists(),
        }
        try:
            if (self._run / CONFIG_NAME).exists():
                found |= self._loop(read_config(self._run))
            else:
                found |= self._training()
        except (GaitprefError, LookupError, OSError, TypeError, ValueError) as error:
            # Read between two files of one change, or of another version.
            found |= {"kind": "unread", "told": f"cannot be read: {error}"}
        newest = _newest(self._run)
        found["quiet_s"] = None if newest is None else max(0.0, self._now_s() - newest)
        return found

    def report(self, limit: int) -> bytes:
        """The page of the run.

        Raises:
            FileError, OSError: there is none, or it is larger.
        """
        return read_file(self._run / PAGE_NAME, limit)

    def _training(self) -> dict[str, Any]:
        """Of a directory of `gaitpref train`."""
        scalars = self._read_on(self._run)
        if not scalars.steps and not (self._run / RESUME_NAME).exists():
            told = "nothing is here yet; this page waits for it"
            return {"kind": "empty", "told": told, "curves": []}
        done = (self._run / POLICY_NAME).exists()
        planned = scalars.planned or scalars.steps
        over = done and scalars.steps >= planned
        return {
            "kind": "training",
            "told": "finished" if over else "training",
            "finished": over,
            "progress": _progress(scalars.steps, planned, "steps"),
            "left_s": None if over else _left_s(scalars, planned),
            "curves": self._curves([(0, scalars)]),
        }

    def _loop(self, cfg: LoopCfg) -> dict[str, Any]:
        place = place_in(self._run, cfg)
        journal = read_journal(self._run)
        trainings = [
            (number, self._read_on(directory))
            for number in range(place.round + 1)
            if (directory := _training_of(Round(self._run, number))) is not None
        ]
        answered = answers_of(self._run, cfg)
        reports = [
            read_json(report)
            for number in range(cfg.rounds + 1)
            if (report := Round(self._run, number).report).exists()
        ]
        return {
            "kind": "loop",
            "told": place.told,
            "stage": place.stage,
            "finished": place.stage == "finished",
            "round": place.round,
            "rounds": cfg.rounds,
            "rater": cfg.rater_words if cfg.program else cfg.rater,
            "criterion": cfg.criterion,
            "answers": None if answered is None else vars(answered),
            "progress": self._progress(cfg, place, trainings, answered),
            **self._times_left(cfg, place, trainings, journal),
            "curves": self._curves(trainings),
            "table": [_row(report, journal) for report in reports],
            "alarms": [
                f"round {report['round']}: {reason}"
                for report in reports
                for reason in report.get("trust", {}).get("alarms", ())
            ],
            **self._verdict(reports),
        }

    def _verdict(self, reports: Sequence[dict[str, Any]]) -> dict[str, str | None]:
        """What the run came to, and what to do next; nothing before its end."""
        found = next((r["verdict"] for r in reports if r.get("verdict")), None)
        if found is None:
            return {"verdict": None, "advice": None}
        verdict = Verdict.from_json(found)
        return {"verdict": verdict.sentence, "advice": verdict.advice(self._run)}

    def _progress(
        self,
        cfg: LoopCfg,
        place: Place,
        trainings: list[tuple[int, Scalars]],
        answered: Answered | None,
    ) -> dict[str, Any] | None:
        """How far the present stage is, where that can be counted."""
        if place.stage == "training":
            planned = planned_steps(cfg, Round(self._run, place.round))
            steps = dict(trainings).get(place.round)
            return _progress(steps.steps if steps else 0, planned, "steps")
        if place.stage == "asking" and answered is not None:
            return _progress(answered.given, answered.most, "answers")
        return None

    def _times_left(
        self,
        cfg: LoopCfg,
        place: Place,
        trainings: list[tuple[int, Scalars]],
        journal: Journal,
    ) -> dict[str, float | None]:
        """Of the present training, and of the run without the time people take."""
        if place.stage == "finished":
            return {"left_s": None, "run_left_s": 0.0}
        of_round = dict(trainings).get(place.round)
        left_s = None
        if place.stage == "training" and of_round is not None:
            left_s = _left_s(
                of_round, planned_steps(cfg, Round(self._run, place.round))
            )
        rates = [rate for _, each in trainings if (rate := each.steps_per_s)]
        if not rates:
            return {"left_s": left_s, "run_left_s": None}
        to_train_s = left_s or 0.0
        for number in range(place.round + 1, cfg.rounds + 1):
            last = number == cfg.rounds
            to_train_s += (cfg.steps.last if last else cfg.steps.round) / rates[-1]
        besides = [
            took_s - each.steps / rate
            for number, each in trainings
            if (took_s := journal.took_s(number)) is not None
            and (rate := each.steps_per_s)
        ]
        if cfg.rater == "human" or not besides:
            besides = [0.0]
        rounds_left = cfg.rounds + 1 - place.round
        mean_s = max(0.0, sum(besides) / len(besides))
        return {"left_s": left_s, "run_left_s": to_train_s + rounds_left * mean_s}

    def _curves(self, trainings: list[tuple[int, Scalars]]) -> list[dict[str, Any]]:
        """Return, tracking error and, where actors collect, how old what they send is,
        over all steps so far: a line for each round."""
        curves = []
        for name, short, tag, unit in (
            ("Return of the training", "Return", RETURN, ""),
            ("Tracking error", "Tracking error", TRACKING, "m/s"),
            ("Age of rollouts", "Age of rollouts", LAG, "updates"),
        ):
            if tag == LAG and not any(scalars.points[tag] for _, scalars in trainings):
                continue
            lines, before = [], 0
            for number, scalars in trainings:
                points = _thinned(scalars.points[tag])
                line = [[before + step, value] for step, value, _ in points]
                lines.append({"round": number, "points": line})
                before += scalars.steps
            curves.append({"name": name, "short": short, "unit": unit, "lines": lines})
        return curves

    def _read_on(self, directory: Path) -> Scalars:
        scalars = self._scalars.setdefault(directory, Scalars(directory))
        scalars.read_on()
        return scalars


def _training_of(round: Round) -> Path | None:
    """The directory of a round's training, wherever it is by now."""
    places = (round.policy.parent, round.candidate, partial_of(round))
    return next((place for place in places if place.is_dir()), None)


def _row(report: dict[str, Any], journal: Journal) -> dict[str, Any]:
    evaluation, fit = report["evaluation"], report.get("fit") or {}
    number = report["round"]
    done = journal.done.get(number)
    return {
        "round": number,
        "return": evaluation["return_mean"],
        "return_ci95": evaluation["return_ci95"],
        "tracking_error_m_s": evaluation["tracking_error_m_s"],
        "falls_per_minute": evaluation["falls_per_minute"],
        "answers": fit.get("answers"),
        "accuracy": fit.get("held_out_accuracy"),
        "took_s": journal.took_s(number),
        "done_utc": None if done is None else done.isoformat(),
    }


def _progress(done: int, of: int, unit: str) -> dict[str, Any]:
    return {"done": min(done, of), "of": of, "unit": unit}


def _left_s(scalars: Scalars, planned: int) -> float | None:
    rate = scalars.steps_per_s
    return None if rate is None else max(0, planned - scalars.steps) / rate


def _thinned(points: list[tuple[int, float, float]]) -> list[tuple[int, float, float]]:
    """At most so many of them as can be seen, the last one included."""
    every = -(-len(points) // _MOST_POINTS) or 1
    return points[::-1][::every][::-1]


def _newest(run: Path) -> float | None:
    """When something of the run was last written, s since 1970."""
    patterns = ("*", "rounds/*/*", "rounds/*/policy.partial/*", "dataset/pref*")
    times = []
    for pattern in patterns:
        for path in run.glob(pattern):
            try:
                times.append(path.stat().st_mtime)
            except OSError:
                continue
    return max(times, default=None)


def _is_running(run: Path) -> bool | None:
    """Whether a process writes there; None where that cannot be known from here."""
    try:
        holder = read_file(run / LOCK_NAME, 200).decode(errors="replace").split()
    except (GaitprefError, OSError):
        return False
    if (
        len(holder) != 4
        or not holder[1].isdecimal()
        or holder[3] != socket.gethostname()
    ):
        return None
    try:
        os.kill(int(holder[1]), 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return None
    return True
