"""What is recorded of a policy: how many episodes, how long, under which commands."""

from __future__ import annotations

from dataclasses import dataclass, field

from data.files.plain import ADDED_LATER
from policy.env.env_cfg import CommandCfg

from .variation import VariationCfg

LONGEST_S = 600.0
"""Longest episode: it is held in memory until it is written."""

Command = tuple[float, float, float]
"""Forward m/s, left m/s, yaw rad/s."""


@dataclass(frozen=True, kw_only=True)
class RecordCfg:
    """What is recorded of a policy."""

    episodes: int = 64
    """Episodes in all."""
    episode_s: float = 6.0
    """Length of an episode that does not fall."""
    change_s: float | None = field(default=None, metadata=ADDED_LATER)
    """Time after which the next of the recorded commands is asked for, again and again:
    a whole manoeuvre. None keeps an episode's command."""
    checkpoints: int = 3
    """Earlier checkpoints of the same training that are recorded too."""
    checkpoint_share: float = 0.5
    """Share of the episodes that shows them."""
    noisy_share: float = 0.5
    """Share of a policy's episodes with exploration noise, so that clips differ."""
    variation: VariationCfg = field(default=VariationCfg(), metadata=ADDED_LATER)
    """Other postures, so that clips differ in what a policy never varies itself."""
    babble_share: float = 0.0
    """Share of the episodes that shows random rhythms instead of a policy; all do
    while the policy is untrained, unless the share is 0."""
    babble_m_s: tuple[float, ...] = (0.1, 0.2, 0.3)
    """Forward speeds asked of random rhythms, about as fast as some of them go: at
    speeds none comes near, all clips fail alike."""

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ValueError(f"episodes must be at least 1, got {self.episodes}")
        if not self.episode_s > 0:
            raise ValueError(f"episode_s must be positive, got {self.episode_s}")
        if self.change_s is not None and not self.change_s > 0:
            raise ValueError(f"change_s must be positive, got {self.change_s}")
        if not self.babble_m_s:
            raise ValueError("babble_m_s needs at least one speed")

    def change_steps(self, control_dt_s: float) -> int:
        """Control steps from one command to the next; 0 keeps an episode's command."""
        if self.change_s is None:
            return 0
        return max(1, round(self.change_s / control_dt_s))


def recorded_commands(
    cfg: CommandCfg, forward_m_s: tuple[float, ...] | None = None
) -> list[Command]:
    """The few commands that are recorded, each once, so that many clips share one."""
    low, high = cfg.evaluated_m_s
    speeds = forward_m_s or (low, (low + high) / 2, high)
    middle = speeds[len(speeds) // 2]
    commands = [
        *((speed, 0.0, 0.0) for speed in speeds),
        (middle, cfg.left_m_s[1], 0.0),
        (middle, 0.0, cfg.yaw_rad_s[1]),
    ]
    return list(dict.fromkeys(commands))
