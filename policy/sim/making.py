"""Which simulator runs where."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Literal

import torch

from policy.robots.robot import Robot

from .batch_sim import BatchSim, VariedBatchSim
from .sim import Sim, SimError, VariedSim

Device = Literal["cpu", "cuda"]
SimKind = Literal["auto", "threads", "warp"]

INSTALL = "pip install -e '.[gpu]' -c constraints.txt"


@dataclass(frozen=True, kw_only=True)
class SimCfg:
    """Where physics and learning run."""

    device: Device = "cpu"
    """The processor, or an NVIDIA GPU: there state, rewards and networks stay on it."""
    kind: SimKind = "auto"
    """MuJoCo on the threads of the processor, or MuJoCo Warp, which needs the extra
    `gpu` and also runs, slowly, without a GPU; `auto` is what suits the device."""

    def __post_init__(self) -> None:
        if self.device == "cuda" and self.kind == "threads":
            raise SimError(
                "--sim threads runs on the processor alone: give --device cpu, or "
                "--sim warp"
            )

    @property
    def on_warp(self) -> bool:
        """Whether it is MuJoCo Warp."""
        return self.kind == "warp" or (self.kind == "auto" and self.device == "cuda")

    def require(self) -> None:
        """Say at once what is missing.

        Raises:
            SimError: there is no GPU, or a package is not installed.
        """
        if self.device == "cuda" and not torch.cuda.is_available():
            raise SimError(
                "--device cuda needs an NVIDIA GPU and a PyTorch built for it, and "
                f"PyTorch {torch.__version__} finds none: leave --device out, or see "
                "`nvidia-smi`"
            )
        if self.on_warp:
            _require_warp()


def make_sim(robot: Robot, num_envs: int, cfg: SimCfg, *, threads: int = 0) -> Sim:
    """`num_envs` simulations of robots that are all alike, on `threads` threads of the
    processor (0: as of `BatchSim`) where that is what runs them.

    Raises:
        SimError: see `SimCfg.require`; or the robot has parts it does not know.
        DeviceMemoryError: they do not fit into the GPU's memory.
    """
    if not cfg.on_warp:
        return BatchSim(robot, num_envs, threads=threads)
    cfg.require()
    from .warp_sim import WarpSim

    return WarpSim(robot, num_envs, device=_own(cfg.device))


def make_varied_sim(
    robot: Robot, num_envs: int, cfg: SimCfg, *, threads: int = 0
) -> VariedSim:
    """`num_envs` simulations of robots that differ; `threads` as of `make_sim`.

    Raises:
        GaitprefError: as of `make_sim`.
    """
    if not cfg.on_warp:
        return VariedBatchSim(robot, num_envs, threads=threads)
    cfg.require()
    from .varied_warp import VariedWarpSim

    return VariedWarpSim(robot, num_envs, device=_own(cfg.device))


def _own(device: Device) -> str:
    """`device` by its full name: of several GPUs the one this process trains on, where
    Warp by itself might take the first."""
    return device if device == "cpu" else f"cuda:{torch.cuda.current_device()}"


def _require_warp() -> None:
    try:
        import warp

        # Before it greets.
        warp.config.log_level = warp.LOG_WARNING
        importlib.import_module("mujoco_warp")
    except ImportError as error:
        raise SimError(f"--sim warp needs MuJoCo Warp ({error}): {INSTALL}") from None
