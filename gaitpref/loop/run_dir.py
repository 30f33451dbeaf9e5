"""Where a round's files are, and its chance comes from."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from data.files.files import read_json
from gaitpref.method.context import RoundContext
from policy.training.training_dir import POLICY_NAME, SUMMARY_NAME

from .loop_cfg import LoopCfg

STANDSTILL_NAME = "standstill.json"


@dataclass(frozen=True)
class Round:
    """The files of one round."""

    run: Path
    number: int

    @property
    def root(self) -> Path:
        """The directory that all of them are in."""
        return self.run / "rounds" / f"{self.number:02d}"

    @property
    def policy(self) -> Path:
        """The round's policy file."""
        return self.root / "policy" / POLICY_NAME

    @property
    def candidate(self) -> Path:
        """The directory of a policy that waits for approval, or did not get it."""
        return self.root / "candidate"

    @property
    def standstill(self) -> Path:
        """What the round's policy was trained to leave: such a one is not judged."""
        return self.policy.parent / STANDSTILL_NAME

    @property
    def shown(self) -> Path:
        """Names the episodes that show the round's policy beside the one before."""
        return self.root / "shown.json"

    @property
    def approval(self) -> Path:
        """What the answers said of the two."""
        return self.root / "approval.json"

    @property
    def verdict(self) -> Path:
        """What they said of the last policy, and those before it."""
        return self.root / "verdict.json"

    @property
    def reward(self) -> Path:
        """The reward fitted to all answers up to this round."""
        return self.root / "reward"

    @property
    def decided(self) -> Path:
        """What the first reward of a run says of the answers; only in its round."""
        return self.root / "decided.json"

    @property
    def report(self) -> Path:
        """All figures of the round; it is written last, and ends the round."""
        return self.root / "report.json"

    @property
    def recorded(self) -> Path:
        """Names the episodes of the round, once all are in the data set."""
        return self.root / "episodes.json"

    @property
    def on_the_way(self) -> Path:
        """Names the episodes of its training's checkpoints that people were asked
        about while it went on; only where they were."""
        return self.root / "on_the_way.json"

    @property
    def before(self) -> Round:
        """The round before.

        Raises:
            ValueError: this is the first.
        """
        if not self.number:
            raise ValueError("before round 0 there is none")
        return Round(self.run, self.number - 1)


def context_of(cfg: LoopCfg, round: Round) -> RoundContext:
    """What the decisions of `round` may know, once it begins."""
    return RoundContext(
        number=round.number,
        rounds=cfg.rounds,
        labels=cfg.labels,
        noisy=decided_before(round).get("noisy"),
    )


def decided_before(round: Round) -> dict[str, Any]:
    """What was decided of the answers before `round`; nothing where no reward was
    fitted yet."""
    earlier = (Round(round.run, number).decided for number in range(round.number))
    return next((read_json(path) for path in earlier if path.exists()), {})


def approved(round: Round) -> Path:
    """The newest policy, up to that of `round`, that no answers spoke against."""
    while round.approval.exists():
        if read_json(round.approval)["approved"]:
            break
        round = round.before
    return round.policy


def began_from(round: Round) -> Path:
    """The policy that the training of `round` began from."""
    return approved(round.before)


def trained_before(round: Round) -> tuple[Path, ...]:
    """The directory of the newest training before `round` that took steps; empty where
    there was none."""
    earlier = (Round(round.run, n).policy.parent for n in reversed(range(round.number)))
    took = (folder for folder in earlier if (folder / SUMMARY_NAME).exists())
    return tuple(islice(took, 1))


def seed_of(cfg: LoopCfg, *purpose: int) -> int:
    """A seed of its own for every purpose."""
    return int(np.random.SeedSequence([cfg.seed, *purpose]).generate_state(1)[0])


def place_of(cfg: LoopCfg, round: Round) -> str:
    """Where the loop is, for people, who count from 1."""
    if round.number == cfg.rounds:
        return "the last round"
    return f"round {round.number + 1} of {cfg.rounds}"
