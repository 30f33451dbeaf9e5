"""Where an imported policy comes from, and what it did when it was tried."""

from __future__ import annotations

from dataclasses import dataclass, field

from data.files.plain import ADDED_LATER

TOLERANCE = 0.15
"""m/s and rad/s: how far from a command still follows it."""
_NEEDED = ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
"""Commands without which nothing walks."""
_WAYS = ("{} m/s", "{} m/s to the left", "turning {} rad/s")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What one command led to; the first 2 s of a walk are left out of the means."""

    command: tuple[float, float, float]
    """Forward m/s, left m/s, yaw rad/s."""
    seconds: float
    """How long it was asked for."""
    forward_m_s: float
    left_m_s: float
    yaw_rad_s: float
    fell_at_s: float | None = None
    """None where it never fell."""

    @property
    def follows(self) -> bool:
        """Whether it stayed on its feet and within `TOLERANCE` of the command."""
        return self.fell_at_s is None and max(map(abs, self.errors)) <= TOLERANCE

    @property
    def done(self) -> tuple[float, float, float]:
        """Forward m/s, left m/s, yaw rad/s."""
        return self.forward_m_s, self.left_m_s, self.yaw_rad_s

    @property
    def errors(self) -> tuple[float, ...]:
        """What it did beyond the command, m/s, m/s, rad/s."""
        return tuple(d - a for d, a in zip(self.done, self.command, strict=True))

    @property
    def in_words(self) -> str:
        """What was asked, and in brackets what came of it where that is worst."""
        asked = " and ".join(
            way.format(f"{each:.1f}")
            for way, each in zip(_WAYS, self.command, strict=True)
            if each
        )
        if self.fell_at_s is not None:
            return f"{asked or 'standing'} (fell at {self.fell_at_s:.1f} s)"
        sizes = [abs(error) for error in self.errors]
        worst = sizes.index(max(sizes))
        done = f"{round(self.done[worst], 2) + 0.0:.2f}"
        if not self.command[worst]:
            done = _WAYS[worst].format(done)
        return f"{asked or 'standing'} ({done})"


@dataclass(frozen=True, kw_only=True)
class Origin:
    """An imported policy's papers."""

    file: str
    """Name of the file."""
    sha256: str
    """Hash of the file."""
    kind: str
    """What kind of file, in words."""
    meaning: str
    """Who said what its numbers mean, in words."""
    guessed: dict[str, str]
    """Fields of the law that nobody said, and what was taken."""
    acceptance: tuple[Measured, ...]
    """What it did when it was brought in."""

    verdict: str = field(default="", metadata=ADDED_LATER)
    """What follows of it, in a sentence; empty in files that are older."""

    @property
    def accepted(self) -> bool:
        """Whether it did all that was asked."""
        return all(each.follows for each in self.acceptance)


def verdict(rows: tuple[Measured, ...]) -> str:
    """Whether a policy that did `rows` is accepted, and what it cannot, in a sentence.

    Who does not stand, or does not walk at 0.5 m/s, is not.
    """
    missed = [row for row in rows if not row.follows]
    if not missed:
        return "accepted"
    lacks = any(row.command in _NEEDED for row in missed)
    begins = "not accepted, for" if lacks else "accepted but for"
    return f"{begins}: {', '.join(row.in_words for row in missed)}"


def table(rows: tuple[Measured, ...]) -> str:
    """`rows` in columns, for people."""
    lines = ["asked                      forward    left     yaw   fell    follows"]
    for row in rows:
        forward, left, yaw = row.command
        asked = f"{forward:.1f} m/s, {left:.1f} m/s, {yaw:.1f} rad/s"
        fell = "never" if row.fell_at_s is None else f"{row.fell_at_s:.1f} s"
        done = " ".join(f"{each:7.2f}" for each in row.done)
        told = "yes" if row.follows else "NO"
        lines.append(f"{asked:26} {done}   {fell:7} {told}")
    return "\n".join(lines)
