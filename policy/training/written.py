"""How the settings of PPO stand in files.

Files are older than settings that are None: what is off stands there as it did when it
had a kind of its own. So equal policies stay equal files and keep their name, which
episodes, and with them held-out folds, go by.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_OFF: dict[str, Any] = {
    "reference_kl_weight": 0.0,
    "kl_penalty": {"kind": "none", "beta": 1.0, "target": 0.01},
    "bonus": {
        "kind": "none",
        "weight": 1.0,
        "decay_iterations": None,
        "neighbors": 5,
        "memory": 2048,
    },
}


def as_written(ppo: Mapping[str, Any]) -> dict[str, Any]:
    """`to_plain` of a `PpoCfg`, as files spell it; a new dictionary."""
    kept = {name: value for name, value in ppo.items() if name not in _OFF}
    last = {name: ppo.get(name) or off for name, off in _OFF.items()}
    return {**kept, **last}
