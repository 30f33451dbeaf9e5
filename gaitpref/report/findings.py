"""Whether a reward may be believed, in one sentence that is made of the figures.

`gaitpref trust`, `gaitpref fit`, the loop and its report say the same of the same
figures: these are read as plain values, as a round's `report.json` holds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from data.answers.rater_habits import Sides
from rewardmodel.answers.likelihood import HARDLY_LOOKS
from rewardmodel.models.fit_report import FitReport
from rewardmodel.trust.alarms import (
    ENOUGH,
    FAR_SHARE,
    MUCH_DRIFT_NATS,
    MUCH_FALLS,
    MUCH_POWER,
    MUCH_TRACKING_M_S,
    spelled,
    surely_wrong,
    tells,
)
from rewardmodel.trust.held_out_report import Accuracy
from rewardmodel.trust.support import PIECE_STEPS, Drift

from .return_text import return_text

NO_ALARM = "no alarm: nothing says that the learned reward misleads"
_OLDER = dict.fromkeys((field.name for field in fields(Drift)), 0)
"""What reports of earlier versions may lack of a drift."""


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What speaks against a reward, and the policy trained on it."""

    alarms: tuple[str, ...] = ()
    """Why not to trust it, the gravest reason first."""
    against: tuple[str, ...] = ()
    """Figures that raise no alarm, and that nobody should overlook."""
    untold: tuple[str, ...] = ()
    """Alarms that so few answers cannot raise, and how many could."""

    @property
    def besides(self) -> tuple[str, ...]:
        """What there is to say where the alarms were said."""
        said = []
        if self.against:
            said.append(f"look before you trust it: {'; '.join(self.against)}")
        if self.untold:
            said.append(f"too few answers to tell: {'; '.join(self.untold)}")
        return tuple(said) if said or self.alarms else (NO_ALARM,)

    @property
    def sentence(self) -> str:
        """All of it."""
        alarms = (f"ALARM: {'; '.join(self.alarms)}",) if self.alarms else ()
        return ". ".join((*alarms, *self.besides))


def findings_of_trust(trust: dict[str, Any]) -> Findings:
    """What the figures of a reward say, and of a policy where there are some.

    Args:
        trust: As `gaitpref.report.trust_json` writes them, with the alarms.
    """
    alarms = tuple(trust.get("alarms", ()))
    against = [name for name in trust.get("raters", ()) if name not in alarms]
    untold = []
    accuracy, newest = _accuracy(trust, "accuracy"), _accuracy(trust, "newest")
    agrees = accuracy is not None and not accuracy.too_low
    if "accuracy" in trust and not tells(accuracy) and not agrees:
        untold.append(
            f"{accuracy.answers if accuracy else 0} held-out answers prefer a clip, "
            f"{ENOUGH} would say whether they agree"
        )
    elif accuracy and accuracy.too_low and not _said(str(accuracy), alarms):
        against.append(
            f"held-out accuracy {accuracy} is hardly better than chance, as of answers "
            f"at random{_cleared(trust)}"
        )
    if newest and surely_wrong(newest) and not _said(str(newest), alarms):
        against.append(f"accuracy on the newest clips is {newest}")
    against += [told for told in _of_policy(trust) if not _said(told, alarms)]
    return Findings(alarms=alarms, against=tuple(against), untold=tuple(untold))


def findings_of_run(
    rounds: Sequence[dict[str, Any]], *, criterion: str | None
) -> Findings:
    """What the reports of all rounds so far say of the newest policy, and of the
    answers its reward was fitted to.

    Args:
        rounds: What each reported.
        criterion: What the rater looks for, where that is known.
    """
    newest = rounds[-1]
    trust = newest.get("trust", {})
    if "accuracy" not in trust:
        # No reward is fitted after the last training: the answers are those before.
        earlier = [r["trust"] for r in rounds if "accuracy" in r.get("trust", {})]
        of_answers = ("accuracy", "opinion", "by_chance", "raters")
        before = earlier[-1] if earlier else {}
        trust = {k: before[k] for k in of_answers if k in before} | trust
    found = findings_of_trust(trust)
    if len(rounds) > 1 and not (asked := rounds[-2].get("trust", {})).get(
        "deserves_training", True
    ):
        told = f"nothing was trained on the reward before it: {asked['alarm']}"
        found = replace(found, against=(*found.against, told))
    run = [] if len(rounds) == 1 else _of_run(rounds[0], newest, criterion)
    run += [
        f"the answers preferred the policy before to that of round {of_round['round']}"
        for of_round in rounds
        if (judged := of_round.get("approval")) and not judged["approved"]
    ]
    return replace(found, against=(*found.against, *run))


