"""A stage of the loop done by hand: which method, and which of its rounds.

Neither a simulator nor viser is imported here: data sets can be reused where they are
not installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from data.errors import GaitprefError
from gaitpref.method.context import RoundContext
from gaitpref.method.method import FROM_SCRATCH, STYLE, Method
from gaitpref.method.noisy import NoisyAnswers
from rewardmodel.cfg import FitCfg
from rewardmodel.models.storage import load_reward

MethodName = Literal["scratch", "style"]
METHODS: dict[MethodName, Method] = {"scratch": FROM_SCRATCH, "style": STYLE}
ROUNDS: dict[MethodName, int] = {"scratch": 4, "style": 2}
"""Rounds of a loop where nobody says how many, as of `--preset quick`."""


class ByHand(Protocol):
    """The options of a command that does a stage by hand."""

    @property
    def method(self) -> MethodName | None: ...
    @property
    def round(self) -> int: ...
    @property
    def rounds(self) -> int | None: ...
    @property
    def first_reward(self) -> Path | None: ...


@dataclass(frozen=True, kw_only=True)
class Stage:
    """What a method decides for one round."""

    method: Method
    context: RoundContext

    @property
    def fit(self) -> FitCfg:
        """What is fitted."""
        return self.method.fit_of(self.context)


def stage_of(
    command: ByHand, *, own: Path | None = None, least: int = 0
) -> Stage | None:
    """The method and the round that `command` names; None where it names none.

    Args:
        command: Its options.
        own: The first reward of a run, where the command is about it anyway.
        least: Round up to which nothing was decided before, or `own` decides.

    Raises:
        GaitprefError: the round is beyond the last, or what decided whether answers err
            is missing or no reward.
    """
    if command.method is None:
        if command.first_reward is not None:
            raise GaitprefError(
                "--first-reward decides for a round of a method: add --method scratch "
                "or style"
            )
        return None
    rounds = command.rounds or ROUNDS[command.method]
    if command.round > rounds:
        raise GaitprefError(
            f"--round {command.round} is beyond the last, {rounds}: the loop asks in "
            f"rounds 0 to {rounds - 1} and trains in rounds 1 to {rounds}; give "
            "--rounds too where there are more"
        )
    first, noisy = command.first_reward or own, None
    if first is not None:
        noisy = NoisyAnswers.of(load_reward(first)).noisy
    elif command.round > least:
        raise GaitprefError(
            f"--round {command.round} needs --first-reward REWARD, the reward of round "
            "0: it decided whether answers err"
        )
    context = RoundContext(number=command.round, rounds=rounds, labels=0, noisy=noisy)
    return Stage(method=METHODS[command.method], context=context)


def refuse_beside_method(command: ByHand, given: Mapping[str, bool]) -> None:
    """Refuse options that say what the method says.

    Args:
        command: Its options.
        given: By option, whether somebody gave it.

    Raises:
        GaitprefError: one was given beside a method.
    """
    names = [name for name, is_given in given.items() if is_given]
    if command.method is not None and names:
        raise GaitprefError(
            f"{', '.join(names)} beside --method {command.method}: the method decides "
            "that; leave one of the two out"
        )


def told_without_method(what: str) -> str:
    """How a stage done without a method differs: the loop does `what`."""
    return f"the loop {what}: --method style, or scratch, does it here too"
