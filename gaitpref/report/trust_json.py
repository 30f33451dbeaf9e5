"""How far a reward can be trusted, as plain values."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rewardmodel.trust.alarms import Reach
from rewardmodel.trust.held_out_report import Foreseen


def as_json(foreseen: Foreseen | None, reached: Reach | None) -> dict[str, Any]:
    """The figures as plain values, for `--json` and for a round's report."""
    values: dict[str, Any] = asdict(foreseen) if foreseen else {}
    values["policy"] = None
    if reached is not None:
        values["policy"] = asdict(reached) | {"spread_ratio": reached.spread_ratio}
    return values


def alarm_json(reasons: tuple[str, ...]) -> dict[str, Any]:
    """The gravest reason, or null, and all of them."""
    return {"alarm": reasons[0] if reasons else None, "alarms": list(reasons)}
