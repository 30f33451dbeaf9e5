"""Which policy a training goes on from.

A reward learned in between knows more than the one a policy was trained on: where the
training went too far, or followed what later answers took back, an earlier policy is
better, and the newest reward says so without another answer.
"""

from __future__ import annotations

import json
import math

from data.files import read_json, write_atomically
from policy.checkpoint import load_policy
from policy.evaluate import evaluate
from policy.ppo import ScoreFn

from .loop_cfg import LoopCfg
from .progress import console
from .rounds import Round, seed_of


def choose_start(cfg: LoopCfg, round: Round, score_fn: ScoreFn) -> None:
    """Write down which policy so far the newest reward, `score_fn`, likes best, of
    those no answers spoke against; nothing where training goes on from the last."""
    if round.began.exists() or not cfg.from_best or not cfg.keeps_task:
        return
    earlier = (Round(round.run, number) for number in range(round.number))
    worth = {
        each.number: _worth(cfg, each, score_fn) for each in earlier if _may_go_on(each)
    }
    # Of policies that are worth the same the newest, as where one stayed for a round.
    best = max(worth, key=lambda number: (worth[number], number))
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
