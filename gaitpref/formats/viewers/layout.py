"""A Foxglove layout for a file for viewers: the robots above, their curves below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from data.features import LEGS

_CURVES = (
    ("forward speed, m/s", ("base_lin_vel_b_x", "command_forward")),
    ("base height, m", ("base_height",)),
    ("feet on the ground", tuple(f"foot_contact_{leg.lower()}" for leg in LEGS)),
)


def foxglove_layout(names: Sequence[str]) -> dict[str, Any]:
    """The layout for the clips called `names`, to be opened with "import from file"."""
    topics = {f"/{name}/scene": {"visible": True} for name in names}
    panels: dict[str, Any] = {
        "3D!robots": {
            "followMode": "follow-none",
            "followTf": "world",
            "topics": topics,
            "layers": {"grid": {"layerId": "foxglove.Grid", "size": 10}},
            "cameraState": {"distance": 3, "phi": 65, "thetaOffset": 90},
        }
    }
    for number, (title, fields) in enumerate(_CURVES):
        panels[f"Plot!{number}"] = {
            "title": title,
            "paths": [
                {"value": f"/{name}/scalars.{field}", "label": f"{name} {field}"}
                for name in names
                for field in fields
            ],
            "xAxisVal": "timestamp",
            "showLegend": True,
        }
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "column",
            "first": "3D!robots",
            "second": _row([key for key in panels if key.startswith("Plot")]),
            "splitPercentage": 65,
        },
    }


def _row(panels: list[str]) -> Any:
    """Panels side by side, in the nested pairs that layouts are made of."""
    first, *rest = panels
    if not rest:
        return first
    share = 100 / len(panels)
    return {
        "direction": "row",
        "first": first,
        "second": _row(rest),
        "splitPercentage": share,
    }
