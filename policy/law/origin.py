"""Where an imported policy comes from, and what it did when it was tried."""

from __future__ import annotations

from dataclasses import dataclass

TOLERANCE = 0.15
"""m/s and rad/s: how far from a command still follows it."""


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
        done = (self.forward_m_s, self.left_m_s, self.yaw_rad_s)
        return self.fell_at_s is None and all(
            abs(found - asked) <= TOLERANCE
            for found, asked in zip(done, self.command, strict=True)
        )


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

    @property
    def accepted(self) -> bool:
        """Whether it stands, and walks at 0.5 m/s."""
        return all(
            each.follows
            for each in self.acceptance
            if each.command in ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
        )


def table(rows: tuple[Measured, ...]) -> str:
    """`rows` in columns, for people."""
    lines = ["asked                      forward    left     yaw   fell    follows"]
    for row in rows:
        forward, left, yaw = row.command
        asked = f"{forward:.1f} m/s, {left:.1f} m/s, {yaw:.1f} rad/s"
        fell = "never" if row.fell_at_s is None else f"{row.fell_at_s:.1f} s"
        done = f"{row.forward_m_s:7.2f} {row.left_m_s:7.2f} {row.yaw_rad_s:7.2f}"
        told = "yes" if row.follows else "NO"
        lines.append(f"{asked:26} {done}   {fell:7} {told}")
    return "\n".join(lines)
