"""Options of the commands about questions, answers and rewards."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from data.answers.strategy_names import StrategyName

from .bounds import AtLeast, Count, CountOrZero, Seed
from .program_options import Asking


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Choose pairs of clips to ask about."""

    dataset: Path
    """Data set directory."""
    count: Count
    """Pairs to add."""
    gold: CountOrZero = 0
    """Pairs with a known answer to add as well, to measure raters: of the two robots,
    one falls. Fewer where not so many fell."""
    clip_s: float = 1.2
    """Length of a clip; 5 to 20 to ask about a whole manoeuvre."""
    apart: Annotated[float, AtLeast(0)] = 1.0
    """How different the two clips of a pair look, in differences that people just
    notice (0.5 for experts); 0 asks about any two. Others come only where there are
    not so many."""
    strategy: StrategyName | None = None
    """At random; where the ensemble disagrees, where the answer is most open, where it
    would tell most about the reward (bald), or where the better clip may beat the best
    known (improvement); the pairs farthest apart (of all, or of those whose answer is
    open), those that stand for most others, or a determinantal batch that is both
    unsure and various. By default where --reward is given every fifth at random and
    the others by disagreement, as a loop from scratch asks, else all at random."""
    method: Literal["scratch", "style"] | None = None
    """Choose as a loop does that learns to walk from nothing or a style; with --reward,
    after the first answers. A loop asks a few at a time and fits in between."""
    reward: Path | None = None
    """Learned reward whose ensemble is asked; disagreement, entropy, bald, improvement
    and kcenter-entropy need it, kcenter and dpp take it into account."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    seed: Seed = 0
    """Which of equally good pairs are taken."""


@dataclass(frozen=True, kw_only=True)
class Erring:
    """How a simulated rater errs; as it is, never."""

    beta: float | None = None
    """How sure it is of close pairs: P(a) = sigmoid(BETA * lead), the lead in units of
    the median lead of the pairs asked so far. With 1 about 30 % of the answers are
    wrong, most of them on close pairs; with 3 about 14 %."""
    gamma: float = 1.0
    """Myopia in (0, 1]: a step counts GAMMA times as much as the one after it."""
    mistakes: float = 0.0
    """Share of the answers that are turned round, however clear the pair."""
    skip: float = 0.0
    """"Can't tell" where both clips are among the worst SKIP (a share) of those asked
    about."""
    equal: float = 0.0
    """"Equal" where the lead is below EQUAL times the median lead."""
    why: Literal["posture", "feet", "rhythm", "steadiness", "effort"] | None = None
    """What of the gait the answers are said to be about; by default it does not say."""
    why_right: float = 0.8
    """Share of the answers of which it says so; of the others it names another."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Let a simulated rater, or a program, answer every open pair."""

    dataset: Path
    """Data set directory."""
    criterion: str | None = None
    """What a simulated rater looks for: task, smooth, high_step, crouch, low_energy,
    trot, pace, get_up, a trot of another frequency as trot@HZ, or your own as
    package.module:function."""
    rater: str = "perfect"
    """perfect takes the better clip by the criterion; stochastic is the less sure the
    closer the two are, with a BETA of 1 by default. Or a program that looks at clips:
    your own function as package.module:function, which is imported and so run, or a
    vision model as openai:http://127.0.0.1:PORT/v1."""
    erring: Erring = Erring()
    asking: Asking = field(default_factory=Asking)
    most: Count | None = None
    """Answer so many pairs at most, of a program."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    seed: Seed = 0
    """All chance of the answers, and which clip of a pair was shown left."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Fit a reward model to the answers of one or more data sets, or about segments of
    any table."""

    dataset: Annotated[list[Path], tyro.conf.UseAppendAction] = field(
        default_factory=list
    )
    """Data set directory; give it again for more."""
    segments: Path | None = None
    """In place of a data set: an .npz, .csv or .parquet file of segments, rows of named
    numbers."""
    labels: Path | None = None
    """With --segments: a .csv file of answers, with left, right, answer and rater."""
    out: Path
    """Directory of the reward, in place of an earlier one; of segments, of its report,
    weights and what each segment is worth."""
    method: Literal["scratch", "style"] | None = None
    """Fit what the loop fits, from scratch or for a style on top of a walk; `gaitpref
    method` says what. The model is the method's then."""
    round: CountOrZero = 0
    """With --method: the round of the loop whose answers are the newest."""
    rounds: Count | None = None
    """With --method: rounds of the loop; by default as many as of its quick preset."""
    first_reward: Path | None = None
    """With --method, from round 1 on: the reward of round 0, which decided whether
    answers err."""
    model: Literal[
        "auto", "linear", "posterior", "gp", "mlp", "history", "transformer", "raw"
    ] = "linear"
    """Linear in the gait descriptors; a posterior over which one to three of them are
    wanted, of single legs and the stride rate too, each with a curve; a Gaussian
    process or a small network on them; a network or a transformer on the last half
    second, for rhythms; or whichever of these foresees held-out answers best. Networks
    on raw rows, as published, for comparison."""
    semi_supervised: bool = False
    """Let what the reward is sure of in pairs nobody answered count a little too. Where
    it was measured (docs/reference/extensions.md) it did not pay."""
    doubted_below: float = 0.0
    """Take answers for random that a reward fitted to the others gives a probability
    below this, such as 0.2. Where it was measured (docs/reference/extensions.md) it
    did not pay."""
    whom: Annotated[tuple[str, ...], tyro.conf.arg(name="for", metavar="RATER")] = ()
    """Learn what some raters want: their names, or group:RATER for all who want what
    that one does; `gaitpref raters groups` shows them. By default what most want.
    With --segments, names that stand in the .csv file."""
    unchecked: bool = False
    """Learn from answers of programs too that do not agree with people, or were never
    compared with them; `gaitpref raters compare` shows it."""
    json: bool = False
    """Print one JSON object and nothing else."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    seed: Seed = 0
    """Bootstrap draws."""


@dataclass(frozen=True, kw_only=True)
class Relabel:
    """Write the learned reward of every step of every episode to a Parquet file.

    The data set stays as it is. A row names the episode and the step.
    """

    dataset: Path
    """Data set directory."""
    reward: Path
    """Directory of the learned reward."""
    out: Path
    """Parquet file; needs the extra `parquet`."""
    json: bool = False
    """Print one JSON object and nothing else."""


@dataclass(frozen=True, kw_only=True)
class Trust:
    """Say how far a learned reward can be trusted, and raise an alarm where it cannot.

    Accuracy and calibration on held-out answers, and how far a policy has left what
    was judged."""

    reward: Path
    """Directory of the learned reward."""
    dataset: Path
    """Data set directory with answers."""
    policy: Path | None = None
    """Policy file to compare with the judged clips."""
    whom: Annotated[tuple[str, ...], tyro.conf.arg(name="for", metavar="RATER")] = ()
    """Hold against it only what some raters say, as `gaitpref fit --for` learns from
    them alone: their names, or group:RATER."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    picture: Path | None = None
    """Write the reliability plot to this file, .svg or .png."""
    json: bool = False
    """Print one JSON object and nothing else; `alarm` is a reason, or null."""
    seed: Seed = 0
    """Bootstrap draws and start states."""


@dataclass(frozen=True, kw_only=True)
class Explain:
    """Show which moments and which habits, gaits or robots a learned reward likes.

    Writes pictures of the best and the worst clips and the figures behind them."""

    reward: Path
    """Directory of the learned reward."""
    dataset: Path
    """Data set directory."""
    out: Path
    """Directory to write to; made if it is not there."""
    clip: str | None = None
    """One clip instead: EPISODE:START+STEPS, or the beginning of the hash of an
    episode, which is then shown whole."""
    count: Count = 3
    """Best and worst clips that are drawn."""
    method: Literal["auto", "exact", "gradients", "occlusion"] = "auto"
    """How the reward is shared among habits: exact where the model is linear, else
    integrated gradients (needs the extra `explain`), or occlusion."""
