"""A rater that is a function of its user's own."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, cast

from data.errors import GaitprefError
from gaitpref.raters.own_code import imported

from .program_cfg import ProgramError
from .seen_pair import WORDS, ProgramRater, SeenPair, Verdict, Word

Look = Callable[[SeenPair], Any]
"""Gives left, right, equal or skip, or one of them and a reason."""


def function_of(name: str) -> Look:
    """The function `package.module:function`.

    Importing its module runs it: the name is the user's, from a command or a program.

    Raises:
        ProgramError: it cannot be imported.
    """
    try:
        return imported("rater", name)
    except GaitprefError as error:
        raise ProgramError(str(error)) from error.__cause__


def function_rater(name: str, look: Look) -> ProgramRater:
    """`look`, with what it gives held to what an answer can be.

    Raises:
        ProgramError: later: it failed, or gave no answer.
    """

    def rate(pair: SeenPair) -> Verdict:
        try:
            said = look(pair)
        except Exception as error:
            raise ProgramError(
                f"rater {name} raised {type(error).__name__}: "
                f"{' '.join(str(error).split())[:200]}; it is called with one pair, "
                "which has left, right and command"
            ) from error
        word, reason = said if _is_with_reason(said) else (said, "")
        if word not in WORDS:
            raise ProgramError(
                f"rater {name} gave {said!r:.80}: an answer is {', '.join(WORDS)}, or "
                "one of them and a reason"
            )
        return Verdict(word=cast(Word, word), reason=str(reason))

    return rate


def name_of(look: Look) -> str:
    """What imports `look` again: so a loop goes on with the same rater.

    Raises:
        ProgramError: no name does, as of a lambda or of a function within another.
    """
    module = getattr(look, "__module__", None)
    qualified = getattr(look, "__qualname__", "")
    name = f"{module}:{qualified}"
    home = sys.modules.get(module or "")
    if module in (None, "__main__") or getattr(home, qualified, None) is not look:
        raise ProgramError(
            f"the rater {qualified or type(look).__name__} cannot be imported by a "
            "name, so a loop that was killed could not go on with it: write it as a "
            "function of a module that is not the program itself"
        )
    return name


def _is_with_reason(said: Any) -> bool:
    return (
        isinstance(said, tuple)
        and len(said) == 2
        and all(isinstance(part, str) for part in said)
    )
