"""What an import leaves out of a bag and what looks odd in it, kept to be told."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Findings:
    """Filled while a bag is read; nothing is left out of it in silence."""

    left_out: Counter[str] = field(default_factory=Counter)
    """Samples by topic and reason."""
    told: list[str] = field(default_factory=list)
    """One line each, in the order of discovery."""

    def leave_out(self, what: str, count: int) -> None:
        """Count `count` samples, which may be 0, as left out."""
        if count:
            self.left_out[what] += count

    def tell(self, line: str) -> None:
        """Keep a line, once."""
        if line not in self.told:
            self.told.append(line)

    def reasons(self, topic: str) -> str:
        """What was left out of a topic, for an error that says it was too much."""
        counts = [
            f"{what}: {count}"
            for what, count in self.left_out.items()
            if what.startswith(f"{topic} ")
        ]
        return f"; left out were: {', '.join(counts)}" if counts else ""
