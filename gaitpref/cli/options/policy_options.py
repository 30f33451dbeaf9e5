"""Options of the commands about policies and robots."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from policy.offpolicy.sac_cfg import OFFLINE_CLONE_WEIGHT, SacCfg

from .bounds import AtLeast, Count, CountOrZero, Seed, Width


@dataclass(frozen=True, kw_only=True)
class Train:
    """Train a policy; writes policy.pt, checkpoints and TensorBoard files.

    Several processes do it together with `torchrun --nproc-per-node 4 -m gaitpref train
    ...`: each simulates a share of the environments with chance of its own, gradients
    and statistics are averaged, and the first one writes.
    """

    out: Path
    """Directory of the training run."""
    reward: str
    """`task`, a criterion (built-in name or package.module:function), or the directory
    of a learned reward. Others than `task` are added to the known safety terms."""
    steps: CountOrZero | None = None
    """Environment steps, counted over all environments; by default 1,500,000, with
    --algorithm fastsac 300,000."""
    envs: Count = 128
    """Environments side by side; with torchrun those of all processes together, so that
    the number must be divisible by theirs."""
    checkpoints: CountOrZero = 4
    """Policies kept on the way, evenly spaced."""
    init: Path | None = None
    """Policy file to start from."""
    method: Literal["scratch", "style"] | None = None
    """Pay a learned reward as the loop does, from scratch or for a style on top of a
    walk: what of it, beside what, with which noise; `gaitpref method` says how. By
    default it is paid as it was fitted, with weight 1."""
    round: CountOrZero = 1
    """With --method: which training of the loop this is."""
    rounds: Count | None = None
    """With --method: how many there are; by default as many as of the loop's quick
    preset."""
    dataset: Path | None = None
    """With --method: data set with the clips the reward was fitted to."""
    base: Path | None = None
    """With --method style: the walking policy whose commands must be followed as well;
    by default --init."""
    first_reward: Path | None = None
    """With --method, from round 2 on: the reward of round 0, which decided whether
    answers err."""
    keep_task: bool = False
    """Keep the hand-written walking reward beside the given one, so that a style does
    not cost the walk."""
    exploration: Literal["none", "rnd", "entropy"] = "none"
    """Bonus for base motion that is new: the error of a network that learns to predict
    a random one, or the distance to the nearest states seen so far."""
    kl_penalty: Literal["none", "fixed", "adaptive"] = "none"
    """Clip the policy ratio, or penalise the KL from the policy before the update with
    a fixed or an adapted weight."""
    mirror: bool = False
    """Learn from every step as its mirror image too, on a robot whose sides are alike:
    fewer steps to a walk, each of them dearer."""
    randomize: Literal["off", "light", "full"] = "off"
    """How much robots, sensors and pushes differ from episode to episode."""
    terrain: Literal["flat", "slopes", "steps", "rough"] = "flat"
    """What is walked on: a plane, gentle hills, terraces of low steps, or rubble."""
    curriculum: bool = False
    """Ask for slow walks first, and for more as commands are followed better, in the
    end for half as much again."""
    observe: str = "all"
    """What a new policy sees: `imu` leaves out the velocity of the base, which robots
    do not measure; the critic sees it still. Or a file that says its terms in their
    order, each with scale, clip and frames: a TOML as `gaitpref policy import FILE
    --explain` prints, a policy.json, or a policy.pt."""
    history: Count = 1
    """With --observe imu: control steps that are shown, the present one included."""
    getup: bool = False
    """Begin lying after a fall, and be paid for getting up; no fall ends an episode."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where policies are trained: the processor, or an NVIDIA GPU, for which the extra
    `gpu` is installed and --envs are thousands."""
    sim: Literal["auto", "threads", "warp"] = "auto"
    """Simulator: MuJoCo on the processor's threads, or MuJoCo Warp, which also runs,
    slowly, without a GPU; what suits the device by default."""
    resume: bool = False
    """Go on from where an interrupted run in the same directory stopped; with torchrun,
    with as many processes as before."""
    actors: Count | None = None
    """Collect with so many actors, each a process on a core of its own with a share of
    the environments, while this process learns; needs Ray: pip install -e '.[scale]'.
    What is on their way when they or this process die is lost, nothing is used twice.
    By default this process does all of it."""
    ray: str | None = None
    """With --actors: the Ray they run on, HOST:PORT as `ray start --head` prints it, or
    `auto`; by default one on this machine for this command alone."""
    update: Literal["sync", "vtrace", "gradients"] = "vtrace"
    """With --actors: they wait for new weights, as in PPO; or go on while this process
    learns, and what they collect with older weights is corrected by V-trace, as
    fastsac need not; or send gradients, each taken as it comes (A3C)."""
    most_lag: CountOrZero = 2
    """With --actors: updates since the weights of a rollout; older ones are dropped."""
    algorithm: Literal["ppo", "fastsac"] = "ppo"
    """What learns: PPO from the last steps, or soft actor-critic from all it remembers:
    each step counts many times and is dearer, and those of others count (--replay)."""
    replay: tuple[Path, ...] = ()
    """With --algorithm fastsac: data sets whose episodes memory begins with, or
    directories of earlier such trainings, all scored by the present reward."""
    offline: bool = False
    """With --replay: take no new step, and stay near what was done. --steps then says
    how long is learned, as long as that many steps would be. The policy is kept, and
    the command exits 1 where it earns no more than before, 2 where it left the data
    behind."""
    clone_weight: Annotated[float, AtLeast(0)] = OFFLINE_CLONE_WEIGHT
    """With --offline: how much staying near what was done counts, beside what the
    critics say; 0: nothing."""
    memory: Count = SacCfg.memory
    """With --algorithm fastsac: steps that are remembered, 570 bytes each, in
    resume.pt too."""
    updates_per_step: float = SacCfg.updates_per_step
    """With --algorithm fastsac: updates for each environment step."""
    actor_sizes: tuple[Width, ...] = ()
    """With --algorithm fastsac: widths of the hidden layers of a new policy; 128 128 by
    default."""
    critic_sizes: tuple[Width, ...] = SacCfg.critic_sizes
    """With --algorithm fastsac: those of each critic."""
    prioritised: bool = False
    """With --algorithm fastsac: learn more often from steps the critics err about; with
    --actors this is Ape-X."""
    robot: Path | None = None
    """MJCF of the robot; the Go1 that ships by default."""
    seed: Seed = 0
    """Where all chance comes from."""

    @property
    def total_steps(self) -> int:
        """Environment steps, those of the algorithm where none are said."""
        if self.steps is not None:
            return self.steps
        return 1_500_000 if self.algorithm == "ppo" else 300_000


@dataclass(frozen=True, kw_only=True)
class Record:
    """Roll a policy and its earlier checkpoints out; log the episodes to a data set."""

    policy: Path | None = None
    """Policy file; by default the walk that ships."""
    dataset: Path
    """Data set directory; made if it is not there."""
    episodes: Count = 64
    """Episodes in all."""
    episode_s: float = 6.0
    """Length of an episode that does not fall."""
    change_s: float | None = None
    """Ask for another of the recorded commands every so many seconds: a manoeuvre, of
    which `gaitpref pairs --clip-s` asks long clips. By default an episode has one."""
    method: Literal["scratch", "style"] | None = None
    """Record what the loop records: how many episodes with noise, in which postures,
    in random rhythms."""
    round: CountOrZero = 0
    """Round of the loop that the episodes are of."""
    varied: float = 0.0
    """Share of the episodes in another posture, higher, wider or with larger steps:
    what a policy never varies itself, no answer about its clips tells."""
    compression: Literal["none", "zstd"] = "none"
    """zstd saves a fifth of the space and takes about eight times as long to write."""
    seed: Seed = 0
    """Start states and exploration noise."""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Roll a policy out over a fixed grid of commands and measure it: the means, and
    for each command what is tracked, how many robots never set off, and what comes of a
    start exactly at home."""

    policy: Path
    """Policy file."""
    reward: str = "task"
    """What the return is measured under: a criterion, as `gaitpref loop --criterion`
    takes it, or the directory of a learned reward."""
    episodes: Count = 64
    """Episodes, spread evenly over the grid."""
    terrain: Literal["flat", "slopes", "steps", "rough"] | None = None
    """What is walked on; by default what the policy was trained on."""
    json: bool = False
    """Print one JSON object and nothing else."""
    seed: Seed = 0
    """Start states."""


