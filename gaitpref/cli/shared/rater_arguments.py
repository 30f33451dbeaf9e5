"""The simulated rater that the command line asks for."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

from data.errors import GaitprefError
from gaitpref.cli.options.options import Answer, Erring
from gaitpref.cli.options.program_options import Asking, Teaching
from gaitpref.programs.program_cfg import (
    ProgramCfg,
    ProgramError,
    ReachCfg,
    is_program,
)
from gaitpref.raters.rater_cfg import RaterCfg


def rater_cfg(options: Answer) -> RaterCfg:
    """The rater that `gaitpref answer` asks for.

    Raises:
        GaitprefError: a setting is out of range, or belongs to the other rater.
    """
    erring = options.erring
    if options.rater == "perfect" and erring.beta is not None:
        raise GaitprefError(
            "--beta says how unsure a rater is: it needs --rater stochastic"
        )
    if options.rater == "stochastic" and erring.beta is None:
        erring = replace(erring, beta=1.0)
    return erring_rater(erring)


def program_of(
    rater: str, others: Collection[str], asking: Asking, teaching: Teaching
) -> ProgramCfg | None:
    """The program that `--rater` names; None where it is one of `others`.

    Raises:
        GaitprefError: it names nobody, or an option says something of who is not there.
    """
    if rater in others:
        if asking != Asking() or teaching != Teaching():
            raise ProgramError(
                "--model, --wish, --key-env, --timeout-s, --tries, --beyond-loopback, "
                "--checked-on and --unchecked are about a program, and --rater "
                f"{rater} is none: leave them out"
            )
        return None
    if not is_program(rater):
        raise ProgramError(
            f"--rater {rater}: take {', '.join(others)}, package.module:function or "
            "openai:http://127.0.0.1:PORT/v1"
        )
    checked_on = teaching.checked_on
    return ProgramCfg(
        name=rater,
        model=asking.model,
        wish=asking.wish,
        unchecked=teaching.unchecked,
        checked_on=None if checked_on is None else str(checked_on),
    )


def reach_of(asking: Asking) -> ReachCfg:
    """How the program is reached.

    Raises:
        GaitprefError: a value is out of range.
    """
    return ReachCfg(
        key_env=asking.key_env,
        timeout_s=asking.timeout_s,
        tries=asking.tries,
        beyond_loopback=asking.beyond_loopback,
    )


def erring_rater(erring: Erring) -> RaterCfg:
    """The rater who errs as the command line says; without a beta, never by chance.

    Raises:
        GaitprefError: a setting is out of range.
    """
    try:
        return RaterCfg(
            beta=math.inf if erring.beta is None else erring.beta,
            gamma=erring.gamma,
            mistakes=erring.mistakes,
            skip=erring.skip,
            equal=erring.equal,
            why=erring.why,
            why_right=erring.why_right,
        )
    except ValueError as error:
        raise GaitprefError(f"--{error}".replace("why_right", "why-right")) from None
