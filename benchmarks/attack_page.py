"""Attacks on the labeling page: `python -m benchmarks.attack_page [--quick]`.

A server runs in a process of its own, on loopback, with 256 open files. One honest
rater sits at it all the time; every input is followed by a look at that page, at the
log and at what is stored. A table tells how many inputs of each kind were held.
"""

from __future__ import annotations

import asyncio
import json
import sys
import tempfile
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

import tyro

from .attacks.floods import FLOOD
from .attacks.ground import ground
from .attacks.kinds import inputs

_QUICK = {"flood": 2, "greed": 1, "waiting connections": 2, "order of events": 4}
"""Inputs of a kind in the small version, where they are not three."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Attack the labeling page."""

    quick: bool = False
    """A few inputs of each kind, and smaller floods."""
    slow_s: float = 0.2
    """An answer of another rater is on the page again within so long, always."""
    json: Path | None = None
    """File for the counts."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """What became of one input."""

    kind: str
    name: str
    got_through: str
    """Empty where it was held."""


def main(options: Options) -> list[Result]:
    """Attack, print the table and write the counts."""
    results = asyncio.run(_all(options.quick, options.slow_s))
    counts = Counter(result.kind for result in results)
    through = Counter(result.kind for result in results if result.got_through)
    print(f"{'kind':<24}{'inputs':>8}{'held':>8}{'got through':>14}")
    for kind, count in (*counts.items(), ("all", counts.total())):
        got = through.total() if kind == "all" else through[kind]
        print(f"{kind:<24}{count:>8}{count - got:>8}{got:>14}")
    for result in results:
        if result.got_through:
            print(f"  {result.kind}, {result.name}: {result.got_through}")
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(result) for result in results]))
    return results


async def _all(quick: bool, slow_s: float) -> list[Result]:
    attacks = inputs(FLOOD // 5 if quick else FLOOD)
    if quick:
        seen: Counter[str] = Counter()
        few = []
        for attack in attacks:
            seen[attack.kind] += 1
            if seen[attack.kind] <= _QUICK.get(attack.kind, 3):
                few.append(attack)
        attacks = few
    results = []
    with tempfile.TemporaryDirectory() as folder:
        async with ground(Path(folder), slow_s) as field:
            for attack in attacks:
                try:
                    async with asyncio.timeout(90):
                        got = await attack.held(field) or await field.harm()
                except Exception as error:
                    got = f"{type(error).__name__}: {error}"
                print(f"{attack.kind}, {attack.name}: {got or 'held'}", flush=True)
                results.append(
                    Result(kind=attack.kind, name=attack.name, got_through=got)
                )
            if got := await field.harm_at_the_end():
                results.append(Result(kind="in the end", name="all", got_through=got))
    return results


if __name__ == "__main__":
    sys.exit(any(result.got_through for result in main(tyro.cli(Options))))
