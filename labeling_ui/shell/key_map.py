"""The map of the keys: a table on `?`, and a line of the most used on wide screens."""

from __future__ import annotations

import html
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class KeyGroup:
    """Keys that belong together, each with what it does."""

    title: str
    keys: tuple[tuple[str, str], ...]


def key_map(groups: Iterable[KeyGroup]) -> str:
    """The dialog with all keys, as HTML; closed, and empty until it is opened."""
    tables = "".join(
        f"<table><caption>{html.escape(group.title)}</caption>"
        + "".join(
            f"<tr><td>{_caps(keys)}</td><td>{html.escape(does)}</td></tr>"
            for keys, does in group.keys
        )
        + "</table>"
        for group in groups
    )
    return (
        '<dialog id="gp-keys" aria-labelledby="gp-keys-title"><template>'
        f'<h2 id="gp-keys-title">Keys</h2><div class="gp-groups">{tables}</div>'
        '<button type="button" class="gp-button">Close [escape]</button>'
        "</template></dialog>"
    )


def key_strip(keys: Iterable[tuple[str, str]]) -> str:
    """The most used keys in a line, as HTML."""
    words = "".join(
        f"<span>{_caps(key)} {html.escape(does)}</span>" for key, does in keys
    )
    return f'<div id="gp-strip" aria-hidden="true">{words}</div>'


def _caps(keys: str) -> str:
    return " ".join(f"<kbd>{html.escape(key)}</kbd>" for key in keys.split())
