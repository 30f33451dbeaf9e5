"""The simulated rater that the command line asks for."""

from __future__ import annotations

import math
from dataclasses import replace

from data.errors import GaitprefError
from gaitpref.cli.options.options import Answer, Erring
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