def findings_of_fit(report: FitReport, sides: Sequence[Sides]) -> Findings:
    """What a fit itself says of its answers."""
    accuracy = None
    if report.held_out_accuracy is not None and report.held_out_interval is not None:
        accuracy = {
            "share": report.held_out_accuracy,
            "interval": report.held_out_interval,
            "answers": report.held_out_pairs,
        }
    about = {"accuracy": accuracy, "raters": about_raters(report, sides), "alarms": ()}
    return findings_of_trust(about)


def about_raters(report: FitReport, sides: Sequence[Sides]) -> list[str]:
    """Raters who seem not to look, for whom a side of the screen decides, or nothing
    that decides for others."""
    guessing = [
        f"{rater} answers as if at random, in {share:.0%} of the cases, or wants "
        "something else than most (`gaitpref raters --dataset DIR groups` tells)"
        for rater, share in report.raters
        if share >= HARDLY_LOOKS
    ]
    return [*(str(each) for each in sides if each.one_sided), *guessing]


def _accuracy(trust: dict[str, Any], name: str) -> Accuracy | None:
    found = trust.get(name)
    if found is None:
        return None
    low, high = found["interval"]
    return Accuracy(
        share=found["share"], interval=(low, high), answers=found["answers"]
    )


def _cleared(trust: dict[str, Any]) -> str:
    """Why a low accuracy is no alarm, in words."""
    opinion, by_chance = _accuracy(trust, "opinion"), trust.get("by_chance")
    if by_chance is not None:
        return f" (they are random with probability {by_chance:.2f})"
    return f" (counting answers by how sure it is, {opinion})" if opinion else ""


def _said(figure: str, alarms: Sequence[str]) -> bool:
    return any(figure in alarm for alarm in alarms)


def _of_policy(trust: dict[str, Any]) -> list[str]:
    policy = trust.get("policy")
    if policy is None or trust.get("confirmed"):
        return []
    if policy["drift"] is None:
        return [
            f"no episode is long enough to tell where its motion lies: {PIECE_STEPS} "
            f"steps without a fall would"
        ]
    drift = Drift(**(_OLDER | policy["drift"]))
    return [spelled(drift)] if drift.share_beyond > FAR_SHARE else []


def _of_run(
    first: dict[str, Any], newest: dict[str, Any], criterion: str | None
) -> list[str]:
    """What became worse since the first policy, or is far from the last."""
    before, after = first["evaluation"], newest["evaluation"]
    found = []
    drift = newest.get("training", {}).get("policy/reference_kl", 0.0)
    if drift > MUCH_DRIFT_NATS:
        found.append(f"it drifted {drift:.0f} nats a step from the policy before")
    power = before["power_w"], after["power_w"]
    if first["policy_steps"] and power[1] > MUCH_POWER * power[0] > 0.0:
        found.append(
            f"mechanical power rose from {power[0]:.0f} to {power[1]:.0f} W, "
            f"{power[1] / power[0]:.1f} times the first policy's"
        )
    errors = before["tracking_error_m_s"], after["tracking_error_m_s"]
    if errors[1] - errors[0] > MUCH_TRACKING_M_S:
        found.append(f"tracking error rose from {errors[0]:.2f} to {errors[1]:.2f} m/s")
    falls = before["falls_per_minute"], after["falls_per_minute"]
    if falls[1] - falls[0] > MUCH_FALLS:
        found.append(f"falls rose from {falls[0]:.1f} to {falls[1]:.1f} a minute")
    least = before["return_mean"] - before["return_ci95"]
    if criterion and after["return_mean"] + after["return_ci95"] < least:
        found.append(
            f"the return under {criterion} fell from "
            f"{return_text(before['return_mean'], before['return_ci95'])} to "
            f"{return_text(after['return_mean'], after['return_ci95'])}"
        )
    return found
