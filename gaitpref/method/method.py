"""The two methods that ship: what the loop decides, from top to bottom.

A decision is left out with `replace(STYLE, tracking=None)`, or another is put there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

from data.files.plain import NONE_AS_BEFORE, ONE_OF
from policy.env.known_terms import KnownTermsCfg
from policy.offpolicy.sac_cfg import SacCfg
from rewardmodel.cfg import FitCfg, LinearCfg, PosteriorCfg

from .acceptance import Compared
from .budget import FrontLoaded
from .clip_sources import ClipSources
from .context import RoundContext
from .exploration import Descending, Exploration, PutBack
from .meanwhile import Meanwhile
from .paid import AsFitted, Paid, SurelyLiked
from .questions import Questions
from .tracking import TrackingPrice
from .unstick import Optimism


@dataclass(frozen=True, kw_only=True)
class Method:
    """How a wish becomes a policy: a named decision for everything that is decided."""

    clips: ClipSources
    """What the questions can be about."""
    budget: FrontLoaded
    """How many answers a round asks for."""
    questions: Questions = field(default_factory=Questions)
    """Which pairs it asks about."""
    reward: FitCfg
    """What is fitted to the answers."""
    paid: Paid = field(metadata=ONE_OF)
    """What of the reward a training is paid."""
    weight: float
    """Weight of that, which has unit standard deviation per second."""
    safety: KnownTermsCfg = field(default_factory=KnownTermsCfg)
    """Known terms it is added to, the robot's safety."""
    exploration: Exploration | None = field(metadata=ONE_OF)
    """Its exploration noise; None: what the policy has."""
    mirror: bool = True
    """Whether every step counts as its mirror image too, where both sides of the robot
    are the same and what is learned does not tell left from right: a leg that is held
    up, as in no walk anybody wants, is a habit PPO does not unlearn."""
    unstick: Optimism | None = None
    """How a robot that stands still is got going; None: by nothing."""
    accept: Compared | None
    """Which policy stays; None: always the new one."""
    tracking: TrackingPrice | None = None
    """What following commands worse than the base costs; None: nothing, or there is no
    base."""
    meanwhile: Meanwhile | None = field(default=None, metadata=NONE_AS_BEFORE)
    """What people are asked while a policy is trained; None: nothing."""
    learner: SacCfg | None = field(default=None, metadata=NONE_AS_BEFORE)
    """What trains, off-policy from all that the run's trainings remember; None: PPO. It
    finds its own noise, whatever `exploration` says; its actor has the sizes of
    `ppo.hidden_sizes`."""

    REMOVED: ClassVar = ("start", "once_it_walks")

    def __post_init__(self) -> None:
        suited = self.paid.kind
        if suited not in (None, self.reward.kind):
            raise ValueError(
                f"paid {type(self.paid).__name__} is of rewards of kind {suited}, got "
                f"reward.kind {self.reward.kind}; AsFitted suits every kind"
            )

    def fit_of(self, context: RoundContext) -> FitCfg:
        """What is fitted in the round of `context`."""
        return replace(self.reward, answers_err=context.noisy)

    def labels_kept(self, context: RoundContext) -> int:
        """Answers that are kept for judging the last policy; more where answers err, of
        those the first round left."""
        planned = self.labels_planned(context)
        if self.accept is None or not context.noisy:
            return planned
        wanted = self.accept.last_labels(context)
        return self.budget.most_kept(context, wanted, planned=planned)

    def labels_planned(self, context: RoundContext) -> int:
        """Those that were to be kept when the first round asked, before anybody knew
        whether answers err."""
        if self.accept is None:
            return 0
        first = replace(context, noisy=None)
        return self.budget.most_kept(first, self.accept.last_labels(first))


FROM_SCRATCH = Method(
    # Beside clips without noise, those with it teach that moving is bad.
    clips=ClipSources(noisy_share=1.0, rhythm_share=0.3),
    budget=FrontLoaded(first_share=0.4),
    # Robots that tumble move their feet and joints whatever they do of what they are
    # told; answers that err cannot tell the two apart.
    reward=FitCfg(kind="linear", linear=LinearCfg(told_most=True)),
    paid=SurelyLiked(),
    weight=1.0,
    exploration=Descending(),
    unstick=Optimism(),
    accept=Compared(first=2, last_share=0.1),
)
"""A walk from nothing but answers and the known safety terms."""

STYLE = Method(
    clips=ClipSources(),
    budget=FrontLoaded(first_share=0.65, least=2),
    questions=Questions(
        strategy="information", uniform_share=0.0, batch=1, informed_from=1
    ),
    # A wish about a walk that is there is about few things, and not about following
    # commands, which the task pays for.
    reward=FitCfg(
        kind="posterior", tie_threshold=0.3, posterior=PosteriorCfg(told=False)
    ),
    paid=AsFitted(),
    weight=3.0,
    exploration=PutBack(),
    accept=Compared(first=1, noisy_labels=0),
    tracking=TrackingPrice(),
)
"""Another way of walking, on top of a policy that walks."""
