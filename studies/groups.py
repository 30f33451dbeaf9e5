"""Whether raters who want different things are told apart, and others are not.

`python -m studies.groups --base POLICY` has five simulated raters answer pairs of
recorded clips drawn at random, and prints a line of JSON for every draw.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
import tyro

from benchmarks.preference_plan import TASKS
from gaitpref.method.method import STYLE
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from policy.training.checkpoint import load_policy
from rewardmodel.answers.answered_pairs import AnsweredPairs, gather_pairs
from rewardmodel.asking.clip_questions import ask
from rewardmodel.posterior.group_raters import group_raters

from .few_answers import CUT, FewAnswers, Recording, recordings

Wish = tuple[str, ...]
"""Task of every rater, or two tasks of one who changes in the middle: `a>b`."""
DRAWS: dict[str, tuple[Wish, float]] = {
    "two groups": (("high_step",) * 3 + ("crouch",) * 2, 0.0),
    "two groups, a tenth wrong": (("high_step",) * 3 + ("crouch",) * 2, 0.1),
    "one group": (("high_step",) * 5, 0.0),
    "one group, a fifth wrong": (("high_step",) * 5, 0.2),
    "one changes": (("high_step", "high_step", "high_step>crouch"), 0.0),
}
"""What the raters of a draw want, and the share of their answers that is wrong."""


@dataclass(frozen=True, kw_only=True)
class Groups:
    """Draw, group."""

    base: Path
    """Walking policy."""
    work: Path = Path("runs/few-answers")
    """Directory of the recordings."""
    answers: int = 40
    """Answers of each rater."""
    draws: int = 10
    """Draws of each kind."""
    only: tuple[str, ...] = ()
    """Only these kinds."""


def answered(
    recording: Recording,
    worth: dict[str, dict[str, np.ndarray]],
    wish: Wish,
    mistakes: float,
    count: int,
    rng: np.random.Generator,
) -> AnsweredPairs:
    """Answers of raters who want `wish`, about pairs of equal commands."""
    entries = list(recording.entries.values())
    pairs, targets, raters, times = [], [], [], []
    for number, wanted in enumerate(wish):
        tasks = wanted.split(">")
        own = ask(
            recording.dataset,
            entries,
            CUT,
            count,
            known=[],
            model=None,
            round_number=0,
            uniform_share=1.0,
            strategy="information",
            rng=rng,
        )
        for place, pair in enumerate(own):
            task = tasks[place * len(tasks) // len(own)]
            left, right = (
                worth[task][clip.rollout][clip.rows].mean() for clip in (pair.a, pair.b)
            )
            wrong = rng.random() < mistakes
            pairs.append(pair)
            targets.append(float((left > right) != wrong))
            raters.append(f"rater {number}")
            times.append(f"2030-01-31T12:{place:02d}:00Z")
    return replace(
        gather_pairs([recording.dataset], pairs),
        target=torch.tensor(targets),
        raters=tuple(raters),
        times=tuple(times),
        recorded=recording.pool,
    )


def main(cfg: Groups) -> None:
    """Print what was found in every draw, and then how often it was right."""
    torch.set_num_threads(1)
    recording, _ = recordings(FewAnswers(base=cfg.base, work=cfg.work))
    policy = load_policy(cfg.base)
    context = criterion_context(policy.robot(), policy.info.env)
    worth = {
        task: recording.worth(score_of_criterion(load_criterion(TASKS[task], context)))
        for task in ("high_step", "crouch")
    }
    for kind, (wish, mistakes) in DRAWS.items():
        if cfg.only and kind not in cfg.only:
            continue
        right = 0
        for draw in range(cfg.draws):
            rng = np.random.default_rng([draw, 7])
            pairs = answered(recording, worth, wish, mistakes, cfg.answers, rng)
            found = group_raters(pairs, STYLE.reward, seed=draw)
            groups = sorted(group.raters for group in found.groups)
            steady = [n for n, wanted in enumerate(wish) if ">" not in wanted]
            meant = sorted(
                tuple(f"rater {n}" for n in steady if wish[n] == task)
                for task in {wish[n] for n in steady}
            )
            kept = sorted(
                tuple(r for r in group if int(r[-1]) in steady) for group in groups
            )
            changed = {each.rater for each in found.changed}
            changes = {f"rater {n}" for n in range(len(wish)) if n not in steady}
            ok = [group for group in kept if group] == meant and changed == changes
            right += ok
            row = {"kind": kind, "draw": draw, "right": ok, "groups": groups}
            print(json.dumps(row | {"changed": sorted(changed)}), flush=True)
        print(json.dumps({"kind": kind, "right": right, "of": cfg.draws}), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Groups))
