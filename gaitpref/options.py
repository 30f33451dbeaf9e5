"""The commands and their options; a field's docstring is its `--help`.

Nothing here imports torch or a simulator: `gaitpref --help` answers at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from data.errors import GaitprefError

from .data_options import Data as Data


@dataclass(frozen=True, kw_only=True)
class Serving:
    """Where the labeling page is served, and to whom."""

    host: str = "127.0.0.1"
    """Address to listen on; beyond loopback it needs tokens of `gaitpref raters`."""
    port: int = 8080
    """TCP port; a busy one is an error, 0 takes a free one."""
    guidelines: Path | None = None
    """Markdown that tells people what to look for."""
    cert: Path | None = None
    """Certificate chain for TLS, PEM."""
    key: Path | None = None
    """Its private key, PEM."""
    no_auth: bool = False
    """Ask for no token; only on loopback."""


@dataclass(frozen=True, kw_only=True)
class Loop:
    """Train, record, ask, fit and retrain, round after round.

    Killed anywhere and started again with the same command, it goes on where it was.
    """

    run: Path
    """Directory of the run; everything it makes is in there."""
    rounds: int | None = None
    """Times questions are asked and the policy retrained; the preset's by default."""
    labels: int | None = None
    """Answers in all, over all rounds; the preset's by default."""
    stop_asking: bool = False
    """End a round's questions early where more answers will not help now."""
    rater: Literal["simulated", "human"] = "simulated"
    """Who answers: a program, or people on a labeling page that is up all the time."""
    patience: float | None = None
    """Minutes a round waits for people; then it goes on with the answers there are.
    Without it, a round waits until all its pairs are answered."""
    criterion: str = "high_step"
    """What the simulated rater looks for: task, smooth, high_step, crouch, low_energy,
    trot, trot@HZ, pace, get_up, or your own as package.module:function, a callable
    features [..., F] -> score [...]."""
    base: str = "task"
    """What the learned reward is added to: `task`, a policy first trained on the
    hand-written walking reward; `none`, a new policy and the known safety terms only;
    or a policy file."""
    preset: Literal["quick", "standard"] = "standard"
    """Sets what is not given: quick takes about ten minutes on two cores."""
    robot: Path | None = None
    """MJCF of the robot; the Go1 that ships by default."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    seed: int = 0
    """Where all chance comes from: equal seeds give equal files."""
    page: Serving = Serving()
    """The page people answer on, with `--rater human`."""


@dataclass(frozen=True, kw_only=True)
class Train:
    """Train a policy with PPO; writes policy.pt, checkpoints and TensorBoard files."""

    out: Path
    """Directory of the training run."""
    reward: str
    """`task`, a criterion (built-in name or package.module:function), or the directory
    of a learned reward. Others than `task` are added to the known safety terms."""
    steps: int = 1_500_000
    """Environment steps, counted over all environments."""
    envs: int = 256
    """Environments side by side."""
    checkpoints: int = 4
    """Policies kept on the way, evenly spaced."""
    init: Path | None = None
    """Policy file to start from."""
    keep_task: bool = False
    """Keep the hand-written walking reward beside the given one, so that a style does
    not cost the walk."""
    exploration: Literal["none", "rnd", "entropy"] = "none"
    """Bonus for base motion that is new: the error of a network that learns to predict
    a random one, or the distance to the nearest states seen so far."""
    kl_penalty: Literal["none", "fixed", "adaptive"] = "none"
    """Clip the policy ratio, or penalise the KL from the policy before the update with
    a fixed or an adapted weight."""
    randomize: Literal["off", "light", "full"] = "off"
    """How much robots, sensors and pushes differ from episode to episode."""
    terrain: Literal["flat", "slopes", "steps", "rough"] = "flat"
    """What is walked on: a plane, gentle hills, terraces of low steps, or rubble."""
    curriculum: bool = False
    """Ask for slow walks first, and for more as commands are followed better, in the
    end for half as much again."""
    getup: bool = False
    """Begin lying after a fall, and be paid for getting up; no fall ends an episode."""
    resume: bool = False
    """Go on from where an interrupted run in the same directory stopped."""
    robot: Path | None = None
    """MJCF of the robot; the Go1 that ships by default."""
    seed: int = 0
    """Where all chance comes from."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """Roll a policy and its earlier checkpoints out; log the episodes to a data set."""

    policy: Path
    """Policy file."""
    dataset: Path
    """Data set directory; made if it is not there."""
    episodes: int = 64
    """Episodes in all."""
    compression: Literal["none", "zstd"] = "none"
    """zstd saves a fifth of the space and takes about eight times as long to write."""
    seed: int = 0
    """Start states and exploration noise."""


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Choose pairs of clips to ask about."""

    dataset: Path
    """Data set directory."""
    count: int
    """Pairs to add."""
    gold: int = 0
    """Pairs with a known answer to add as well, to measure raters: of the two robots,
    one falls. Fewer where not so many fell."""
    strategy: (
        Literal[
            "uniform", "disagreement", "entropy", "bald", "kcenter", "medoids", "dpp"
        ]
        | None
    ) = None
    """At random; where the ensemble disagrees, where the answer is most open, or where
    it would tell most about the reward (bald); the pairs farthest apart, those that
    stand for most others, or a determinantal batch that is both unsure and various.
    disagreement where --reward is given, else uniform."""
    reward: Path | None = None
    """Learned reward whose ensemble is asked; disagreement, entropy and bald need it,
    kcenter and dpp take it into account."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    seed: int = 0
    """Which of equally good pairs are taken."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Let the simulated rater answer every open pair."""

    dataset: Path
    """Data set directory."""
    criterion: str
    """task, smooth, high_step, crouch, low_energy, trot, pace, get_up, a trot of
    another frequency as trot@HZ, or your own as package.module:function."""
    rater: Literal["perfect", "stochastic"] = "perfect"
    """Takes the better clip, or is the less sure the closer the two are."""
    beta: float | None = None
    """How sure the stochastic rater is: P(a) = sigmoid(BETA * lead), the lead in units
    of the median lead of the pairs asked so far. 1 by default: about 30 % of the
    answers are wrong, most of them on close pairs; with 3 about 14 %."""
    gamma: float = 1.0
    """Myopia in (0, 1]: a step counts GAMMA times as much as the one after it."""
    mistakes: float = 0.0
    """Share of the answers that are turned round, however clear the pair."""
    skip: float = 0.0
    """"Can't tell" where both clips are among the worst SKIP (a share) of those asked
    about."""
    equal: float = 0.0
    """"Equal" where the lead is below EQUAL times the median lead."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    seed: int = 0
    """All chance of the answers, and which clip of a pair was shown left."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Fit a reward model to the answers of one or more data sets."""

    dataset: Annotated[list[Path], tyro.conf.UseAppendAction]
    """Data set directory; give it again for more."""
    out: Path
    """Directory of the reward."""
    model: Literal["auto", "linear", "gp", "mlp", "history", "transformer"] = "linear"
    """Linear in the gait descriptors, a Gaussian process or a small network on them, a
    network or a transformer on the last half second, for rhythms; or whichever of these
    foresees held-out answers best."""
    json: bool = False
    """Print one JSON object and nothing else."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    seed: int = 0
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
class Evaluate:
    """Roll a policy out over a fixed grid of commands and measure it."""

    policy: Path
    """Policy file."""
    reward: str = "task"
    """Criterion or learned reward the return is measured under."""
    episodes: int = 64
    """Episodes, spread evenly over the grid."""
    terrain: Literal["flat", "slopes", "steps", "rough"] | None = None
    """What is walked on; by default what the policy was trained on."""
    json: bool = False
    """Print one JSON object and nothing else."""
    seed: int = 0
    """Start states."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write report/index.html of a run: curves per round, readable without a server."""

    run: Path
    """Directory of the run."""


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
    picture: Path | None = None
    """Write the reliability plot to this file, .svg or .png."""
    json: bool = False
    """Print one JSON object and nothing else; `alarm` is a reason, or null."""
    seed: int = 0
    """Bootstrap draws and start states."""


