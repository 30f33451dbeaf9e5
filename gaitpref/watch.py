"""Whether the loop may believe its reward: watched in training, judged every round.

Shapes: T steps of a rollout, N environments, F feature columns.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from data.dataset import Dataset
from data.files import read_json, write_atomically
from policy.reward_ppo import OfRollout, ScoreFn, figures_of, history_of
from rewardmodel.held_out_report import Foreseen, foresee
from rewardmodel.model import RewardModel
from rewardmodel.pairs import AnsweredPairs, load_pairs
from rewardmodel.storage import load_reward
from rewardmodel.support import Drift, Support, support_of
from rewardmodel.trust import (
    ENOUGH_NEWEST,
    alarms,
    disagree,
    left_for_pay,
    prefers,
    reach,
    spelled,
    unforeseen_sides,
)

from .findings import about_raters
from .loop_cfg import LoopCfg
from .rounds import Round, seed_of
from .trust_command import alarm_json, as_json

WATCH_NAME = "watch.json"

PATIENCE = 2
"""Iterations in a row that must look bad: a single rollout may be odd."""
RISE = 0.1
"""Rise of the learned reward, in its standard deviations, that counts as one."""


class WatchedReward:
    """A reward that notices when a policy leaves what was judged and is paid for it."""

    def __init__(
        self, reward: ScoreFn, model: RewardModel, support: Support, limit: float
    ) -> None:
        """Watch `reward`, of which `model` is the learned part, against `support`.

        Args:
            reward: What the policy is trained on; passed through as it is.
            model: The learned reward.
            support: Of the answers it was fitted to.
            limit: Share of motion beyond what was judged that looks bad.
        """
        self._reward, self._model, self._support = reward, model, support
        self._limit = limit
        self._first: float | None = None
        self._bad = 0
        self.drift: Drift | None = None
        """Of the newest rollout."""
        self.rise = 0.0
        """Of the learned reward since the first rollout seen."""

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        """Reward [T, N] of rows [T, N, F], which are one rollout."""
        return self.of_rollout(features, starts, len(features))

    def of_rollout(self, features: Tensor, starts: Tensor, steps: int) -> Tensor:
        """Reward [steps, N] of the rollout that the last `steps` of the rows are."""
        self._look(features, starts, steps)
        if isinstance(self._reward, OfRollout):
            return self._reward.of_rollout(features, starts, steps)
        return self._reward(features, starts)[-steps:]

    def identity(self) -> Any:
        """What it is made of, without what it has seen."""
        return [type(self).__name__, self._reward, self._limit]

    @property
    def history_steps(self) -> int:
        """How far the reward looks back."""
        return history_of(self._reward)

    @property
    def figures(self) -> dict[str, float]:
        """What the reward tells of the rollout scored last."""
        return figures_of(self._reward)

    @property
    def alarm(self) -> str | None:
        """Why training should not go on before people have been asked."""
        if self._bad < PATIENCE or self.drift is None:
            return None
        return (
            f"the learned reward rose by {self.rise:.2f} where nobody has judged: "
            f"{spelled(self.drift)}"
        )

    def _look(self, features: Tensor, starts: Tensor, steps: int) -> None:
        mean = float(self._model(features, starts)[-steps:].mean())
        self._first = mean if self._first is None else self._first
        self.rise = mean - self._first
        # A piece must not reach across a reset.
        valid = ~starts[-steps:].bool()
        valid[0] = True
        self.drift = self._support.drift(features[-steps:].cpu(), valid.cpu())
        far = self.drift is not None and left_for_pay(self.drift, self._limit)
        self._bad = self._bad + 1 if far and self.rise > RISE else 0

    def remembered(self) -> dict[str, Any]:
        """What it has seen so far, for a training that is resumed."""
        drift = None if self.drift is None else asdict(self.drift)
        return {
            "first": self._first,
            "bad": self._bad,
            "rise": self.rise,
            "drift": drift,
        }

    def recall(self, state: dict[str, Any]) -> None:
        """Go on from what `remembered` gave."""
        self._first, self._bad = state["first"], state["bad"]
        self.rise = state["rise"]
        self.drift = None if state["drift"] is None else Drift(**state["drift"])

    def save(self, folder: Path) -> None:
        """Leave the last figures beside the policy."""
        share = None if self.drift is None else self.drift.share_beyond
        found = {
            "alarm": self.alarm,
            "share_beyond": share,
            "extrapolated": None if self.drift is None else self.drift.extrapolated,
            "learned_rise": self.rise,
        }
        write_atomically(folder / WATCH_NAME, json.dumps(found).encode())


def watched(
    cfg: LoopCfg, round: Round, dataset: Dataset, reward: ScoreFn
) -> WatchedReward | None:
    """`reward` of the round, watched; None where the loop lets policies go anywhere."""
    if cfg.far_limit is None:
        return None
    model = load_reward(round.before.reward)
    before = judged_before(load_pairs([dataset], at_least=0), round)
    if before is None:
        return None
    support = support_of(before, model)
    return WatchedReward(reward, model, support, cfg.far_limit)


def deserves_training(round: Round) -> bool:
    """Whether the reward of a finished round may be trained on."""
    return bool(_trust_in(round).get("deserves_training", True))


def why_not_trained(round: Round) -> str:
    """What the answers do, where the reward of a finished round may not be."""
    if _trust_in(round).get("too_little"):
        return "prefer too little"
    return "do not agree"


def _trust_in(round: Round) -> dict[str, Any]:
    return read_json(round.report).get("trust", {})


def trust_of_round(
    cfg: LoopCfg,
    round: Round,
    dataset: Dataset,
    features: Tensor,
    lengths: Tensor,
    *,
    return_rose: bool,
) -> dict[str, Any]:
    """What a round's report says of trust.

    Args:
        cfg: The loop.
        round: Its newest round.
        dataset: With the answers so far.
        features: [T, N, F] of the round's policy without exploration noise.
        lengths: [N] of its episodes.
        return_rose: Whether training raised the learned return.
    """
    pairs = load_pairs([dataset], at_least=0)
    before = judged_before(pairs, round)
    reached, foreseen = None, None
    found: dict[str, Any] = {"confirmed": False}
    if before is not None:
        trained_on = load_reward(round.before.reward)
        reached = reach(trained_on, before, features, lengths)
    too_little = pairs.too_little if round.reward.exists() else ""
    if round.reward.exists() and not too_little:
        model = load_reward(round.reward)
        foreseen = foresee(model, pairs, seed=seed_of(cfg, round.number, 5))
        found["raters"] = about_raters(model.provenance.report, pairs.sides)
        if before is not None and was_judged(foreseen):
            found["confirmed"] = prefers(model, features, lengths, before)
    distrusted = foreseen is not None and (
        disagree(foreseen) or bool(unforeseen_sides(foreseen, pairs.sides))
    )
    reasons = alarms(
        foreseen,
        reached,
        return_rose=return_rose,
        confirmed=found["confirmed"],
        sides=pairs.sides if foreseen else (),
    )
    if too_little:
        found["too_little"] = too_little
        reasons = (f"{too_little}: it is 0, and trained on by nobody", *reasons)
    watch = round.policy.parent / WATCH_NAME
    if watch.exists():
        found["watch"] = read_json(watch)
        if found["watch"]["alarm"]:
            reasons = (*reasons, found["watch"]["alarm"])
    found["deserves_training"] = not (distrusted or too_little)
    return as_json(foreseen, reached) | found | alarm_json(reasons)


def was_judged(foreseen: Foreseen) -> bool:
    """Whether enough answers about the newest round's clips say what they are worth."""
    newest = foreseen.newest
    return newest is not None and newest.answers >= ENOUGH_NEWEST


def judged_before(pairs: AnsweredPairs, round: Round) -> AnsweredPairs | None:
    """Those of the answers that the reward of the round before was fitted to; None
    where there was none."""
    earlier = torch.tensor(pairs.rounds) < round.number
    return pairs.subset(earlier) if earlier.any() else None
