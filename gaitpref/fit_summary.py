"""A fit in one line."""

from __future__ import annotations

from rewardmodel.report import FitReport


def fit_summary(report: FitReport) -> str:
    """A fit in one line."""
    held_out = "too few answers within a fold to measure it"
    if report.held_out_accuracy is not None and report.held_out_interval is not None:
        low, high = report.held_out_interval
        held_out = (
            f"{report.held_out_accuracy:.2f} on held-out episodes "
            f"({low:.2f} to {high:.2f}, {report.held_out_pairs} answers)"
        )
    return (
        f"fitted {report.answers} answers in {report.seconds:.1f} s, "
        f"accuracy {held_out}"
    )
