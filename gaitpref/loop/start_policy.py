"""Which policy a training goes on from, as the method decides it, written down."""

from __future__ import annotations

import json
import math

from data.files.files import read_json, write_atomically
from gaitpref.console.progress import console
from policy.rollouts.evaluate import evaluate
from policy.training.checkpoint import load_policy
from policy.training.ppo import ScoreFn

from .loop_cfg import LoopCfg
from .run_dir import Round, seed_of


def choose_start(cfg: LoopCfg, round: Round, score_fn: ScoreFn) -> None:
    """Write down which policy so far, of those no answers spoke against, the training
    of `round` goes on from by the newest reward, `score_fn`; nothing where it goes on
    from the last."""
    if round.began.exists() or cfg.method.start is None:
        return
    earlier = (Round(round.run, number) for number in range(round.number))
    worth = {
        each.number: _worth(cfg, each, score_fn) for each in earlier if _may_go_on(each)
    }
    best = cfg.method.start.choose(worth)
    if best != max(worth):
        console.print(
            f"round {round.number}: training goes on from the policy of round {best}, "
            f"which the newest reward likes best (return {worth[best]:.1f}, the last "
            f"policy {worth[max(worth)]:.1f})"
        )
    found = {"round": best, "learned_returns": worth}
    write_atomically(round.began, json.dumps(found, indent=1).encode())


def _may_go_on(round: Round) -> bool:
    """Whether no answers spoke against the policy of `round`."""
    if not round.approval.exists():
        return True
    return read_json(round.approval)["approved"]


def _worth(cfg: LoopCfg, round: Round, score_fn: ScoreFn) -> float:
    """Return of the round's policy under `score_fn`; none where nothing can be said of
    it, as its simulations diverge."""
    try:
        return evaluate(
            load_policy(round.policy),
            score_fn,
            episodes=cfg.evaluation_episodes,
            seed=seed_of(cfg, 0, 6),
        ).return_mean
    except ValueError:
        return -math.inf
