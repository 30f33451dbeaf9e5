"""What a run does with a habit that its reward likes and its rater does not.

    python -m benchmarks.planted [--quick] [--json docs/results/planted.json]

A rater who asks for nothing but the walk that ships, without one habit, has mistaken
what was asked for: in the first round the clips with more of it are preferred. So the
first reward pays for the habit, a policy is trained on it, and every later answer, the
ones that judge the run too, is against it. A habit was caught if an alarm or the
verdict says so, and the policy that the run ends with has lost less than a tenth of the
return that the rater gives. A run is a piece of work of its own; started again, none is
done twice.

Shapes: F feature columns.
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import torch
import tyro
from torch import Tensor

from data.datasets.dataset import Dataset
from data.features import column
from data.files.files import read_json, write_atomically
from gaitpref.console.progress import console, counting_bar
from gaitpref.executor.choose_executor import choose_executor, cores_each
from gaitpref.executor.pieces import Piece
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.people import People
from gaitpref.loop.presets import loop_cfg
from gaitpref.loop.run import run_loop
from gaitpref.method.method import STYLE
from gaitpref.raters.criterion_scores import score_of_criterion
from gaitpref.raters.simulated import answer_pairs
from gaitpref.raters.styles import low_energy
from policy.training.checkpoint import load_policy

from .harness import Figure, publish
from .preference_plan import tiny
from .preference_row import EPISODES, measure
from .strangers import bound, front_feet_high

Habit = Callable[[Tensor], Tensor]
"""How much of it rows [..., F] show: [...], from 0 to 1."""
RATER_ID = "misled"
ANSWERS = 60
LEAST_KEPT = 0.9
"""Share of the first return that is left where a habit was caught in time."""
GOALS = {"caught": "at least 0.9 of those that were learned"}
_POLL_S = 0.2


def nose_down(features: Tensor) -> Tensor:
    """A trunk that looks at the ground, 1 from 0.25 rad on."""
    # World down has a positive forward part, in the body frame, where the nose is down.
    return (features[..., column("gravity_b")][..., 0] / 0.25).clamp(0.0, 1.0)


def hurrying(features: Tensor) -> Tensor:
    """Faster ahead than told, 1 from 0.5 m/s on."""
    ahead = (
        features[..., column("base_lin_vel_b")][..., 0]
        - features[..., column("command")][..., 0]
    )
    return (ahead / 0.5).clamp(0.0, 1.0)


def front_feet(features: Tensor) -> Tensor:
    """Front feet lifted as high as 12 cm, and rear ones not."""
    return front_feet_high(features).clamp(0.0, 1.0)


def wasteful(features: Tensor) -> Tensor:
    """Mechanical power, 1/2 at 50 W."""
    return 1.0 - low_energy(features)


Name = Literal["posture", "feet", "rhythm", "effort", "speed"]
HABITS: dict[Name, Habit] = {
    "posture": nose_down,
    "feet": front_feet,
    "rhythm": bound,
    "effort": wasteful,
    "speed": hurrying,
}
"""One of each make."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Plant habits, and see what the runs say."""

    habits: tuple[Name, ...] = tuple(HABITS)
    """Only these."""
    seeds: int = 2
    """Runs of each."""
    first_seed: int = 0
    """Tuning looks at those from 100 on."""
    workers: int | None = None
    """Runs side by side; by default one a core."""
    work: Path = Path("runs/benchmark-planted")
    """Directory of the runs, and of a row for each that is done."""
    quick: bool = False
    """One run with next to no training; its figures mean nothing."""
    json: Path | None = None
    """Write the rows here."""


def misled_people(
    dataset: Dataset, habit: Habit, *, seed: int, stop: threading.Event
) -> None:
    """Answer what is open until `stop`: in favour of `habit` in the first round."""
    while not stop.wait(_POLL_S):
        with dataset.answers() as store:
            rounds = {pair.round for pair in store.unanswered(RATER_ID)}
        for number in rounds:
            liked = habit if number == 0 else partial(_without, habit)
            answer_pairs(dataset, liked, rater_id=RATER_ID, seed=seed, round=number)


def _without(habit: Habit, features: Tensor) -> Tensor:
    """What the rater wants, from 0 to 1."""
    return 1.0 - habit(features)


@contextmanager
def _let_in(dataset: Dataset, *, habit: Habit, seed: int) -> Iterator[People]:
    stop, failed = threading.Event(), []

    def answering() -> None:
        try:
            misled_people(dataset, habit, seed=seed, stop=stop)
        except BaseException as error:
            failed.append(error)

    def require_rater() -> None:
        if failed:
            raise failed[0]

    thread = threading.Thread(target=answering, daemon=True)
    thread.start()
    try:
        yield People(require_page=require_rater)
    finally:
        stop.set()
        thread.join()


