"""Gaits chosen and run on a course in many environments at once, as transitions.

Shapes: N environments, D numbers that a chooser sees, B transitions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from policy.env.env import QuadrupedEnv
from policy.env.feature_row import OBS_DIM

from .choice_row import choice_rows
from .choosing import Running, looks
from .gaits_model import GaitsModel, begins, seen_by_chooser

RewardOfChoices = Callable[[Tensor], Tensor]
"""Reward per second [N] of choice rows [N, C]."""


@dataclass(frozen=True, eq=False)
class Transitions:
    """Gaits that ran for a while; [B, ...] each."""

    seen: Tensor
    """[B, D] where each began"""
    gait: Tensor
    paid: Tensor
    """Discounted reward while it ran."""
    steps: Tensor
    """Control steps that it ran."""
    after: Tensor
    """[B, D] where it led to"""
    over: Tensor
    """It led to a fall."""

    def __len__(self) -> int:
        return len(self.gait)

    def rows(self, which: Tensor) -> Transitions:
        """Some of them."""
        return Transitions(*(getattr(self, name)[which] for name in FIELDS))

    @staticmethod
    def joined(parts: list[Transitions]) -> Transitions:
        """All of them."""
        return Transitions(
            *(torch.cat([getattr(part, name) for part in parts]) for name in FIELDS)
        )


FIELDS = ("seen", "gait", "paid", "steps", "after", "over")


@dataclass(frozen=True, kw_only=True)
class Collected:
    """What some control steps gave."""

    transitions: Transitions
    falls: int
    changes: int
    moved_m: float
    """All robots together."""


class Collector:
    """Steps one batch of environments; what runs goes on from call to call."""

    def __init__(
        self,
        env: QuadrupedEnv,
        model: GaitsModel,
        reward: RewardOfChoices,
        *,
        gamma: float,
    ) -> None:
        """
        Args:
            env: On a course, made with `keep_final`.
            model: Chooses; its `rng` and `explored` say how much by chance.
            reward: What is paid; changes are left to the learner.
            gamma: Discount of one control step.
        """
        self._env, self._model, self._reward, self._gamma = env, model, reward, gamma
        count = env.num_envs
        self._first = torch.zeros(count, seen_by_chooser(_obs(env)).shape[1])
        self._paid = torch.zeros(count)
        self._steps = torch.zeros(count, dtype=torch.long)

    @torch.no_grad()
    def collect(self, control_steps: int) -> Collected:
        """Run so many steps in every environment."""
        parts = [self._nothing()]
        falls = changes = 0
        moved_m = 0.0
        env, model = self._env, self._model
        for _ in range(control_steps):
            obs = _obs(env)
            seen, new = seen_by_chooser(obs), begins(obs)
            before = model.running
            if len(before.gait) != len(obs):
                before = Running.nothing(len(obs))
                model.running = before
            now = model.choice(obs, *model.chooser(seen))
            parts += self._close(self._closes(before, now, new), before.gait, seen)
            fresh = self._steps == 0
            self._first[fresh] = seen[fresh]
            changed = (now.gait != before.gait) & ~new
            x = env.sim.raw_state()[0][:, 0]
            action = model.act_as(obs, now)
            _, _, dones, extras = env.step(action, score=False)
            moved = (extras["final"][0][:, 0] - x).float()
            usable = ~extras["aborted"]
            moved = torch.where(usable, moved, 0.0)
            rows = choice_rows(
                extras["features"],
                obs[:, OBS_DIM:],
                now.gait,
                # A change is paid for upon arrival, by the learner.
                torch.zeros_like(changed),
                moved,
                options=len(model.gaits),
                control_dt_s=env.step_dt,
            )
            pays = self._reward(rows) * env.step_dt * usable
            self._paid += self._gamma ** self._steps.float() * pays
            self._steps += 1
            after = torch.cat((extras["final"][2], extras["ahead"]), dim=1)
            fell = extras["fallen"]
            parts += self._close(
                dones & usable, now.gait, seen_by_chooser(after), over=fell
            )
            self._drop(dones)
            falls += int(fell.sum())
            changes += int(changed.sum())
            moved_m += float(moved.sum())
        return Collected(
            transitions=Transitions.joined(parts),
            falls=falls,
            changes=changes,
            moved_m=moved_m,
        )

    def _closes(self, before: Running, now: Running, new: Tensor) -> Tensor:
        """[N] where what ran is a whole transition: at each look where ends are
        learned, else where it ended."""
        choosing, dt_s = self._model.cfg.choosing, self._env.step_dt
        running = self._steps > 0
        if choosing.termination == "learned":
            return running & looks(before, choosing.look_steps(dt_s), new)
        return running & now.chosen & ~new

    def _close(
        self, which: Tensor, gait: Tensor, after: Tensor, over: Tensor | None = None
    ) -> list[Transitions]:
        """The transitions of the environments `which`, which begin anew."""
        if not which.any():
            return []
        done = Transitions(
            seen=self._first[which],
            gait=gait[which],
            paid=self._paid[which],
            steps=self._steps[which],
            after=after[which],
            over=(torch.zeros_like(which) if over is None else over)[which],
        )
        self._drop(which)
        return [done]

    def _nothing(self) -> Transitions:
        none = torch.zeros(self._env.num_envs, dtype=torch.bool)
        now = torch.zeros(len(none), dtype=torch.long)
        return Transitions(
            seen=self._first[none],
            gait=now[none],
            paid=self._paid[none],
            steps=now[none],
            after=self._first[none],
            over=none[none],
        )

    def _drop(self, which: Tensor) -> None:
        self._paid[which] = 0.0
        self._steps[which] = 0

    def snapshot(self) -> dict[str, Tensor]:
        """What runs."""
        running = self._model.running
        return {
            "first": self._first.clone(),
            "paid": self._paid.clone(),
            "steps": self._steps.clone(),
            "gait": running.gait.clone(),
            "ran": running.steps.clone(),
        }

    def restore(self, saved: dict[str, Tensor]) -> None:
        """Go on from a `snapshot`."""
        self._first, self._paid = saved["first"].clone(), saved["paid"].clone()
        self._steps = saved["steps"].clone()
        gait = saved["gait"].clone()
        self._model.running = Running(
            gait, saved["ran"].clone(), torch.zeros_like(gait) > 0
        )


def _obs(env: QuadrupedEnv) -> Tensor:
    return env.get_observations()["policy"]
