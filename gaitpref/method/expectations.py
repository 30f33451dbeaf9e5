"""What a reward from scratch expects of a walk once there may be one."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rewardmodel.cfg import FitCfg

from .context import RoundContext


@dataclass(frozen=True, kw_only=True)
class OnceItWalks:
    """What the rewards of the last two retrainings expect besides.

    A reward that expects it before there is a walk prefers standing.
    """

    hurry: float = 1.0
    """What they expect of short, hurried steps (`LinearCfg.hurry`)."""
    quiet_logit: float = 0.2
    """Where answers err, what they expect of moving more than a walk takes
    (`LinearCfg.quiet_logit`): what is left of such a reward says next to nothing of how
    to walk."""

    def expected(self, fit: FitCfg, context: RoundContext) -> FitCfg:
        """`fit` as it is in the round of `context`."""
        if context.number < max(1, context.rounds - 2):
            return fit
        linear = replace(fit.linear, quiet_logit=self.quiet_logit, hurry=self.hurry)
        return replace(fit, linear=linear)
