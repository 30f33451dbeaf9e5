"""The commands and their options; a field's docstring is its `--help`.

Nothing here imports torch or a simulator: `gaitpref --help` answers at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .arena_options import Arena as Arena
from .bounds import AtLeast, Count, Seed
from .choice_options import Options as Options
from .data_options import Data as Data
from .policy_options import Evaluate as Evaluate
from .policy_options import Export as Export
from .policy_options import Film as Film
from .policy_options import Play as Play
from .policy_options import Policy as Policy
from .policy_options import Record as Record
from .policy_options import Robot as Robot
from .policy_options import Train as Train
from .program_options import Asking, Teaching
from .reward_options import Answer as Answer
from .reward_options import Erring as Erring
from .reward_options import Explain as Explain
from .reward_options import Fit as Fit
from .reward_options import Pairs as Pairs
from .reward_options import Relabel as Relabel
from .reward_options import Trust as Trust
from .sweep_options import Looping
from .sweep_options import Sweep as Sweep
from .team_options import Team as Team


@dataclass(frozen=True, kw_only=True)
class Serving:
    """Where the labeling page is served, and to whom."""

    host: str = "127.0.0.1"
    """Address to listen on; beyond loopback it needs tokens of `gaitpref raters`."""
    port: int = 8080
    """TCP port; a busy one is an error, 0 takes a free one."""
    guidelines: Path | None = None
    """Markdown that tells people what to look for. It is read anew each time, so that
    the page shows what is being written."""
    cert: Path | None = None
    """Certificate chain for TLS, PEM."""
    key: Path | None = None
    """Private key of the certificate, PEM."""
    public_url: str | None = None
    """What people open where a reverse proxy stands before the page, as
    https://label.example.org/gait."""
    no_auth: bool = False
    """Ask for no token; only on loopback."""
    most_raters: Count = 40
    """Raters whose pages may be open at once; the next is told when to come back."""
    open: bool = False
    """Open the page in this machine's browser; a loop that asks a program opens its
    report at the end."""


@dataclass(frozen=True, kw_only=True)
class _InRun:
    run: Path
    """Directory of the run; everything it makes is in there."""


# Options of the last base stand first in the help.
@dataclass(frozen=True, kw_only=True)
class Loop(Looping, _InRun):
    """Train, record, ask, fit and retrain, round after round.

    Killed anywhere and started again with the same command, it goes on where it was.
    With `torchrun --nproc-per-node 4 -m -- gaitpref loop ...` several processes train
    together; all the rest is done by the first one.
    """

    rater: str = "simulated"
    """Who answers: simulated, by a criterion; human, people on a labeling page that is
    up all the time; or a program that looks at clips: your own function as
    package.module:function, which is imported and so run, or a vision model as
    openai:http://127.0.0.1:PORT/v1."""
    asking: Asking = field(default_factory=Asking)
    teaching: Teaching = field(default_factory=Teaching)
    patience: Annotated[float, AtLeast(0)] | None = None
    """Minutes a round waits for people; then it goes on with the answers there are.
    Without it, a round waits until all its pairs are answered."""
    apart: Annotated[float, AtLeast(0)] | None = None
    """How different the two clips of a pair look that people are asked about, in
    differences they just notice (0.5 for experts), 1 by default; others come only where
    there are not so many."""
    criterion: str = "high_step"
    """What the simulated rater looks for: task, smooth, high_step, crouch, low_energy,
    trot, trot@HZ, pace, get_up, or your own as package.module:function, a callable
    features [..., F] -> score [...]."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    seed: Seed = 0
    """Where all chance comes from: equal seeds give equal files."""
    page: Serving = Serving()
    """The page people answer on, with `--rater human`."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write report/index.html of a run: curves per round, readable without a server."""

    run: Path
    """Directory of the run."""
    open: bool = False
    """Open it in this machine's browser."""


