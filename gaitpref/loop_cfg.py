"""The configuration of a loop: everything that decides how a run goes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

from data.errors import GaitprefError
from data.plain import ADDED_LATER
from policy.config import EnvCfg
from policy.ppo import PpoCfg
from policy.record import RecordCfg
from policy.reward import KnownTermsCfg
from rewardmodel.acquisition import StrategyName
from rewardmodel.cfg import FitCfg
from rewardmodel.pairs import MIN_ANSWERS

from .questions import ClipCfg
from .rater_cfg import RaterCfg

_LEAST_LABELS = 4
"""Answers a round asks for at least; the first has to do for a fit."""


class RunError(GaitprefError):
    """A run directory cannot be used."""


@dataclass(frozen=True, kw_only=True)
class ExplorationCfg:
    """Exploration noise a round's training starts from, units of the action.

    Noise must outlive the questions, or nobody ever sees the better gait.
    """

    early: float = 0.7
    """In the first 60 % of the rounds."""
    late: float = 0.5
    """In the rounds after that."""
    last: float = 0.4
    """At the start of the last round."""
    final: float = 0.1
    """The most at its end: a gait that only noise sets going is no gait."""

    def std(self, round: int, rounds: int) -> float:
        """Noise for the training of `round`, counted from 1."""
        if round >= rounds:
            return self.last
        return self.early if round <= 0.6 * rounds else self.late


@dataclass(frozen=True, kw_only=True)
class LoopCfg:
    """Everything that decides how a run goes, resolved before it starts."""

    rounds: int
    """Times questions are asked and the policy is retrained."""
    labels: int
    """Answers in all; the rounds' shares shrink linearly, or, where the first round has
    a share of its own, those of the others grow."""
    rater: Literal["simulated", "human"]
    """Who answers."""
    criterion: str
    """What the simulated rater looks for, and what the report measures."""
    base: str
    """`task`, `none` or a policy file."""
    robot: str | None
    """MJCF file; None is the Go1 that ships."""
    seed: int
    """Where all chance comes from."""
    base_steps: int
    """Environment steps of the policy the first questions are asked about."""
    round_steps: int
    """Environment steps of a retraining."""
    last_round_steps: int
    """Environment steps of the last retraining: worth more than more answers."""
    learned_weight: float
    """Weight of the learned reward, which has unit standard deviation per second."""
    caution: float = field(default=1.0, metadata=ADDED_LATER)
    """Deviations over the ensemble within which a habit is paid only as was expected of
    it, where answers err, a fifth of them or more; fewer where fewer do. Of a sum of
    few curves, as of styles, no deviation is taken off."""
    approval_labels: int = field(default=7, metadata=ADDED_LATER)
    """Answers that, where answers err, judge each new policy beside the one before it,
    which stays where they speak for it; 0 judges none."""
    last_labels: int = field(default=0, metadata=ADDED_LATER)
    """Answers that judge the last policy alone where answers do not err: the longest
    training ends where nobody is asked any more. It stays unless they speak against
    it."""
    quiet_logit: float = field(default=0.2, metadata=ADDED_LATER)
    """Where answers err, what the rewards of the last two retrainings from scratch
    expect of moving more than a walk takes (`LinearCfg.quiet_logit`): what is left of
    such a reward says next to nothing of how to walk."""
    hurry: float = field(default=1.0, metadata=ADDED_LATER)
    """What the same rewards expect of short, hurried steps (`LinearCfg.hurry`), whether
    answers err or not."""
    sure: float = field(default=2.0, metadata=ADDED_LATER)
    """Where answers do not err, from the second retraining from scratch on: deviations
    over the ensemble that a weight of a linear reward must be above 0 to pay at all.
    The first needs a reward that tells walking from standing; later ones must not pay
    for what chance made positive. 0 pays all."""
    optimism: float = field(default=2.0, metadata=ADDED_LATER)
    """Where a robot from scratch stands still: deviations over the ensemble by which
    the reward of the next training is moved towards members who think less of that; 0
    is cautious then too."""
    beyond: float = field(default=0.5, metadata=ADDED_LATER)
    """Share of the judged range of a habit by which the curve of a style that still
    rises at its end goes on, wherever somebody is asked about what is found there: in
    the last retraining only where answers are kept for it."""
    from_best: bool = field(default=True, metadata=ADDED_LATER)
    """Whether the training of a style goes on from the policy so far that the newest
    reward likes best, instead of from the last."""
    mirror: bool = field(default=True, metadata=ADDED_LATER)
    """Let policies learn from every step as its mirror image too, where both sides of
    the robot are the same and what is learned does not tell left from right: a leg
    that is held up, as in no walk anybody wants, is a habit PPO does not unlearn."""
    tracking_slack_m_s: float | None = field(default=0.02, metadata=ADDED_LATER)
    """Where the task is kept: how much worse than the base commands may be followed
    before the learned reward counts less and errors cost; None lets a style cost the
    walk."""
    exploration: ExplorationCfg | None
    """Noise put back every round; None keeps what the policy has."""
    calm_std: float | None = field(default=None, metadata=ADDED_LATER)
    """Where none is put back, the most noise there may be at the end of a training that
    is paid for the rate of steps: feet that noise makes chatter have that rate, and
    without noise they have not."""
    noise_back: float = field(default=0.3, metadata=ADDED_LATER)
    """Noise that a first retraining begins with where the base has little left."""
    noise_again: float = field(default=0.15, metadata=ADDED_LATER)
    """The same of later ones: what was learned to do with little noise is lost under
    more, and half of a training is spent on learning it once more."""
    calm_from: float = field(default=0.85, metadata=ADDED_LATER)
    """Share of a training after which it comes down to that: the less noise, the slower
    is learned."""
    far_limit: float | None = None
    """Share of a policy's motion that is far from every judged clip, or paid more than
    any of them, at which a round's training ends early and asks, if much of the reward
    is for what no clip shows (`rewardmodel.trust.EXTRAPOLATED`); the steps left are
    added to the next round. The last round only reports. None never ends a round."""
    clips: ClipCfg = field(default_factory=ClipCfg)
    """How episodes are cut into clips."""
    first_share: float | None = field(default=None, metadata=ADDED_LATER)
    """Share of the answers asked for in the first round; None: the most of all rounds,
    whose shares shrink linearly."""
    most_first_share: float | None = field(default=None, metadata=ADDED_LATER)
    """Share of the answers the first round may go on to, while they leave open what is
    wanted; None: it asks for its own only."""
    first_agreement: float = field(default=0.94, metadata=ADDED_LATER)
    """Rank correlation, over the clips, of the members of a reward fitted to them from
    which on the first round's answers leave nothing open."""
    first_least: int = field(default=0, metadata=ADDED_LATER)
    """Answers the first round asks for however few there are in all, as far as
    `most_first_share` lets it."""
    batch_labels: int = 10
    """Questions chosen at a time; a reward is fitted to all answers before the next."""
    stop_asking: bool = field(default=False, metadata=ADDED_LATER)
    """Whether a round asks no further batch where more answers will not help now."""
    earlier_share: float = field(default=0.5, metadata=ADDED_LATER)
    """Episodes of earlier rounds' policies among those asked about, for every new one:
    what all clips of a new policy have in common, no answer about two of them tells."""
    strategy: StrategyName = "disagreement"
    """How the other pairs of a round are chosen."""
    uniform_share: float = 0.2
    """Share of a round's pairs chosen at random."""
    evaluation_episodes: int = 64
    """Episodes of each round's evaluation."""
    env: EnvCfg = field(default_factory=EnvCfg)
    """The environment."""
    ppo: PpoCfg = field(default_factory=PpoCfg)
    """The algorithm."""
    record: RecordCfg = field(default_factory=RecordCfg)
    """What is recorded every round."""
    simulated: RaterCfg = field(default_factory=RaterCfg)
    """How the simulated rater errs; as it is, never."""
    fit: FitCfg = field(default_factory=lambda: FitCfg(kind="linear"))
    """The reward model."""
    known: KnownTermsCfg = field(default_factory=KnownTermsCfg)
    """Safety terms the learned reward is added to."""

    def __post_init__(self) -> None:
        if self.rounds < 1:
            raise RunError(f"--rounds must be at least 1, got {self.rounds}")
        if self.batch_labels < 1:
            raise RunError(f"batch_labels must be at least 1, got {self.batch_labels}")
        least = MIN_ANSWERS + _LEAST_LABELS * (self.rounds - 1)
        if self.labels < least:
            raise RunError(
                f"--labels {self.labels} is too few for {self.rounds} rounds: the "
                f"first needs {MIN_ANSWERS} answers and each other {_LEAST_LABELS}, so "
                f"give at least {least}, or fewer --rounds"
            )
        for name in ("first_share", "most_first_share"):
            share = getattr(self, name)
            if share is not None and not 0.0 < share < 1.0:
                raise RunError(f"{name} must lie in (0, 1), got {share}")

    @property
    def keeps_task(self) -> bool:
        """Whether the hand-written walking reward stays part of the total."""
        return self.base != "none"

    @property
    def wish(self) -> str | None:
        """The criterion that is looked for; None where people know what they want."""
        return self.criterion if self.rater == "simulated" else None

    @property
    def hopes(self) -> bool:
        """Whether a robot that stands still is got going."""
        return self.optimism > 0.0 and not self.keeps_task and self.rounds > 1

    def fit_of(self, round: int) -> FitCfg:
        """The reward model fitted in `round`, counted from 0."""
        if self.keeps_task or round < max(1, self.rounds - 2):
            return self.fit
        linear = self.fit.linear
        expected = replace(linear, quiet_logit=self.quiet_logit, hurry=self.hurry)
        return replace(self.fit, linear=expected)

    def sure_of(self, round: int) -> float:
        """Deviations from which on the retraining of `round`, counted from 1, pays."""
        return self.sure if round > 1 and not self.keeps_task else 0.0

    def labels_of(self, round: int, *, first: int = 0, kept: int = 0) -> int:
        """Answers asked for in `round`, counted from 0, where the first round has asked
        for `first` by now and `kept` are for judging the last policy."""
        if self.rounds == 1:
            return self.labels
        own = self._own_of_first(first)
        if not round:
            return own
        others = _shrinking(self.labels - own - kept, self.rounds - 1)
        if self.first_share is not None:
            # The later a walk, the more there is to say of it, and the longer its
            # reward is trained on.
            others.reverse()
        return others[round - 1]

    def most_kept(self, wanted: int, *, first: int) -> int:
        """Answers, `wanted` or fewer, that can be kept for judging the last policy,
        where the first round has asked for `first`: every other round needs some."""
        if self.rounds == 1:
            return 0
        others = _LEAST_LABELS * (self.rounds - 1)
        spare = self.labels - self._own_of_first(first) - others
        return max(0, min(wanted, spare))

    def _own_of_first(self, asked: int) -> int:
        """Answers of the first round, which has asked for `asked` by now."""
        shares = _shrinking(self.labels, self.rounds)
        if self.first_share is None and shares[0] >= MIN_ANSWERS:
            own = shares[0]
        else:
            own = self._first_labels(self.first_share or 0.0)
            own = max(own, min(self.first_least, self.most_first_labels))
        return min(max(asked, own), self._first_labels(1.0))

    @property
    def most_first_labels(self) -> int:
        """Answers the first round may go on to."""
        if self.most_first_share is None or self.rounds == 1:
            return 0
        return self._first_labels(self.most_first_share)

    def _first_labels(self, share: float) -> int:
        others = _LEAST_LABELS * (self.rounds - 1)
        return min(max(MIN_ANSWERS, int(share * self.labels)), self.labels - others)


def _shrinking(labels: int, rounds: int) -> list[int]:
    """Answers of each round; the shares shrink linearly."""
    weights = range(rounds, 0, -1)
    spare = labels - _LEAST_LABELS * rounds
    marks = [spare * sum(weights[:i]) // sum(weights) for i in range(rounds + 1)]
    return [_LEAST_LABELS + b - a for a, b in pairwise(marks)]
