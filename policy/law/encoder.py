"""From the environment's own observation to what a policy of a law sees.

Shapes: N environments, H frames, W numbers of a frame, D numbers of an observation; 48
numbers of the environment's own observation, its joints in the order of `JOINTS`.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .gait import Gait, clock
from .law import OF_JOINTS, Law

_OWN = 48
OWN_STARTS = {
    "base_lin_vel": 0,
    "base_ang_vel": 3,
    "projected_gravity": 6,
    "joint_pos": 9,
    "joint_pos_abs": 9,
    "joint_vel": 21,
    "last_action": 33,
    "command": 45,
    "action_before_last": _OWN,
    "gait_command": _OWN + 12,
    "gait_clock": _OWN + 24,
}
"""Where the terms of a law begin in the environment's own observation, and in what is
put behind it."""
_ACTED = slice(33, 45)


class Encoder:
    """Observations of one law for N environments, with the frames that came before.

    What came before an episode is its first frame, as many times as it takes, or zeros.
    """

    def __init__(self, law: Law, num_envs: int, *, device: torch.device) -> None:
        self._limit = law.obs_limit
        columns, added, scales, lows, highs = [], [], [], [], []
        for term in law.terms:
            rest = torch.zeros(term.width)
            if term.name == "joint_pos_abs":
                rest = torch.tensor(law.default_joint_pos_rad)
            added.append(rest)
            own = torch.arange(term.width)
            if term.name in OF_JOINTS:
                own = torch.from_numpy(law.from_canonical)
            columns.append(OWN_STARTS[term.name] + own)
            scales.append(torch.tensor(term.scales, dtype=torch.float32))
            low, high = term.clip or (-torch.inf, torch.inf)
            lows.append(torch.full((term.width,), low))
            highs.append(torch.full((term.width,), high))
        self._columns, self._added, self._scale, self._low, self._high = (
            torch.cat(parts).to(device)
            for parts in (columns, added, scales, lows, highs)
        )
        frames = max(term.frames for term in law.terms)
        self._order = _order(law, frames).to(device)
        self._before = law.before
        self._paced = None
        if any(OWN_STARTS[term.name] >= _OWN for term in law.terms):
            self._paced = _Paced(law, num_envs, device)
        shape = (num_envs, frames - 1, law.frame_dim)
        self._past = torch.zeros(shape, device=device)
        self._latest = torch.zeros(num_envs, law.frame_dim, device=device)

    def advance(self) -> None:
        """The frame observed last becomes one of those before."""
        if self._past.shape[1]:
            self._past = torch.cat((self._past[:, 1:], self._latest[:, None]), dim=1)
        if self._paced is not None:
            self._paced.advance()

    def observe(self, own: Tensor, begins: Tensor) -> Tensor:
        """Observations [N, D] of the environment's own [N, 48].

        Args:
            own: True or with noise.
            begins: [N] where nothing came before.
        """
        if self._paced is not None:
            own = self._paced.behind(own, begins)
        values = own[:, self._columns] + self._added
        frame = values.clamp(self._low, self._high) * self._scale
        self._latest = frame
        if self._past.shape[1]:
            first = frame if self._before is None else torch.zeros_like(frame)
            self._past = torch.where(
                begins[:, None, None], first[:, None], self._past
            ).clone()
        seen = torch.cat((self._past, frame[:, None]), dim=1).flatten(1)
        seen = seen[:, self._order]
        return seen if self._limit is None else seen.clamp(-self._limit, self._limit)

    def snapshot(self) -> dict[str, Tensor]:
        """What came before."""
        saved = {"past": self._past.clone(), "latest": self._latest.clone()}
        return saved if self._paced is None else saved | self._paced.snapshot()

    def restore(self, saved: dict[str, Tensor]) -> None:
        """Go on from a `snapshot`."""
        device = self._latest.device
        self._past = saved["past"].to(device, copy=True)
        self._latest = saved["latest"].to(device, copy=True)
        if self._paced is not None:
            self._paced.restore(saved)


class _Paced:
    """What an environment does not keep: the action before the last, and how far a gait
    is. Of N environments."""

    def __init__(self, law: Law, num_envs: int, device: torch.device) -> None:
        self._gait = law.gait or Gait()
        self._dt_s = law.control_dt_s
        self._asked = torch.tensor(self._gait.values, device=device)
        # Of single precision, the clock of a long episode would have 1e-5 of error.
        self._steps = torch.zeros(num_envs, dtype=torch.float64, device=device)
        self._acted = torch.zeros(num_envs, 12, device=device)
        self._acted_before = self._acted.clone()

    def advance(self) -> None:
        """One control step is done."""
        self._steps = self._steps + 1
        self._acted_before = self._acted

    def behind(self, own: Tensor, begins: Tensor) -> Tensor:
        """`own` [N, 48] with what is put behind it; see `Encoder.observe`."""
        self._steps = self._steps.masked_fill(begins, 0.0)
        self._acted_before = self._acted_before.masked_fill(begins[:, None], 0.0)
        self._acted = own[:, _ACTED].clone()
        asked = self._asked.expand(len(own), -1)
        turned = clock(self._gait, self._steps * self._dt_s).to(own.dtype)
        return torch.cat((own, self._acted_before, asked, turned), dim=1)

    def snapshot(self) -> dict[str, Tensor]:
        """What came before."""
        return {
            "gait_steps": self._steps.clone(),
            "acted": self._acted.clone(),
            "acted_before": self._acted_before.clone(),
        }

    def restore(self, saved: dict[str, Tensor]) -> None:
        """Go on from a `snapshot`."""
        device = self._steps.device
        self._steps = saved["gait_steps"].to(device, copy=True)
        self._acted = saved["acted"].to(device, copy=True)
        self._acted_before = saved["acted_before"].to(device, copy=True)


def _order(law: Law, frames: int) -> Tensor:
    """[D] where each number of an observation is among frames [H, W], oldest first."""
    width = law.frame_dim
    starts, start = [], 0
    for term in law.terms:
        starts.append(start)
        start += term.width

    def of(term_index: int, age: int) -> Tensor:
        first = (frames - 1 - age) * width + starts[term_index]
        return first + torch.arange(law.terms[term_index].width)

    def ages(count: int) -> range:
        return range(count) if law.newest_first else range(count - 1, -1, -1)

    if law.by_term:
        parts = [
            of(index, age)
            for index, term in enumerate(law.terms)
            for age in ages(term.frames)
        ]
    else:
        parts = [
            of(index, age)
            for age in ages(law.terms[0].frames)
            for index in range(len(law.terms))
        ]
    return torch.cat(parts)
