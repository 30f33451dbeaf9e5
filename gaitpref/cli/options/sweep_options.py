"""Options that every loop has, and those of many loops at once."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from policy.offpolicy.sac_cfg import SacCfg

from .bounds import Count, Seed, Width
from .reward_options import Erring


@dataclass(frozen=True, kw_only=True)
class Looping:
    """What is decided of a loop before it starts."""

    rounds: Count | None = None
    """Times questions are asked and the policy retrained; the preset's by default."""
    labels: Count | None = None
    """Answers in all, over all rounds; the preset's by default."""
    steps: Count | None = None
    """Environment steps of each training; the preset's by default."""
    clip_s: float = 1.2
    """Length of a clip; 5 to 20 to ask about a whole manoeuvre. Episodes are recorded
    three clips long, and no shorter than else."""
    change_s: float | None = None
    """Ask for another command every so many seconds of what is recorded."""
    stop_asking: bool = False
    """End a round's questions early where more answers will not help now."""
    base: str | None = None
    """What the learned reward is added to: `walk`, the walking policy that ships; a
    policy file; `task`, a policy first trained on the hand-written walking reward; or
    `none`, a new policy and the known safety terms only. By default `walk`, and `task`
    for another --robot or with --getup."""
    getup: bool = False
    """Begin episodes lying after a fall, which no fall ends, and ask for no walk; the
    `task` is getting up then. With `--base none` answers alone teach it."""
    preset: Literal["quick", "standard"] = "standard"
    """Sets what is not given: quick takes a style
    in about three minutes on two cores, a walk from nothing in seven."""
    algorithm: Literal["ppo", "fastsac"] = "ppo"
    """What trains: PPO, or soft actor-critic, which goes on with the memory of the
    round before, scored by the new reward, finds its own noise, and takes many times as
    long a step: give fewer --steps."""
    actor_sizes: tuple[Width, ...] = ()
    """With --algorithm fastsac and no policy to begin with: widths of the hidden layers
    of the policy; 128 128 by default."""
    critic_sizes: tuple[Width, ...] = SacCfg.critic_sizes
    """With --algorithm fastsac: widths of the hidden layers of each critic."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where policies are trained: the processor, or an NVIDIA GPU, for which the extra
    `gpu` is installed."""
    sim: Literal["auto", "threads", "warp"] = "auto"
    """Simulator: MuJoCo on the processor's threads, or MuJoCo Warp, which also runs,
    slowly, without a GPU; what suits the device by default."""
    robot: Path | None = None
    """MJCF of the robot; the Go1 that ships by default."""
    erring: Erring = field(default_factory=Erring)
    """How the simulated rater errs: what would come of answers like yours?"""


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Run many loops: criteria, settings and seeds, each with each, and compare them.

    What is finished is not run again, what was interrupted goes on, and a loop that
    fails does not stop the others; it is named at the end, and the exit code is 1.
    """

    out: Path
    """Directory of the sweep: a run for each loop in cells/, what it said in logs/, and
    index.html, results.csv and results.json."""
    criterion: tuple[str, ...] = ()
    """What the simulated raters look for, as of `gaitpref loop`; high_step by
    default."""
    seed: tuple[Seed, ...] = ()
    """Seeds that means are over; 0 1 2 by default."""
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME=VALUE,VALUE,... to vary an option of `gaitpref loop`, as labels=20,60 or
    mistakes=0,0.2, or any setting of its config.yaml by its dotted path, as
    method.weight=1,3 or method.accept=null; give it again for more."""
    plan: Path | None = None
    """YAML or TOML file with `criterion`, `seed`, `set`, and `loop` for what all loops
    share; `variants` names changes that go together. Options given here count more."""
    jobs: Count | None = None
    """Loops side by side on this machine, which share its cores; one a core by
    default."""
    ray: str | None = None
    """Run them on a Ray cluster instead: HOST:PORT, `auto` for the one that runs here,
    or `local` for one of this machine's cores. Each loop has a core there; --out must
    lie where all machines reach it."""
    gpu: float | None = None
    """With --device cuda: share of a GPU that each loop gets, as 0.5, or how many; it
    waits until that much is free. A whole one by default."""
    dry_run: bool = False
    """Show what would be run, and how far each is; write nothing."""
    json: bool = False
    """Print one JSON object and nothing else."""
    loop: Looping = field(default_factory=Looping)
    """What holds for every loop."""
