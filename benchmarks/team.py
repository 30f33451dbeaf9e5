"""Two robots that share a reward: formation kept, by whom, and answers needed.

    python -m benchmarks.team [--quick] [--work DIR] [--json FILE]

Each seed makes a team of the walk that ships, records it with a lazy robot in half of
the episodes, has a simulated rater answer for the formation, and trains on the reward
in three ways of paying, with a policy for each robot, and on what the rater looks for
itself. A row is written when it is done; started again, nothing is done again.
"""

from __future__ import annotations

import json
import shutil
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro

from data.datasets.dataset import Dataset
from data.episodes.episode_records import Episode
from data.episodes.team_rows import sight_column, team_rows
from data.features import column
from data.files.files import write_atomically
from gaitpref.team.team_credit import standing_share
from gaitpref.team.team_criteria import formation
from policy.env.team_cfg import TeamCfg
from policy.robots.shipped import WALK
from policy.team.team_record import TeamRecordCfg, record_team
from policy.team.team_start import as_team
from policy.training.checkpoint import load_policy
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.errors import RewardError
from rewardmodel.team.team_fit import fit_team, rows_in

from .harness import Figure, gaitpref, publish

Pay = Literal["shares", "same", "counterfactual", "truth", "two"]
PAYS: tuple[Pay, ...] = ("shares", "same", "counterfactual", "truth", "two")
"""Ways to train; `two` has a policy for each robot, each paid its share."""
GOALS = {
    "lazy_named": "all",
    "shares_gain": "> 0",
}
Row = dict[str, Figure]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure teams."""

    quick: bool = False
    """One seed, few answers and steps."""
    seeds: int = 3
    """Trainings of each kind."""
    steps: int = 400_000
    """Of each training, over all robots."""
    robots: int = 64
    """Side by side."""
    answers: tuple[int, ...] = (20, 40, 60, 100)
    """Of these many the reward is measured; it is trained on the last."""
    episodes: int = 40
    """Recorded for the answers."""
    pays: tuple[Pay, ...] = PAYS
    """Ways to train; with none of them, `--pays`, the rows of answers and of lazy
    robots are made alone."""
    work: Path = Path("runs/benchmark-team")
    """Where it is made; rows.json there holds what is done."""
    json: Path | None = None
    """Write the figures here."""


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Do what is not done yet, and publish all of it."""
    torch.set_num_threads(1)
    if options.quick:
        options = Options(
            seeds=1,
            steps=384,
            robots=8,
            answers=(12, 20),
            episodes=8,
            pays=options.pays,
            work=options.work,
            json=options.json,
        )
    rows = Rows(options.work / "rows.json")
    for seed in range(options.seeds):
        _seed(options, seed, rows)
    publish("two robots, one reward", summary(rows.kept), GOALS, options.json)


