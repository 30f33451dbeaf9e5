"""What a file says of joints by regular expressions of their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from policy.law.law import LawError, Vector

from .draft import INSTEAD, number_of, twelve
from .plain_yaml import at

_PATTERN_CHARS = 200
_REPEATED_GROUP = re.compile(r"\)\s*[*+{]")


@dataclass(frozen=True, kw_only=True)
class NamedJoints:
    """The joints of a policy in its order, by the names a file may have for them."""

    path: Path
    """The file, for what is told of it."""
    names: tuple[tuple[str, ...], ...]
    """[12] all names of each."""

    @classmethod
    def of(
        cls, path: Path, joints: Iterable[str], spelled: Mapping[str, str]
    ) -> NamedJoints:
        """`joints` by the names of `JOINTS`, which a model has `spelled` otherwise."""
        names = ((f"{each}_joint", spelled.get(each, each)) for each in joints)
        return cls(path=path, names=tuple(names))

    def numbers(self, value: Any, what: str, otherwise: float) -> Vector:
        """A number, twelve, or a mapping of expressions to numbers, as a vector.

        Args:
            value: As the file has it.
            what: Its name in the file.
            otherwise: Of joints that no expression fits.

        Raises:
            LawError: it is something else, or an expression fits no joint.
        """
        if not isinstance(value, dict):
            return twelve(value, f"{self.path}: {what}")
        return tuple(self.mapped(value, number_of, what, otherwise))

    def mapped(
        self, value: Mapping[Any, Any], read: Callable[[Any], Any], what: str, left: Any
    ) -> list[Any]:
        """[12] what `read` makes of the last value whose expression fits; else `left`.

        Raises:
            LawError: `read` gives None, or an expression fits no joint.
        """
        found = [left] * 12
        for pattern, told in value.items():
            if (plain := read(told)) is None:
                raise LawError(
                    f"{self.path}: {what} of {str(pattern)[:40]!r} cannot be "
                    f"{str(told)[:40]}"
                )
            if not (fits := self.fitting(str(pattern))):
                first = ", ".join(names[0] for names in self.names[:3])
                raise LawError(
                    f"{self.path}: {str(pattern)[:40]!r} fits none of the joints "
                    f"{first}, ...: {INSTEAD}"
                )
            for index in fits:
                found[index] = plain
        return found

    def of_actuators(self, groups: Iterable[Any], key: str) -> Vector | None:
        """A number of each joint's actuator; None where not every joint has one.

        Raises:
            LawError: it is no number.
        """
        values: list[float | None] = [None] * 12
        for group in groups:
            if at(group, key) is None:
                continue
            patterns = at(group, "joint_names_expr")
            patterns = patterns if isinstance(patterns, list) else [patterns or ".*"]
            told = self.numbers(at(group, key), key, 0.0)
            for index in {i for p in patterns for i in self.fitting(str(p))}:
                values[index] = told[index]
        return None if None in values else twelve(values, key)

    def fitting(self, pattern: str) -> list[int]:
        """Which joints an expression fits, by any of their names.

        Raises:
            LawError: it is none, or could be tried for ever.
        """
        self._require_plain(pattern)
        try:
            return [
                index
                for index, names in enumerate(self.names)
                if any(re.fullmatch(pattern, name) for name in names)
            ]
        except re.error:
            raise LawError(
                f"{self.path}: {pattern[:40]!r} is no regular expression"
            ) from None

    def _require_plain(self, pattern: str) -> None:
        # A stranger's expression could be matched for ever: repetitions in a
        # repetition, many in a row, or many alternatives are more ways than can be
        # tried.
        open_ends = sum(map(pattern.replace("(?", "(").count, "*+?{"))
        if (
            len(pattern) > _PATTERN_CHARS
            or open_ends > 4
            or pattern.count("|") > 12
            or _REPEATED_GROUP.search(pattern)
        ):
            raise LawError(
                f"{self.path}: {pattern[:40]!r} is no plain pattern of joint names, "
                f"with at most {_PATTERN_CHARS} letters, 4 of * + ? {{ and none after "
                "a group: write names or .*"
            )