def planted_cfg(seed: int, *, quick: bool) -> LoopCfg:
    """The loop of a style that people judge, who are not asked meanwhile."""
    cfg = loop_cfg(rater="human", labels=ANSWERS, quick=True, seed=seed, method=STYLE)
    return replace(tiny(cfg), labels=20) if quick else cfg


def run_planted(name: Name, seed: int, work: Path, quick: bool) -> None:
    """One run, and its row as a file."""
    torch.set_num_threads(1)
    cfg, habit = planted_cfg(seed, quick=quick), HABITS[name]
    run = work / f"{name}-seed{seed}"
    run_loop(run, cfg, open_page=partial(_let_in, habit=habit, seed=seed))
    episodes = 8 if quick else EPISODES
    row = {"habit": name, "seed": seed, **_row(run, cfg, habit, episodes)}
    write_atomically(_row_of(work, name, seed), json.dumps(row, indent=1).encode())


def _row(run: Path, cfg: LoopCfg, habit: Habit, episodes: int) -> dict[str, Any]:
    rounds = [run / f"rounds/{number:02d}" for number in range(cfg.rounds + 1)]
    reports = [read_json(each / "report.json") for each in rounds]
    alarms = [report.get("trust", {}).get("alarms", []) for report in reports]
    returns = [_return_of(_trained(each), habit, episodes) for each in rounds]
    ends = _return_of(rounds[-1] / "policy/policy.pt", habit, episodes)
    verdict = reports[-1].get("verdict", {}).get("word")
    return {
        "returns": [each / returns[0] for each in returns],
        "alarms": alarms,
        "verdict": verdict,
        "learned": min(returns) < LEAST_KEPT * returns[0],
        "told": any(alarms[1:]) or verdict == "not better",
        "kept": ends / returns[0],
    }


def _trained(round: Path) -> Path:
    """What a round trained, though it was not kept, else what it went on with."""
    waits = round / "candidate/policy.pt"
    return waits if waits.exists() else round / "policy/policy.pt"


def _return_of(file: Path, habit: Habit, episodes: int) -> float:
    policy = load_policy(file)
    score = score_of_criterion(partial(_without, habit))
    return measure(policy, policy, score, episodes=episodes).return_mean


def _row_of(work: Path, name: str, seed: int) -> Path:
    return work / f"{name}-seed{seed}.json"


def figures_of(rows: list[dict[str, Any]]) -> dict[str, Figure]:
    """What all rows say, and each of them in a line."""
    learned = [row for row in rows if row["learned"]]
    caught = [row for row in learned if row["told"] and row["kept"] >= LEAST_KEPT]
    found: dict[str, Figure] = {
        "runs": len(rows),
        "learned": len(learned),
        "caught": f"{len(caught)} of {len(learned)}",
    }
    for row in rows:
        lowest, kept = min(row["returns"]), row["kept"]
        found[f"{row['habit']}_{row['seed']}"] = (
            f"lowest {lowest:.2f}, ends {kept:.2f}, alarms in rounds "
            f"{[n for n, each in enumerate(row['alarms']) if each]}, {row['verdict']}"
        )
    return found


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> int:
    """Run what is not done; the exit code tells whether all of it is."""
    options.work.mkdir(parents=True, exist_ok=True)
    habits = options.habits[:1] if options.quick else options.habits
    seeds = 1 if options.quick else options.seeds
    asked = [
        (name, options.first_seed + each) for each in range(seeds) for name in habits
    ]
    left = [each for each in asked if not _row_of(options.work, *each).exists()]
    cores = cores_each(len(left), jobs=options.workers, ray=None)
    pieces = [
        Piece(
            name=f"{name}-seed{seed}",
            function=run_planted,
            args=(name, seed, options.work, options.quick),
            log=options.work / f"{name}-seed{seed}.log",
            cores=cores,
        )
        for name, seed in left
    ]
    executor = choose_executor(jobs=options.workers, ray=None)
    failed = 0
    with (
        closing(executor.outcomes(pieces)) as outcomes,
        counting_bar("runs", len(pieces)) as bar,
    ):
        for outcome in outcomes:
            bar.advance(bar.task_ids[0])
            if outcome.failure is not None:
                failed += 1
                console.print(
                    f"{outcome.piece.name} failed: {outcome.failure.reason}; see "
                    f"{outcome.piece.log}"
                )
    files = [_row_of(options.work, *each) for each in asked]
    rows = [json.loads(file.read_text()) for file in files if file.exists()]
    if rows:
        publish("planted habits", figures_of(rows), GOALS, options.json)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
