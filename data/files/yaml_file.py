"""Reads YAML that a stranger may have written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from .files import read_text
from .limits import FACTS_BYTES


class _Plain(yaml.SafeLoader):
    """Takes no aliases: nine lines of them can stand for a billion."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("it refers back to itself with an alias")
        return super().compose_node(parent, index)


def read_yaml(path: Path) -> Any:
    """What a YAML file says.

    Raises:
        FileError, OSError: it is no file, too large, missing, or cannot be read.
        ValueError: it holds no YAML.
    """
    text = read_text(path, FACTS_BYTES)
    try:
        return yaml.load(text, Loader=_Plain)
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(str(error)) from error
