"""What comes after a look at raters."""

from __future__ import annotations

from typing import Any

from data.datasets.dataset import Dataset
from gaitpref.cli.options import options

from .next_of_answers import next_fit, next_once_answered


def next_of_raters(
    action: options.RatersAction, dataset: Dataset, values: dict[str, Any]
) -> str:
    """In one sentence; empty where what was shown says it itself.

    Args:
        action: What was asked for.
        dataset: Whose raters they are.
        values: What was shown.
    """
    at = f"--dataset {dataset.root}"
    match action:
        case "list" if values["raters"]:
            return f"`gaitpref raters {at} stats` says how fast they are and agree"
        case "stats":
            return _after_stats(dataset, values["raters"])
        case "groups" if len(values["groups"]) > 1:
            first = values["groups"][0]["raters"][0]
            return (
                f"`gaitpref fit {at} --for group:{first} --out REWARD` fits what the "
                "first of them want"
            )
        case "groups":
            return next_fit(dataset)
        case "compare" if values["programs"]:
            if any(each["agreement"]["teaches"] for each in values["programs"]):
                return next_fit(dataset)
            return (
                f"`gaitpref label {at} --no-auth --open` asks you as well, and what "
                "both answered is compared"
            )
        case "revoke":
            return (
                f"`gaitpref raters {at} leave-out {values['revoked']}` leaves the "
                "answers out as well"
            )
    return ""


def _after_stats(dataset: Dataset, raters: list[dict[str, Any]]) -> str:
    at = f"--dataset {dataset.root}"
    doubted = [each for each in raters if each["doubts"] and not each["left_out"]]
    if doubted:
        name = doubted[0]["rater_id"]
        return (
            f"`gaitpref raters {at} leave-out {name}` keeps the answers of {name}, and "
            "nothing learns from them"
        )
    if len(raters) > 1:
        return f"`gaitpref raters {at} groups` says who wants the same"
    return next_once_answered(dataset)
