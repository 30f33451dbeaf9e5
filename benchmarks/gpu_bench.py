"""What the parts of `benchmarks.gpu` share: options, the device, and rows."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import torch
from torch import Tensor

from data.files.files import write_atomically
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.sim.making import Device, SimCfg

from .harness import Figure

ENV = EnvCfg()
Part = Literal[
    "first",
    "parity",
    "reset",
    "diverged",
    "bare",
    "env",
    "varied",
    "ppo",
    "walk",
    "profile",
]
PARTS: tuple[Part, ...] = get_args(Part)
Row = dict[str, Figure]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Check and measure the GPU."""

    device: Device = "cuda"
    """Where the worlds are; `cpu` is Warp's own, which shows that everything runs."""
    parts: tuple[Part, ...] = PARTS
    """What is done, in this order."""
    sizes: tuple[int, ...] = (1024, 4096, 8192)
    """Worlds side by side whose speed is measured."""
    envs: int = 4096
    """Worlds of the checks, of PPO and of the walk."""
    turn_s: float = 5.0
    """How long one speed is measured."""
    iterations: int = 50
    """Iterations of PPO that are measured, behind as many others, and no more than
    five."""
    walk_iterations: int = 400
    """Iterations after which a training has failed that does not walk."""
    walk_every: int = 5
    """Iterations between two policies that are looked at."""
    walk_s: float = 90.0
    """Time after which it has."""
    seeds: tuple[int, ...] = (0, 1)
    """Of the walks."""
    out: Path = Path("docs/results/gpu")
    """Directory of the rows."""
    work: Path = Path("runs/benchmark-gpu")
    """Directory of the trainings."""
    quick: bool = False
    """Few worlds, short turns; the figures mean nothing."""


class Bench:
    """One run of the script on one device."""

    def __init__(self, options: Options) -> None:
        self.options = options
        self.cfg = SimCfg(device=options.device, kind="warp")
        self.cfg.require()
        self.robot = load_robot(physics_dt_s=ENV.physics_dt_s)
        self.cuda = options.device == "cuda"
        self.card = torch.cuda.get_device_name() if self.cuda else "Warp's CPU device"

    def write(self, name: str, row: Row) -> None:
        """Print a row and keep it as a file."""
        told: Row = {
            "part": name,
            "card": self.card,
            "torch": torch.__version__,
            "python": platform.python_version(),
            **row,
        }
        print(json.dumps(told), flush=True)
        self.options.out.mkdir(parents=True, exist_ok=True)
        path = self.options.out / f"{name}.json"
        write_atomically(path, (json.dumps(told, indent=1) + "\n").encode())

    def wait(self) -> None:
        """Until the device has done all it was told."""
        if self.cuda:
            torch.cuda.synchronize()

    def seconds(self, work: Callable[[], object]) -> float:
        """Wall-clock time of `work`, waited for."""
        self.wait()
        start_s = time.perf_counter()
        work()
        self.wait()
        return time.perf_counter() - start_s

    def used_mb(self) -> float:
        """Memory of the device in use, by whomever."""
        if not self.cuda:
            return 0.0
        free, whole = torch.cuda.mem_get_info()
        return (whole - free) / 2**20

    def actions(self, num_envs: int, *, scale: float = 1.0) -> Tensor:
        """Random actions [16, N, 12], to be gone through in turn."""
        rng = torch.Generator().manual_seed(0)
        draws = scale * torch.randn(16, num_envs, 12, generator=rng)
        return draws.to(self.options.device)
