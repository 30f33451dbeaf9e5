"""What `gaitpref team` can do and its options; a field's docstring is its `--help`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .bounds import AtLeast, Count, CountOrZero, Seed


@dataclass(frozen=True, kw_only=True)
class TeamTrain:
    """Train one policy that walks both robots of a team, or one for each.

    It begins as two robots that walk as before and do not look at each other.
    """

    out: Path
    """Directory of the training run."""
    reward: str = "task"
    """`task`: walk, and keep a formation as written by hand; `formation` or another
    criterion of `gaitpref team answer`, each robot paid half; or the directory of a
    reward of `gaitpref team fit`."""
    pay: Literal["shares", "same", "counterfactual"] = "shares"
    """What each robot is paid of a learned reward: its own share and half of the
    pair's, half of the whole, or what the team would lose had it stood still for the
    last second."""
    weight: float = 3.0
    """Weight of a reward or a criterion, beside walking and safety."""
    policies: Literal[1, 2] = 1
    """1: both robots share one policy. 2: each has its own in the same file, and learns
    from its own pay alone; where --init is of one, both begin as that."""
    init: Path | None = None
    """Policy to begin from, of a team or of a robot alone; by default the walk that
    ships."""
    steps: CountOrZero = 500_000
    """Steps of robots, counted over all of them."""
    robots: Annotated[int, AtLeast(2)] = 128
    """Robots side by side, two in every world: an even number."""
    checkpoints: CountOrZero = 2
    """Policies kept on the way, evenly spaced."""
    resume: bool = False
    """Go on from where an interrupted run in the same directory stopped."""
    seed: Seed = 0
    """Where all chance comes from."""


@dataclass(frozen=True, kw_only=True)
class TeamRecord:
    """Record episodes of teams into a data set; each file holds both robots."""

    policy: Path
    """Policy of a team."""
    dataset: Path
    """Data set directory; made if it is not there."""
    episodes: Count = 40
    """Episodes in all."""
    episode_s: float = 6.0
    """Length of an episode that does not fall."""
    lazy: float = 0.0
    """Share of the episodes in which one robot holds still for half of the time, in
    turn the first and the second, so that answers can tell what each is worth."""
    lazy_robot: Literal[1, 2] | None = None
    """The robot that is lazy, always this one."""
    round: CountOrZero = 0
    """Stored with every episode."""
    seed: Seed = 0
    """Where all chance comes from."""


@dataclass(frozen=True, kw_only=True)
class TeamAnswer:
    """Let a simulated rater answer every open pair of a data set of teams.

    People answer on the page of `gaitpref label`, which shows both robots.
    """

    dataset: Path
    """Data set directory with pairs of `gaitpref pairs`."""
    criterion: str = "formation"
    """What it looks for: formation (side by side, 0.8 m apart, turning together, doing
    what both are told), or a criterion of one robot, as crouch, of both in the mean."""
    mistakes: float = 0.0
    """Share of the answers that are turned round."""
    seed: Seed = 0
    """All chance of the answers."""


@dataclass(frozen=True, kw_only=True)
class TeamFit:
    """Fit a reward to answers about teams: shares of both robots and of the pair."""

    dataset: Annotated[list[Path], tyro.conf.UseAppendAction]
    """Data set directory; give it again for more."""
    out: Path
    """Directory of the reward; an earlier reward of a team there is replaced."""
    seed: Seed = 0
    """Resampling of the answers."""
    json: bool = False
    """Print one JSON object and nothing else."""


@dataclass(frozen=True, kw_only=True)
class TeamShares:
    """Say who earned what a team got, and which robot is lazy."""

    reward: Path
    """Directory of a reward of `gaitpref team fit`."""
    dataset: Path
    """Data set of teams."""
    round: CountOrZero | None = None
    """Episodes of this round alone."""
    json: bool = False
    """Print one JSON object and nothing else."""


TeamAction = (
    Annotated[TeamTrain, tyro.conf.subcommand("train")]
    | Annotated[TeamRecord, tyro.conf.subcommand("record")]
    | Annotated[TeamAnswer, tyro.conf.subcommand("answer")]
    | Annotated[TeamFit, tyro.conf.subcommand("fit")]
    | Annotated[TeamShares, tyro.conf.subcommand("shares")]
)


@dataclass(frozen=True)
class Team:
    """Let two robots walk in formation, and tell who earned what the team got.

    `gaitpref team train --out runs/team` begins; `pairs`, `label`, `film` and `data`
    take data sets of teams as any others.
    """

    action: tyro.conf.OmitSubcommandPrefixes[TeamAction]
