"""The memory: steps of many robots as feature rows, scored by whichever reward holds.

A reward that has changed changes what every remembered step was worth, so all of it is
scored again (Lee et al. 2021, PEBBLE, arXiv 2106.05091): also what lies behind the
place that is written next, once the ring is full.

Shapes: R rows of the ring, N columns (one for each environment), S rows of a chunk, D
numbers of an observation, F feature columns, B steps of a batch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor

from data.features import FEATURE_DIM, column
from policy.training.reward_ppo import (
    OfRollout,
    ScoreFn,
    history_of,
    require_finite,
)

from .drawing import Priorities, draw_evenly
from .sac_cfg import PriorityCfg

UNSCORED = -1
"""Version of a step that no reward has scored yet."""
SCORED_AT_ONCE = 65_536
"""Steps that are handed to a reward together, about."""
_ACTION = column("action")


@dataclass(frozen=True, kw_only=True, eq=False)
class Chunk:
    """Consecutive steps of all columns."""

    obs: Tensor
    """[S, N, D] before each step"""
    features: Tensor
    """[S, N, F] after it; the action is among them"""
    starts: Tensor
    """[S, N] it began an episode"""
    fallen: Tensor
    """[S, N] it ended one by a fall, after which nothing is to be had"""
    cut: Tensor
    """[S, N] what came of it is not known: time was up, or a simulation diverged"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Steps with what came of each within n steps."""

    obs: Tensor
    """[B, D]"""
    action: Tensor
    """[B, 12]"""
    gain: Tensor
    """[B] discounted rewards up to `later_obs`"""
    later_obs: Tensor
    """[B, D] from where on a critic is asked"""
    discount: Tensor
    """[B] of what it says; 0 after a fall"""
    place: Tensor
    """[B] where in the ring, flat"""
    weight: Tensor | None = None
    """[B] how much each counts for a critic; None: all alike"""