@dataclass(frozen=True, kw_only=True)
class Explain:
    """Show which moments and which habits a learned reward likes.

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
    count: int = 3
    """Best and worst clips that are drawn."""
    method: Literal["auto", "exact", "gradients", "occlusion"] = "auto"
    """How the reward is shared among habits: exact where the model is linear, else
    integrated gradients (needs the extra `explain`), or occlusion."""


@dataclass(frozen=True, kw_only=True)
class Raters:
    """Say who may log in to the labeling page, and how well they agree."""

    action: tyro.conf.Positional[Literal["list", "add", "revoke", "stats"]] = "list"
    """list shows who has a token; add makes one and shows it once; revoke makes it
    worthless; stats shows speed, habits and agreement."""
    name: tyro.conf.Positional[str | None] = None
    """Rater to add or revoke: letters, digits, - and _. A pseudonym is best."""
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

    dataset: Path
    """Data set directory with pairs."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""


@dataclass(frozen=True, kw_only=True)
class Play:
    """Drive a policy from the browser, push it, compare it with another."""

    policy: Path
    """Policy file."""
    against: Path | None = None
    """Policy file shown beside it, on the same commands."""
    port: int = 8080
    """TCP port on this machine; 0 takes a free one."""
    robot: Path | None = None
    """MJCF of the robot; the one the policy was trained on by default."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a policy as ONNX, TorchScript and JSON, for the robot's own computer."""

    policy: Path
    """Policy file."""
    out: Path
    """Directory that gets policy.onnx, policy.pt, policy.json and robot.xml."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """Show what was found in a foreign MJCF, before anything is trained on it."""

    action: tyro.conf.Positional[Literal["inspect"]]
    """inspect prints legs, feet, home pose, limits, masses and servos, and draws it."""
    xml: tyro.conf.Positional[Path]
    """MJCF of the robot."""
    out: Path | None = None
    """Directory that gets NAME.png and the completed model NAME.xml; the working
    directory gets the picture alone by default."""


_MINIMUM = {
    "count": 1,
    "envs": 1,
    "episodes": 1,
    "gold": 0,
    "labels": 1,
    "patience": 0,
    "rounds": 1,
    "seed": 0,
    "steps": 0,
}


def check(command: object) -> None:
    """Refuse numbers no command can work with.

    Raises:
        GaitprefError: an option is below its smallest value.
    """
    for name, smallest in _MINIMUM.items():
        value = getattr(command, name, None)
        if value is not None and value < smallest:
            raise GaitprefError(f"--{name} must be at least {smallest}, got {value}")


Command = (
    Annotated[Loop, tyro.conf.subcommand("loop")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Record, tyro.conf.subcommand("record")]
    | Annotated[Pairs, tyro.conf.subcommand("pairs")]
    | Annotated[Answer, tyro.conf.subcommand("answer")]
    | Annotated[Fit, tyro.conf.subcommand("fit")]
    | Annotated[Relabel, tyro.conf.subcommand("relabel")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Trust, tyro.conf.subcommand("trust")]
    | Annotated[Explain, tyro.conf.subcommand("explain")]
    | Annotated[Raters, tyro.conf.subcommand("raters")]
    | Annotated[Label, tyro.conf.subcommand("label")]
    | Annotated[Play, tyro.conf.subcommand("play")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[Robot, tyro.conf.subcommand("robot")]
    | Annotated[Data, tyro.conf.subcommand("data")]
)
