"""When each foot of a clip stands, drawn over time and told in words.

Shapes: T steps, F features.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from data.episodes.stances import stance_phases
from data.features import LEGS, column

from .pictures import BLUE, RED, plain_axes

_CONTACT, _FALLEN = column("foot_contact"), column("fallen")
_BAR = 0.7
"""Of the room of a leg."""


@dataclass(frozen=True, eq=False)
class Footfalls:
    """The feet of one robot in one clip."""

    contact: np.ndarray
    """[T, 4] bool: which foot is on the ground."""
    fell: bool

    @classmethod
    def of(cls, rows: np.ndarray) -> Footfalls | None:
        """The feet in rows [T, F] of a clip; None where nobody measured them."""
        contact = rows[:, _CONTACT]
        if np.isnan(contact).any():
            return None
        return cls(contact > 0.5, bool((rows[:, _FALLEN] > 0.5).any()))

    @property
    def words(self) -> str:
        """The same for who does not see it."""
        down = self.contact.mean(axis=0)
        told = ", ".join(
            f"{leg} {share:.0%}" for leg, share in zip(LEGS, down, strict=True)
        )
        return f"feet on the ground: {told} of the time" + "; it falls" * self.fell

    def draw(self, axes: Axes, start_s: float, dt_s: float) -> None:
        """A bar for each stance, in a row for each leg; red where the robot falls."""
        plain_axes(axes, "")
        axes.grid(False)
        for leg in range(len(LEGS)):
            stances = [
                (start_s + first * dt_s, (stop - first) * dt_s)
                for first, stop in stance_phases(self.contact[:, leg])
            ]
            axes.broken_barh(stances, (leg - _BAR / 2, _BAR), facecolor=BLUE)
        if self.fell:
            end_s = start_s + len(self.contact) * dt_s
            axes.axvspan(end_s - dt_s, end_s, color=RED, linewidth=0)
        axes.set_yticks(range(len(LEGS)), LEGS)
        axes.set_ylim(len(LEGS) - 0.5, -0.5)
        axes.set_ylabel("feet down", fontsize=9)
