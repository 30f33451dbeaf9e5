"""What a person likes while driving: two robots under the same commands, and a word."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import dataclass

from data.answers.answer_records import Answer, Pair, now_utc
from data.answers.strategy_names import DRIVEN
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from policy.rollouts.driven_policy import DrivenPolicy

SHORTEST_S = 1.2
"""Less than a clip of other questions is not judged."""


@dataclass(frozen=True)
class Liked:
    """Keeps what two robots did last, and which of them was liked."""

    dataset: Dataset
    rater_id: str

    def __call__(self, robots: Sequence[DrivenPolicy], liked: int) -> str:
        """Prefer the robot `liked`, 0 or 1, to the other one; gives what to say."""
        dt_s = robots[0].control_dt_s
        steps = min(robot.steps for robot in robots)
        name = "AB"[liked]
        if steps * dt_s < SHORTEST_S - 1e-9:
            return (
                f"not kept: {steps * dt_s:.1f} s since the last push, start or other "
                f"command, and {SHORTEST_S:g} s are judged at least; drive on a little"
            )
        episodes = [robot.episode(steps) for robot in robots]
        entries = self.dataset.add_episodes(episodes)
        a, b = (Clip(entry.sha256, 0, entry.num_steps) for entry in entries)
        if a == b:
            return "not kept: both robots did exactly the same"
        pair = Pair.make(a, b, strategy=DRIVEN, round=0)
        answer = Answer(
            answer_id=str(uuid.uuid4()),
            pair_id=pair.pair_id,
            rater_id=self.rater_id,
            choice="a" if liked == 0 else "b",
            shown_left="a",
            created_utc=now_utc(),
        )
        with self.dataset.answers() as store:
            store.add_rater(self.rater_id, "human")
            store.add_pairs([pair])
            store.add_answer(answer)
            count = store.count()
        judged = f"of the last {steps * dt_s:.1f} s"
        return f"kept: {name} is better, {judged}; answers so far: {count}"
