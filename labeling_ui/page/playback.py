"""The one clock of both clips; knows neither viser nor a wall clock."""

from __future__ import annotations

from dataclasses import dataclass, replace

SPEEDS = (0.25, 0.5, 1.0, 1.5, 2.0)
"""How fast the clock may run."""
HOLD_S = 0.6
"""Real time the last pose is held before the clips begin again."""


@dataclass(frozen=True, kw_only=True)
class Playback:
    """Where both clips are.

    Raises:
        ValueError: there can be no such clock.
    """

    duration_s: float
    """Length of the longer clip."""
    frame_s: float
    """Time between two recorded states; what a step moves by."""
    time_s: float = 0.0
    """Since the start of the clips, in [0, duration_s]."""
    held_s: float = 0.0
    """Real time the end has been held already."""
    speed: float = 1.0
    """Seconds of the clips in a second; one of SPEEDS."""
    playing: bool = True
    watched_s: float = 0.0
    """Real time the clock has been running."""
    replays: int = 0
    """Times the clips began again, by themselves or because they were asked to."""

    def __post_init__(self) -> None:
        if self.speed not in SPEEDS:
            raise ValueError(f"speed must be one of {SPEEDS}, got {self.speed}")
        if not (self.duration_s > 0 and self.frame_s > 0):
            raise ValueError(
                "duration_s and frame_s must be positive, got "
                f"{self.duration_s} and {self.frame_s}"
            )

    @property
    def at_end(self) -> bool:
        """The longer clip is over; the last poses are being held."""
        return self.time_s >= self.duration_s

    @property
    def cycle_s(self) -> float:
        """Real time from one beginning to the next."""
        return self.duration_s / self.speed + HOLD_S

    @property
    def cycle_position_s(self) -> float:
        """Real time since the last beginning, had the clock always been running."""
        return self.time_s / self.speed + self.held_s

    def advance(self, elapsed_s: float) -> Playback:
        """The state after `elapsed_s` of real time; begins again after the hold."""
        if not self.playing or elapsed_s <= 0:
            return self
        position_s = self.cycle_position_s + elapsed_s
        rounds, position_s = divmod(position_s, self.cycle_s)
        running_s = self.duration_s / self.speed
        return replace(
            self,
            time_s=min(position_s * self.speed, self.duration_s),
            held_s=max(position_s - running_s, 0.0),
            watched_s=self.watched_s + elapsed_s,
            replays=self.replays + int(rounds),
        )

    def seek(self, time_s: float) -> Playback:
        """Stand still at `time_s`, or at the nearest end."""
        inside = min(max(time_s, 0.0), self.duration_s)
        return replace(self, time_s=inside, held_s=0.0, playing=False)

    def step(self, frames: int) -> Playback:
        """Stand still `frames` recorded states further on, or back."""
        here = round(self.time_s / self.frame_s)
        return self.seek((here + frames) * self.frame_s)

    def toggle(self) -> Playback:
        """Pause, or play on; from the start if the clips were paused at their end."""
        if not self.playing and self.at_end:
            return self.replay()
        return replace(self, playing=not self.playing)

    def replay(self) -> Playback:
        """Play from the start."""
        return replace(
            self, time_s=0.0, held_s=0.0, playing=True, replays=self.replays + 1
        )

    def at_speed(self, speed: float) -> Playback:
        """This moment at another of SPEEDS."""
        return replace(self, speed=speed)

    def faster(self, steps: int) -> Playback:
        """`steps` further along SPEEDS, or back; stops at the ends."""
        index = SPEEDS.index(self.speed) + steps
        return self.at_speed(SPEEDS[min(max(index, 0), len(SPEEDS) - 1)])
