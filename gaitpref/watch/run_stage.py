"""Where a loop is, told by which of its files are finished."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from data.answers.store import AnswerStore
from data.errors import AnswerError
from gaitpref.loop.loop_cfg import LoopCfg
from gaitpref.loop.run_dir import Round, place_of
from rewardmodel.asking.asked_meanwhile import asked_and_left

Stage = Literal["training", "recording", "asking", "measuring", "finished"]


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a loop is."""

    stage: Stage
    round: int
    told: str
    """For people."""


@dataclass(frozen=True, kw_only=True)
class Answered:
    """Answers of a run."""

    given: int
    most: int
    """How many are asked for at most."""
    open: int
    """Questions that wait for somebody."""


def place_in(run: Path, cfg: LoopCfg) -> Place:
    """Where the loop in `run` is, or was when it ended."""
    rounds = (Round(run, number) for number in range(cfg.rounds + 1))
    round = next((r for r in rounds if not r.report.exists()), None)
    if round is None:
        told = f"finished: {cfg.rounds} rounds and the last training"
        return Place(stage="finished", round=cfg.rounds, told=told)
    stage, doing = _stage(round, cfg)
    return Place(
        stage=stage, round=round.number, told=f"{place_of(cfg, round)}: {doing}"
    )


def _stage(round: Round, cfg: LoopCfg) -> tuple[Stage, str]:
    if not (round.policy.exists() or round.candidate.exists()):
        return "training", "training"
    if round.number == cfg.rounds:
        if cfg.method.accept is None or round.verdict.exists():
            return "measuring", "measuring what came of it"
        return "asking", "asking whether it worked"
    if not round.recorded.exists():
        return "recording", "recording what the policy does"
    if not round.reward.exists():
        return "asking", "asking which clips are better, and learning from it"
    return "measuring", "measuring what was learned"


def answers_of(run: Path, cfg: LoopCfg) -> Answered | None:
    """How many there are; None where they are kept elsewhere, or cannot be read now."""
    path = run / "dataset" / "preferences.sqlite"
    if not path.exists():
        # Questions follow what was recorded.
        elsewhere = Round(run, 0).recorded.exists()
        return None if elsewhere else Answered(given=0, most=cfg.labels, open=0)
    try:
        with AnswerStore.snapshot(path) as store:
            asked = [asked_and_left(store, n) for n in range(cfg.rounds + 1)]
    except (AnswerError, OSError):
        return None
    return Answered(
        given=sum(all_of - left for all_of, left in asked),
        most=max(cfg.labels, sum(all_of for all_of, _ in asked)),
        open=sum(left for _, left in asked),
    )