class Ring:
    """The last R steps of N columns."""

    def __init__(
        self,
        rows: int,
        columns: int,
        obs_dim: int,
        *,
        device: str | torch.device,
        priorities: PriorityCfg | None = None,
    ) -> None:
        shape = (rows, columns)
        on: dict[str, Any] = {"device": device}
        self.obs = torch.zeros(*shape, obs_dim, **on)
        self.features = torch.zeros(*shape, FEATURE_DIM, **on)
        self.starts = torch.zeros(shape, dtype=torch.bool, **on)
        self.fallen = torch.zeros(shape, dtype=torch.bool, **on)
        self.cut = torch.zeros(shape, dtype=torch.bool, **on)
        self.reward = torch.zeros(shape, **on)
        self.version = torch.full(shape, UNSCORED, dtype=torch.int32, **on)
        self.priorities = None
        if priorities is not None:
            self.priorities = Priorities(priorities, shape, device)
        self.rows, self.columns = rows, columns
        self.head = 0
        """The row that is written next."""
        self.filled = 0
        """Rows that hold something."""

    _TENSORS = ("obs", "features", "starts", "fallen", "cut", "reward", "version")

    @property
    def steps(self) -> int:
        """Steps that are remembered."""
        return self.filled * self.columns

    @property
    def megabytes(self) -> float:
        """What they take, here and in a file."""
        held = sum(getattr(self, name)[: self.filled].nbytes for name in self._TENSORS)
        return held / 1e6

    def add(self, chunk: Chunk) -> None:
        """Remember `chunk`, not yet scored, in the place of the oldest.

        A chunk longer than the ring leaves its end.
        """
        count = min(len(chunk.obs), self.rows)
        into = self._after(self.head, count)
        for part in fields(chunk):
            getattr(self, part.name)[into] = getattr(chunk, part.name)[-count:]
        self.version[into] = UNSCORED
        if self.priorities is not None:
            self.priorities.raise_rows(into)
        self.head = (self.head + count) % self.rows
        self.filled = min(self.filled + count, self.rows)

    def stale(self, version: int) -> bool:
        """Whether any step was scored by another reward than that of `version`."""
        return bool((self.version[: self.filled] != version).any())

    def score(self, reward: ScoreFn, version: int, newest: int | None = None) -> int:
        """Score steps by `reward` in the order of time, in parts; gives how many.

        Args:
            reward: Rows to reward; it sees as much before a step as it looks back.
            version: Its number, kept with each step.
            newest: Only so many of the last rows; None is all that is remembered.
        """
        first = 0 if newest is None else max(0, self.filled - newest)
        for rows, scored in self._scored(reward, first):
            self.reward[rows] = scored
            self.version[rows] = version
        return (self.filled - first) * self.columns

    def worth(self, reward: ScoreFn) -> Tensor:
        """[K] what `reward` says of all usable steps; nothing is remembered of it."""
        found = torch.zeros_like(self.reward)
        for rows, scored in self._scored(reward, 0):
            found[rows] = scored
        return found[self.usable()]

    def _scored(self, reward: ScoreFn, first: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Rows [S] in the order of time, from the `first` on, and their rewards
        [S, N]; what is cut is worth nothing."""
        order = self._after((self.head - self.filled) % self.rows, self.filled)
        at_once = max(1, SCORED_AT_ONCE // self.columns)
        history = history_of(reward)
        for begin in range(first, self.filled, at_once):
            rows = order[begin : begin + at_once]
            before = max(0, begin - history)
            seen = order[before : begin + at_once]
            starts = self.starts[seen]
            if before == 0:
                # What an episode did before is forgotten.
                starts[0] = True
            scored = _scored(reward, self.features[seen], starts, len(rows))
            yield rows, require_finite(scored) * ~self.cut[rows]

    def usable(self) -> Tensor:
        """[R, N] steps whose outcome is remembered too."""
        usable = ~self.cut
        usable[self.filled :] = False
        if self.filled:
            usable[self.head - 1] &= self.fallen[self.head - 1]
        return usable

    def sample(
        self, count: int, *, n_step: int, gamma: float, evenly: bool = False
    ) -> Batch:
        """`count` steps at random, from PyTorch's chance; by priority, where there are
        any and it is not to be `evenly`.

        A target ends early where the episode is cut, with what a critic says of the
        last state that is known; and after a fall, with nothing.

        Raises:
            ValueError: no step is usable.
        """
        usable = self.usable()
        if not usable.any():
            raise ValueError("the memory holds no step whose outcome is known")
        held, weight = usable[: self.filled], None
        if self.priorities is None or evenly:
            place = draw_evenly(count, held)
        else:
            place, weight = self.priorities.draw(count, held)
        rows, columns = place // self.columns, place % self.columns
        gain = torch.zeros(count, device=self.reward.device)
        discount = torch.ones_like(gain)
        later, on = rows.clone(), torch.ones_like(rows, dtype=torch.bool)
        for _ in range(n_step):
            # The first is usable, as it was drawn; where one is not, ask from there.
            on = on & usable[later, columns]
            fell = self.fallen[later, columns] & on
            gain = gain + discount * self.reward[later, columns] * on
            discount = torch.where(on, discount * gamma, discount)
            discount = torch.where(fell, 0.0, discount)
            on = on & ~fell
            later = torch.where(on, (later + 1) % self.rows, later)
        return Batch(
            obs=self.obs[rows, columns],
            action=self.features[rows, columns, _ACTION],
            gain=gain,
            later_obs=self.obs[later, columns],
            discount=discount,
            place=place,
            weight=weight,
        )

    def learned(self, batch: Batch, errors: Tensor) -> None:
        """Draw the steps of `batch` from now on by how far off the critics were,
        `errors` [B], where that matters."""
        if self.priorities is not None:
            self.priorities.learned(batch.place, errors)

    def raise_priorities(self) -> None:
        """Draw all steps alike until it is known how far off the critics are, where
        that matters."""
        if self.priorities is not None:
            self.priorities.raise_all()

    def newest_obs(self, count: int) -> Tensor:
        """About `count` [B, D] of the last observations."""
        rows = min(self.filled, max(1, count // self.columns))
        return self.obs[self._after(self.head - rows, rows)].flatten(0, 1)

    def newest_reward(self, rows: int) -> Tensor:
        """[rows, N] of the last rows."""
        return self.reward[self._after(self.head - rows, rows)]

    def snapshot(self) -> dict[str, Any]:
        """What is remembered, as plain values; the part that holds nothing left out."""
        held = {name: getattr(self, name)[: self.filled] for name in self._TENSORS}
        found = {**{k: v.clone() for k, v in held.items()}, "head": self.head}
        if self.priorities is not None:
            found["mass"] = self.priorities.mass[: self.filled].clone()
        return found

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from what `snapshot` gave.

        Raises:
            ValueError: it is of another memory.
        """
        held = len(snapshot["reward"])
        for name in self._TENSORS:
            own, given = getattr(self, name), snapshot[name]
            if held > self.rows or own.shape[1:] != given.shape[1:]:
                raise ValueError(
                    f"a memory of {tuple(given.shape)} does not fit into one of "
                    f"{tuple(own.shape)}"
                )
            own[:held] = given.to(own.device)
        self.filled, self.head = held, int(snapshot["head"]) % self.rows
        if self.priorities is not None:
            self.priorities.mass[:held] = snapshot["mass"].to(self.reward.device)

    def part(self, columns: Tensor) -> None:
        """What comes next in `columns` [K] is not what followed there."""
        newest = self.head - 1
        self.cut[newest, columns] |= ~self.fallen[newest, columns]

    def _after(self, row: int, count: int) -> Tensor:
        ids = torch.arange(row, row + count, device=self.reward.device)
        return ids % self.rows


def _scored(reward: ScoreFn, features: Tensor, starts: Tensor, steps: int) -> Tensor:
    """Reward [S, N] of the last `steps` of `features` [T, N, F]."""
    if isinstance(reward, OfRollout):
        return reward.of_rollout(features, starts, steps, torch.mean)
    return reward(features, starts)[len(features) - steps :]