class Rows:
    """What is done, in a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.kept: list[Row] = json.loads(path.read_text()) if path.exists() else []

    def has(self, **key: Figure) -> bool:
        """Whether there is a row of this."""
        return any(key.items() <= row.items() for row in self.kept)

    def add(self, row: Row) -> None:
        """Keep a row."""
        self.kept.append(row)
        write_atomically(self._path, json.dumps(self.kept, indent=1).encode())


def _seed(options: Options, seed: int, rows: Rows) -> None:
    work = options.work / f"{seed}"
    work.mkdir(parents=True, exist_ok=True)
    base, dataset, reward = work / "base.pt", work / "set", work / "reward"
    base.write_bytes(as_team(WALK, TeamCfg()))
    if not rows.has(seed=seed, kind="before"):
        rows.add({"seed": seed, "kind": "before", **walked(base, seed)})
    if not reward.is_dir():
        _answered(options, seed, base, dataset)
    for count in options.answers:
        if not rows.has(seed=seed, kind="answers", answers=count):
            found = foreseen(dataset, count, seed)
            rows.add({"seed": seed, "kind": "answers", "answers": count, **found})
    if not reward.is_dir():
        gaitpref("team", "fit", "--dataset", dataset, "--out", reward)
    if not rows.has(seed=seed, kind="lazy"):
        rows.add({"seed": seed, "kind": "lazy", **lazy_named(reward, dataset)})
    for pay in options.pays:
        if rows.has(seed=seed, kind=pay):
            continue
        out = work / pay
        paid = _paid(reward, pay)
        gaitpref(
            *("team", "train", "--out", out, "--init", base, *paid, "--resume"),
            *("--steps", str(options.steps), "--robots", str(options.robots)),
            *("--seed", str(seed)),
        )
        rows.add({"seed": seed, "kind": pay, **walked(out / "policy.pt", seed)})


def _paid(reward: Path, pay: str) -> list[str]:
    if pay == "truth":
        return ["--reward", "formation"]
    if pay == "two":
        return ["--reward", str(reward), "--pay", "shares", "--policies", "2"]
    return ["--reward", str(reward), "--pay", pay]


def _answered(options: Options, seed: int, base: Path, dataset: Path) -> None:
    """A data set with answers, made anew."""
    shutil.rmtree(dataset, ignore_errors=True)
    own = ["--dataset", str(dataset), "--seed", str(seed)]
    count = str(options.episodes)
    gaitpref(
        "team", "record", "--policy", base, *own, "--episodes", count, "--lazy", "0.5"
    )
    gaitpref("pairs", *own, "--count", str(options.answers[-1]))
    gaitpref("team", "answer", *own)


def foreseen(dataset: Path, count: int, seed: int) -> Row:
    """How often a reward of the first `count` answers is right about held-out ones."""
    opened = [Dataset.open(dataset)]
    pairs = load_pairs(opened)
    some = pairs.subset(torch.arange(len(pairs)) < count)
    try:
        report = fit_team(some, rows_in(opened), seed=seed).report
    except RewardError:
        return {"accuracy": None, "held_out": 0}
    return {"accuracy": report.held_out_accuracy, "held_out": report.held_out_pairs}


def lazy_named(reward: Path, dataset: Path) -> Row:
    """Whether `team shares` sees who is lazy, and by how much the shares differ."""
    told = json.loads(
        gaitpref(
            *("team", "shares", "--reward", reward, "--dataset", dataset, "--json")
        ).stdout
    )["lazy_on_purpose"]
    found: Row = {}
    for who in ("1", "2"):
        if who in told:
            share = told[who]["mean"]["share"]
            found[f"less_{who}"] = share[2 - int(who)] - share[int(who) - 1]
            verdict = told[who]["verdict"]
            earns_less = f"robot {who} earns" in verdict
            found[f"earns_less_{who}"] = earns_less
            found[f"named_{who}"] = f"robot {who} is lazy" in verdict or (
                earns_less and "it is lazy" in verdict
            )
    return found


def walked(policy: Path, seed: int) -> Row:
    """How a policy keeps the formation without noise, and which robot how well."""
    cfg = TeamRecordCfg(episodes=20, episode_s=8.0, noisy_share=0.0)
    episodes = list(record_team(load_policy(policy), cfg, seed=1000 + seed))
    figures = [_of_episode(episode) for episode in episodes]
    return {name: statistics.mean(f[name] for f in figures) for name in figures[0]}


def _of_episode(episode: Episode) -> dict[str, float]:
    rows = torch.from_numpy(team_rows(episode))
    ahead, left = rows[..., sight_column("mate_pos_h")].unbind(-1)
    told = rows[..., column("command")][..., :2]
    missed = torch.linalg.vector_norm(
        told - rows[..., column("base_lin_vel_b")][..., :2], dim=-1
    ).mean(dim=0)
    still = standing_share(rows)
    return {
        "formation": float(formation(rows).mean()),
        "gap_error_m": float((left.abs() - 0.8).abs().mean()),
        "lag_m": float(ahead.abs().mean()),
        "error_1_m_s": float(missed[0]),
        "error_2_m_s": float(missed[1]),
        "stands_1": still[0],
        "stands_2": still[1],
        "fell": float(episode.end_reason == "terminated"),
    }


def summary(rows: Sequence[Row]) -> dict[str, Figure]:
    """Means over seeds, and the gain of each way to pay over the policy before."""
    figures: dict[str, Figure] = {}
    by_kind: dict[str, list[Row]] = {}
    for row in rows:
        by_kind.setdefault(str(row["kind"]), []).append(row)

    def mean(kind: str, name: str) -> float | None:
        found = [row[name] for row in by_kind.get(kind, []) if name in row]
        numbers = [float(value) for value in found if isinstance(value, int | float)]
        return statistics.mean(numbers) if numbers else None

    before = mean("before", "formation")
    for kind in ("before", *PAYS):
        for name in ("formation", "gap_error_m", "lag_m", "fell"):
            figures[f"{kind}_{name}"] = mean(kind, name)
        for robot in (1, 2):
            for name in (f"error_{robot}_m_s", f"stands_{robot}"):
                figures[f"{kind}_{name}"] = mean(kind, name)
        after = mean(kind, "formation")
        if kind != "before" and after is not None and before is not None:
            figures[f"{kind}_gain"] = after - before
    for row in by_kind.get("answers", []):
        name = f"accuracy_{row['answers']}"
        alike = [r for r in by_kind["answers"] if r["answers"] == row["answers"]]
        known = [r["accuracy"] for r in alike if isinstance(r["accuracy"], float)]
        figures[name] = statistics.mean(known) if known else None
    for name in ("named", "earns_less"):
        found = [
            value
            for row in by_kind.get("lazy", [])
            for key, value in row.items()
            if key.startswith(name)
        ]
        figures[f"lazy_{name}"] = f"{sum(map(bool, found))} of {len(found)}"
    for robot in (1, 2):
        figures[f"lazy_less_{robot}"] = mean("lazy", f"less_{robot}")
    return figures


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
