"""A fit in one line."""

from __future__ import annotations

from rewardmodel.models.fit_report import FitReport

NEWEST = "the newest clips' pairs"
"""Of what the order is open, where a reward is of gaits."""


def fit_summary(report: FitReport, of: str = NEWEST) -> str:
    """A fit in one line; `of` is whose order is told to be open."""
    held_out = "too few answers within a fold to measure it"
    if report.held_out_accuracy is not None and report.held_out_interval is not None:
        low, high = report.held_out_interval
        held_out = (
            f"{report.held_out_accuracy:.2f} on held-out episodes "
            f"({low:.2f} to {high:.2f}, {report.held_out_pairs} answers)"
        )
    return (
        f"fitted {report.answers} answers in {report.seconds:.1f} s, "
        f"accuracy {held_out}{'; ' if report.agreement is not None else ''}"
        f"{what_remains(report, of)}"
    )


def what_remains(report: FitReport, of: str = NEWEST) -> str:
    """Whether more answers would help, in words; nothing where it was not measured."""
    if report.agreement is None or report.open_share is None:
        return ""
    verdict = "more answers will help"
    if report.enough:
        verdict = "more answers will not help now"
    return (
        f"{verdict} (the order of {report.open_share:.0%} of {of} "
        f"is open, rank correlation {report.agreement:.2f})"
    )