@dataclass(frozen=True, kw_only=True)
class Play:
    """Drive a policy from the browser, push it, compare it with another."""

    policy: Path | None = None
    """Policy file; by default the walk that ships."""
    against: Annotated[Path | None, tyro.conf.arg(aliases=["--beside"])] = None
    """Policy file shown beside it, on the same commands."""
    dataset: Path | None = None
    """Data set, made if there is none, that gets the last seconds of both robots and
    your answer whenever you press 1, to say that A walks as it should, or 2 for B."""
    port: int = 8080
    """TCP port on this machine; 0 takes a free one."""
    robot: Path | None = None
    """MJCF of the robot; the one the policy was trained on by default."""
    open: bool = False
    """Open the page in this machine's browser."""


@dataclass(frozen=True, kw_only=True)
class Film:
    """Film a policy, two of them side by side, or clips of a data set.

    `gaitpref film --out walk.mp4` shows the walk that ships.
    """

    out: Path
    """Film to write: .mp4 (extra `film`), .gif or .webp."""
    policy: Path | None = None
    """Policy file; by default the walk that ships."""
    against: Path | None = None
    """Policy file shown beside it, on the same command from an equal start."""
    command: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Of policies: forward m/s, left m/s, yaw rad/s; the nearest of the commands that
    are recorded is shown."""
    duration_s: Annotated[float, AtLeast(1)] = 10.0
    """Of policies: how long they walk."""
    dataset: Path | None = None
    """Data set that `--clip` or `--pair` is of."""
    clip: str | None = None
    """Clip as EPISODE:START+STEPS, or the hash of an episode or its beginning."""
    pair: str | None = None
    """Pair of clips by its name or the beginning of it: A left, B right."""
    speed: float = 1.0
    """1 is as fast as it was; 0.25 is slow motion."""
    fps: float = 25.0
    """Pictures a second."""
    width_px: Count = 480
    """Width of the picture of one robot."""
    height_px: Count = 360
    """Height of the picture."""
    seed: Seed = 0
    """Of policies: where they start."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a policy as ONNX, TorchScript and JSON, for the robot's own computer."""

    policy: Path
    """Policy file."""
    out: Path
    """Directory that gets policy.onnx, policy.pt, policy.json and robot.xml."""
    like: Path | None = None
    """The file the policy was imported from: write one file in its layout instead, with
    the weights of the policy, for what ran that file."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """Show what was found in a foreign robot, before anything is trained on it."""

    action: tyro.conf.Positional[Literal["inspect"]]
    """inspect prints legs, feet, home pose, limits, masses and servos, and draws it."""
    xml: tyro.conf.Positional[Path]
    """MJCF or URDF of the robot."""
    without_visuals: bool = False
    """Leave out meshes that only are looked at, as where they are not beside the model;
    other commands take the completed model of --out."""
    out: Path | None = None
    """Directory that gets NAME.png and the completed model NAME.xml; the working
    directory gets the picture alone by default."""


Preset = Literal[
    "legged-gym-a1",
    "legged-gym-go2",
    "isaac-lab-go2-flat",
    "unitree-rl-lab-go2",
    "unitree-rl-mjlab-go2",
    "mjlab-go1-flat",
    "walk-these-ways",
]


@dataclass(frozen=True, kw_only=True)
class Policy:
    """Bring a policy that others trained: it records, plays, is labeled and trained on
    like one of our own.

    Reads checkpoints of rsl_rl 1 to 5, TorchScript (of Walk These Ways in two files)
    and ONNX; nothing in them is run.
    What the numbers mean is taken from the first that is there: --preset, metadata in
    the ONNX, deploy.yaml, IO_descriptors.yaml, params/env.yaml with agent.yaml,
    config.yaml with base.yaml of rl_sar, policy.json of ours.
    """

    action: tyro.conf.Positional[Literal["import"]]
    """import reads it, tries it on the robot, and says how it walks."""
    file: tyro.conf.Positional[Path]
    """File of the policy, or the directory of its training run."""
    robot: Path | None = None
    """MJCF of its robot, or go1 for the one that ships; asked for where the policy does
    not name that one and is none of ours with its robot.xml beside it."""
    out: Path | None = None
    """Directory that gets policy.pt."""
    preset: Preset | None = None
    """The trainer it is from, where nothing beside the file says what it sees."""
    law: Path | None = None
    """TOML that says what the numbers mean, wholly or where it differs."""
    explain: bool = False
    """Print what is known, and what is guessed, as a TOML for --law, and stop."""
