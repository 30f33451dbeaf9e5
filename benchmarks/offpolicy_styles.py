"""A style out of a data set alone, and out of answers, beside PPO.

Parts of `benchmarks.offpolicy`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from data.files.files import write_atomically
from gaitpref.cli.shared.off_policy import EXIT_NO_GAIN
from gaitpref.console.terminal import EXIT_BAD_INPUT

from .harness import Figure, gaitpref, median
from .offpolicy_plan import FAST, Options, earned, more_of


def offline(options: Options) -> dict[str, Figure]:
    """The share of a style that comes out of a data set alone, by weight of cloning and
    seed."""
    base = earned(options, options.style, options.base)
    figures: dict[str, Figure] = {"offline_base_return": base}
    shares: dict[float, list[float]] = {weight: [] for weight in options.clone_weights}
    for seed in options.seeds:
        row = _offline_row(options, seed)
        online = earned(options, options.style, row / "online/policy.pt") - base
        figures[f"online_gain_{seed}"] = online
        for weight, found in shares.items():
            out = row / _name(weight)
            gain = earned(options, options.style, out / "policy.pt") - base
            found.append(_share(gain, online))
            summary = json.loads((out / "summary.json").read_text())
            figures |= {
                f"{_name(weight)}_gain_{seed}": gain,
                f"{_name(weight)}_share_{seed}": found[-1],
                f"{_name(weight)}_distance_{seed}": summary["offline/action_distance"],
            }
    medians = {f"{_name(w)}_share_median": median(s) for w, s in shares.items()}
    return {**figures, **medians}


def _name(weight: float) -> str:
    """Of a training with this weight of cloning."""
    return f"offline_clone_{weight:g}"


def _share(gain: float, whole: float) -> float:
    """Of PPO's gain; 0 where that is none."""
    return gain / whole if whole > 0 else 0.0


def _offline_row(options: Options, seed: int) -> Path:
    """The directory of a seed's data set and its trainings, finished."""
    row = options.work / f"offline-{options.style}-{seed}"
    _once(
        row / "recorded",
        *("record", "--policy", options.base, "--dataset", row / "set"),
        *("--episodes", str(options.recorded), "--varied", "0.5"),
        *("--seed", str(seed)),
    )
    reward = ("--reward", options.style, "--keep-task", "--init", options.base)
    chance = ("--seed", str(seed), "--resume")
    for weight in options.clone_weights:
        _once(
            row / f"{_name(weight)}-done",
            *("train", "--out", row / _name(weight), *reward, *chance, *FAST),
            *("--offline", "--steps", str(options.offline_steps), *more_of(options)),
            *("--replay", row / "set", "--clone-weight", str(weight)),
            # Where nothing is gained, or the data are left behind, this is a figure.
            well=(0, EXIT_NO_GAIN, EXIT_BAD_INPUT),
        )
    _once(
        row / "online-done",
        *("train", "--out", row / "online", *reward, *chance),
        *("--steps", str(options.online_steps)),
    )
    return row


def _once(done: Path, *command: str | Path, well: Sequence[int] = (0,)) -> None:
    """Run a command that did not come to its end before."""
    if not done.exists():
        gaitpref(*command, well=well)
        write_atomically(done, b"")


def answers(options: Options) -> dict[str, Figure]:
    """The share of PPO's gain in what the rater looks for, seed by seed."""
    figures: dict[str, Figure] = {}
    shares = []
    for seed in options.seeds:
        gains = {
            name: _answered(options, name, seed, more)
            for name, more in (("ppo", ()), ("fastsac", FAST))
        }
        figures |= {f"answers_gain_{name}_{seed}": g for name, g in gains.items()}
        shares.append(_share(gains["fastsac"], gains["ppo"]))
        figures[f"answers_share_{seed}"] = shares[-1]
    return {**figures, "answers_share_median": median(shares)}


def _answered(options: Options, name: str, seed: int, more: Sequence[str]) -> float:
    """What a loop gained on what it began with, by what its rater looks for."""
    run = options.work / f"answers-{options.style}-{seed}" / name
    _once(
        run.with_name(f"{name}-done"),
        *("loop", "--run", run, "--criterion", options.style, "--base", options.base),
        *("--labels", str(options.labels), "--rounds", str(options.rounds)),
        *("--steps", str(options.answered_steps), "--seed", str(seed), *more),
    )
    first, last = (
        json.loads((run / f"rounds/{number:02d}/report.json").read_text())
        for number in (0, options.rounds)
    )
    return last["evaluation"]["return_mean"] - first["evaluation"]["return_mean"]
