"""Whether the answers of a program may teach: only where it agrees with people.

A program answers thousands of questions in an hour. What it gets wrong it gets wrong
every time, and no other answers would show it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from data.answers.answer_records import Answer, Pair, RaterKind

PROGRAM: RaterKind = "model"
"""What a program is among raters."""
LEAST_AGREEMENT = 0.7
"""Share of the preferences of people that a program must share to teach."""
LEAST_SHARED = 30
"""Preferences of people that it must have been compared with. Of programs that guess,
two in a hundred pass then."""

Row = tuple[Pair, Answer]


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How often a program prefers what people prefer."""

    rater_id: str
    agreed: int
    of: int
    """Answers of people that prefer a clip of a pair of which the program does too."""

    @property
    def share(self) -> float | None:
        """None where there is nothing to compare."""
        return self.agreed / self.of if self.of else None

    @property
    def teaches(self) -> bool:
        """Whether its answers may be learned from."""
        return self.of >= LEAST_SHARED and self.agreed >= LEAST_AGREEMENT * self.of

    def __str__(self) -> str:
        if not self.of:
            return "was never compared with people"
        return (
            f"prefers what people prefer in {self.agreed} of {self.of} answers "
            f"({self.agreed / self.of:.0%})"
        )


RULE = f"{LEAST_AGREEMENT:.0%} of at least {LEAST_SHARED} are needed"


def told_untaught(each: Agreement) -> str:
    """That the answers of a program are left out, and why."""
    return f"those of {each.rater_id} are left out: it {each}, {RULE} to teach"


def agreements(
    rows: Sequence[Row], kinds: Mapping[str, RaterKind]
) -> dict[str, Agreement]:
    """Of each program of some raters, by its name.

    Pairs with a known answer do not count: a fall is told from a walk by anybody.

    Args:
        rows: Current answers of everybody.
        kinds: What the raters are.
    """
    preferred: dict[str, dict[str, float]] = defaultdict(dict)
    of_people: list[tuple[str, float]] = []
    for pair, answer in rows:
        target = answer.target
        if target is None or target == 0.5 or pair.gold is not None:
            continue
        kind = kinds.get(answer.rater_id)
        if kind == PROGRAM:
            preferred[answer.rater_id][pair.pair_id] = target
        elif kind == "human" and answer.role == "first":
            of_people.append((pair.pair_id, target))
    return {
        name: _agreement(name, preferred[name], of_people)
        for name in sorted(name for name, kind in kinds.items() if kind == PROGRAM)
    }


def _agreement(
    name: str, own: Mapping[str, float], people: Iterable[tuple[str, float]]
) -> Agreement:
    same = [
        (own[pair_id] > 0.5) == (target > 0.5)
        for pair_id, target in people
        if pair_id in own
    ]
    return Agreement(rater_id=name, agreed=sum(same), of=len(same))