@dataclass(frozen=True, kw_only=True)
class Watch:
    """Show a run or a training on one live page: curves, answers, round, time left.

    It only reads, may come and go while the run goes on, and shows a finished one too.
    """

    run: tyro.conf.Positional[Path]
    """Directory of `gaitpref loop --run` or of `gaitpref train --out`."""
    port: int = 8090
    """TCP port on this machine; 0 takes a free one."""
    wandb: Annotated[str | None, tyro.conf.arg(metavar="PROJECT")] = None
    """Send its curves and rounds to this project of Weights & Biases too."""
    open: bool = False
    """Open the page in this machine's browser."""


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Look whether this machine has what gaitpref needs, and say what to do.

    Exits 1 where something is broken that nobody can do without.
    """

    json: bool = False
    """Print one JSON object and nothing else."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """Show what the loop decides on the way, from scratch and for a style."""

    run: Path | None = None
    """Directory of a run: show the method it was told instead, and what it decided by
    now, as whether its answers err."""
    json: bool = False
    """Print one JSON object and nothing else."""


RatersAction = Literal[
    "list", "add", "revoke", "stats", "groups", "compare",
    "leave-out", "take-in", "gold",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Raters:
    """Say who may log in to the labeling page, how well they agree, and who teaches.

    `gaitpref raters --dataset DIR gold PAIR --known a` adds a question whose answer is
    known.
    """

    action: tyro.conf.Positional[RatersAction] = "list"
    """list shows who has a token, who is in and since when not; add makes a login link
    and shows it once, as text and to be scanned; revoke makes it worthless; stats shows
    speed, habits and agreement; groups shows who wants the same, and whose taste has
    changed; compare shows how far programs agree with people, which side they like,
    what they cost, and whether they may teach; leave-out keeps the answers of a rater
    and learns nothing from them, take-in takes that back; gold shows the pairs whose
    answer is known, and how many gave it."""
    name: tyro.conf.Positional[str | None] = None
    """Rater: letters, digits, - and _; a pseudonym is best. Of gold, a pair by its id
    or the beginning of it."""
    known: Literal["a", "b", "equal"] | None = None
    """Of gold with a pair: the answer that everybody gives who looks. The two clips are
    asked about once more, swapped, now and then; that measures raters."""
    withdraw: bool = False
    """Of gold with a pair whose answer is known: ask it no more, and measure nobody by
    it. Its answers are kept."""
    url: str = "http://127.0.0.1:8080"
    """Where the page is opened; the login link begins with it."""
    dataset: Path
    """Data set directory."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    json: bool = False
    """Print one JSON object and nothing else."""


@dataclass(frozen=True, kw_only=True)
class Label(Serving):
    """Serve the labeling page of a data set: people see two clips and say which is
    better."""

    dataset: Path | None = None
    """Data set directory with pairs; by default runs/first, which is made of the walk
    that ships where it is not there yet."""
    reward: Path | None = None
    """A reward of `fit`, `team fit` or `options`: after an answer, key 6 also draws
    what of the pair moved it. A loop shows its newest. Leave it out where people are to
    judge by themselves."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""


Command = (
    Annotated[Loop, tyro.conf.subcommand("loop")]
    | Annotated[Sweep, tyro.conf.subcommand("sweep")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Options, tyro.conf.subcommand("options")]
    | Annotated[Record, tyro.conf.subcommand("record")]
    | Annotated[Pairs, tyro.conf.subcommand("pairs")]
    | Annotated[Answer, tyro.conf.subcommand("answer")]
    | Annotated[Fit, tyro.conf.subcommand("fit")]
    | Annotated[Relabel, tyro.conf.subcommand("relabel")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Watch, tyro.conf.subcommand("watch")]
    | Annotated[Method, tyro.conf.subcommand("method")]
    | Annotated[Trust, tyro.conf.subcommand("trust")]
    | Annotated[Explain, tyro.conf.subcommand("explain")]
    | Annotated[Raters, tyro.conf.subcommand("raters")]
    | Annotated[Label, tyro.conf.subcommand("label")]
    | Annotated[Play, tyro.conf.subcommand("play")]
    | Annotated[Arena, tyro.conf.subcommand("arena")]
    | Annotated[Film, tyro.conf.subcommand("film")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[Policy, tyro.conf.subcommand("policy")]
    | Annotated[Robot, tyro.conf.subcommand("robot")]
    | Annotated[Team, tyro.conf.subcommand("team")]
    | Annotated[Data, tyro.conf.subcommand("data")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
)
