"""What a training remembers, and that all of it is worth what is paid now.

Shapes: T steps, N environments.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from torch import Tensor

from data.errors import GaitprefError
from data.files.plain import to_plain
from policy.env.env import QuadrupedEnv
from policy.training.identity import content_of
from policy.training.reward_ppo import ScoreFn, Wanting

from .remembered import Place, chunk_of
from .ring import Chunk, Ring
from .sac_cfg import SacCfg

_ALIKE = 1e-7
"""Rewards of a step that differ by less are the same."""


class Memory:
    """A ring whose steps are scored by the reward of the moment."""

    def __init__(
        self,
        env: QuadrupedEnv,
        cfg: SacCfg,
        columns: int,
        tell: Callable[[str], None],
        *,
        robot_sha256: str,
    ) -> None:
        """Make an empty one.

        Args:
            env: What steps are of, and whose own reward is paid by default.
            robot_sha256: Of its robot before it was put on any ground.
            cfg: How many are remembered, and which are drawn more often.
            columns: Environments, whose steps follow one another.
            tell: Gets a line about what was read, and what was scored again.
        """
        obs_dim = env.get_observations()["policy"].shape[-1]
        self.ring = Ring(
            cfg.rows(columns, obs_dim),
            columns,
            obs_dim,
            device=env.device,
            priorities=cfg.priorities,
        )
        self._env, self._tell = env, tell
        self._place = Place(
            env=env,
            robot_sha256=robot_sha256,
            rows=self.ring.rows,
            columns=columns,
        )
        self._versions: list[str] = []
        self._last: tuple[ScoreFn | None, int] | None = None

    def replay(self, path: Path) -> Tensor:
        """Remember what is in `path`, the end of it if there is no room; gives the
        observations [B, D] of it.

        Raises:
            GaitprefError: it cannot be replayed here.
        """
        ring = self.ring
        chunk = chunk_of(path, self._place, self._tell)
        if len(chunk.cut) > ring.rows - ring.filled:
            self._tell(
                f"{path} and what is in memory take "
                f"{(ring.filled + len(chunk.cut)) * ring.columns:,} steps, of which "
                f"the last {ring.rows * ring.columns:,} are kept: --memory keeps more"
            )
        ring.add(chunk)
        return chunk.obs[~chunk.cut].to(self._env.device)

    def add(self, chunk: Chunk, paid: ScoreFn | None) -> Tensor:
        """Remember `chunk` as what `paid` says it is worth; gives its rewards [T, N].

        None is the environment's own reward.
        """
        self.ring.add(chunk)
        steps = len(chunk.cut)
        self.ring.score(self._score(paid), self._version(paid), newest=steps)
        return self.ring.newest_reward(steps)

    def relabel(self, paid: ScoreFn | None) -> int:
        """Score all of memory anew if any of it was scored by another reward than
        `paid`; gives how many steps that were."""
        version = self._version(paid)
        if not self.ring.filled or not self.ring.stale(version):
            return 0
        count = self.ring.score(self._score(paid), version)
        self.ring.raise_priorities()
        self._tell(f"scored {count:,} remembered steps by the present reward")
        return count

    def require_told(self, paid: ScoreFn | None) -> None:
        """Refuse to learn from this alone if what is wanted says nothing about it.

        Raises:
            GaitprefError: it finds every step alike.
        """
        wanted = paid.wanted if isinstance(paid, Wanting) else paid
        worth = self.ring.worth(self._score(wanted))
        if len(worth) and float(worth.max() - worth.min()) > _ALIKE:
            return
        each = f"{float(worth[0]):.3g} a step" if len(worth) else "nothing"
        raise GaitprefError(
            f"the reward pays all {len(worth):,} remembered steps alike ({each}), so "
            "they do not hold what it wants: replay episodes that differ in it, or "
            "leave --offline out"
        )

    def snapshot(self) -> dict[str, Any]:
        """Steps, and the rewards that scored them, as plain values."""
        return {"ring": self.ring.snapshot(), "versions": list(self._versions)}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from what `snapshot` gave, among other things."""
        self.ring.restore(snapshot["ring"])
        self._versions = list(snapshot["versions"])

    def _score(self, paid: ScoreFn | None) -> ScoreFn:
        return paid or self._own

    def _own(self, features: Tensor, starts: Tensor) -> Tensor:
        """The environment's own reward [T, N]."""
        return self._env.score(features)[0]

    def _version(self, paid: ScoreFn | None) -> int:
        """The number of `paid` among the rewards so far, by what it is."""
        if self._last is None or self._last[0] is not paid:
            own = to_plain(self._env.task)
            told = json.dumps(own if paid is None else content_of(paid), sort_keys=True)
            name = hashlib.sha256(told.encode()).hexdigest()
            if name not in self._versions:
                self._versions.append(name)
            self._last = paid, self._versions.index(name)
        return self._last[1]
