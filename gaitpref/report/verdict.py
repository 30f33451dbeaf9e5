"""What a run comes to: is its last policy better than what it started from?"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, Self

from gaitpref.method.acceptance import SURE, Duel

Word = Literal["better", "not better", "not known"]


def play_command(after: Path, before: Path) -> str:
    """What shows two policies side by side, under the same commands."""
    return f"gaitpref play --policy {after} --against {before}"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """By answers that were kept for it alone."""

    stays: int
    """Round whose policy is the run's."""
    rounds: int
    """The last round."""
    beside_first: Duel | None = None
    """The policy that stays beside the one the run started from, or the last one where
    that lost; None: nobody was asked."""
    beside_before: Duel | None = None
    """The last policy beside the one it was trained from, where that is another."""
    stands: bool = False
    """Whether the one that stays is a robot that was made to stand, as nothing that was
    trained is preferred: to stand is better than to fall, and no gait."""
    nowhere: str = ""
    """How slow one is that learned to stand, beside what it is told."""

    @property
    def word(self) -> Word:
        if self.stands:
            return "not better"
        if self.beside_first is None:
            return "not known" if self.stays else "not better"
        probably = self.beside_first.probably
        if self.stays and probably >= SURE:
            return "better"
        lost = self.beside_first.is_lost(SURE)
        return "not known" if self.stays or not lost else "not better"

    @property
    def sentence(self) -> str:
        """On one line, for people."""
        nowhere = (
            f"; but the robot goes nowhere: {self.nowhere}" if self.nowhere else ""
        )
        return f"{self._compared}{nowhere}"

    @property
    def _compared(self) -> str:
        """What the answers say."""
        if self.stands:
            return (
                "not better than what it started from: the robot stands still, and no "
                "policy that was trained is preferred to that"
            )
        if self.word == "better":
            return f"better than what it started from: {self._answers}{self._dropped}"
        stays = "" if self.stays else ", which stays"
        if self.word == "not known":
            return (
                f"not known whether it is better than what it started from{stays}: "
                f"{self._answers}{self._dropped}"
            )
        if self.beside_first is None:
            return "not better than what it started from: no other policy was kept"
        return (
            f"not better than what it started from{stays}: {self._answers}"
            f"{self._dropped}"
        )

    def advice(self, run: Path) -> str:
        """What to do next."""
        first, last = (
            run / "rounds" / f"{number:02d}" / "policy" / "policy.pt"
            for number in (0, self.rounds)
        )
        if self.stays == 0 and self.beside_first is not None:
            last = last.parents[1] / "candidate" / last.name
        shown = f"`{play_command(last, first)}` shows both"
        if self.word == "better" and not self.nowhere:
            return (
                f"{shown}, and the same command with another --run and `--base {last}` "
                f"goes on from it"
            )
        if self.nowhere:
            return f"{shown}; a run with twice the --labels learns what sets it going"
        if self.word == "not known":
            return (
                f"{shown}; `gaitpref arena --out {run / 'arena'} --policy last={last} "
                f"--policy first={first}` asks on until it is sure, and a run with "
                f"twice the --labels learns more of what you mean"
            )
        lost = "" if self.beside_first is None else f"{shown}; "
        return (
            f"{lost}look at the clips that the reward likes best in {run}/report: if "
            f"they are not what you mean, a run with twice the --labels learns more of "
            f"it, and another --base may show clips nearer to it"
        )

    def as_json(self) -> dict[str, Any]:
        """Plain values for a report."""
        return {
            "word": self.word,
            "sentence": self.sentence,
            **asdict(self),
            "interval": self.beside_first and self.beside_first.interval,
        }

    @classmethod
    def from_json(cls, found: dict[str, Any]) -> Self:
        """The verdict that `as_json` wrote."""
        first, before = (
            None if each is None else Duel(**each)
            for each in (found["beside_first"], found["beside_before"])
        )
        return cls(
            stays=found["stays"],
            rounds=found["rounds"],
            beside_first=first,
            beside_before=before,
            stands=found.get("stands", False),
            nowhere=found.get("nowhere", ""),
        )

    @property
    def _answers(self) -> str:
        duel = self.beside_first
        if duel is None:
            return "nobody was asked"
        if not duel.for_new + duel.for_old:
            return "no answer prefers a clip of either"
        low, high = duel.interval
        return (
            f"{duel.for_new} of {duel.for_new + duel.for_old} answers prefer its clips "
            f"(of more, {low:.0%} to {high:.0%} would)"
        )

    @property
    def _dropped(self) -> str:
        if self.stays in (0, self.rounds):
            return ""
        if self.beside_before is None:
            return f"; nothing was trained after round {self.stays}"
        return (
            f"; it is the policy of round {self.stays}, as the answers preferred that "
            f"to the last"
        )
