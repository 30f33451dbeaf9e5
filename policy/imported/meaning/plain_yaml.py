"""YAML of others, of which nothing is executed.

Isaac Lab writes tuples, slices and names of Python into its files. Tags of Python are
read as the plain list, mapping or text that stands behind them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from data.files.files import read_text
from data.files.limits import TEXT_BYTES
from policy.law.law import LawError

MOST_VALUES = 500_000
"""Values in a file, each as often as aliases repeat it; an env.yaml has thousands."""


class _Loader(yaml.SafeLoader):
    """Knows the tags of Python as what they hold.

    Isaac Lab writes aliases, so they are followed; nine lines of them can stand for a
    billion values, so they are counted.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._count = 0
        self._counts: dict[int, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        refers, before = self.check_event(yaml.AliasEvent), self._count
        node = super().compose_node(parent, index)
        if refers and id(node) not in self._counts:
            raise yaml.YAMLError("an alias refers to what it stands in")
        self._count += self._counts[id(node)] if refers else 1
        if self._count > MOST_VALUES:
            raise yaml.YAMLError(f"with its aliases it has over {MOST_VALUES:,} values")
        if not refers:
            self._counts[id(node)] = self._count - before
        return node


def _held(loader: yaml.SafeLoader, suffix: str, node: yaml.Node) -> Any:
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    value = loader.construct_scalar(node)  # type: ignore[arg-type]
    # A name of Python stands in its tag alone.
    return value or suffix.partition(":")[2]


_Loader.add_multi_constructor("tag:yaml.org,2002:python/", _held)


def read_plain_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        LawError: it is no mapping, or no YAML.
    """
    try:
        loaded = yaml.load(read_text(path, TEXT_BYTES), Loader=_Loader)
    except (yaml.YAMLError, RecursionError, ValueError, TypeError) as error:
        told = " ".join(str(error).split())[:160]
        raise LawError(f"{path}: it is no YAML that can be read ({told})") from None
    if not isinstance(loaded, dict):
        raise LawError(f"{path}: it must hold names and values")
    return loaded


def at(values: Any, *names: str) -> Any:
    """What is at the end of `names` in nested mappings; None where nothing is."""
    for name in names:
        values = values.get(name) if isinstance(values, dict) else None
    return values
