"""What MuJoCo Warp does in one go, captured as CUDA graphs.

A step of a robot is some two hundred kernels. Started one by one from Python they take
longer to start than to run; as a graph they are started at once.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager

import mujoco_warp as mjw
import warp as wp

from .warp_kernels import compile_kernels


class Graphs:
    """The work on one model and its worlds.

    Everywhere positions and velocities are current, and what follows from them: a
    control step begins with the forces.
    """

    def __init__(self, model: mjw.Model, data: mjw.Data, device: str) -> None:
        self._model, self._data, self._device = model, data, device
        self._seen: set[Hashable] = set()
        self._captured: dict[Hashable, wp.Graph] = {}

    def step(self, substeps: int) -> None:
        """Run physics, and bring up to date what follows from the new state."""
        self._run(("step", substeps), lambda: self._steps(substeps))

    def forward(self) -> None:
        """Bring up to date what follows from positions and velocities."""
        self._run("forward", lambda: mjw.step1(self._model, self._data))

    def constants(self) -> None:
        """Bring up to date what follows from masses; `forward` has to follow."""
        self._run("constants", self._constants)

    def compile(self) -> None:
        """Compile all kernels, and leave the worlds in no useful state."""
        with wp.ScopedDevice(self._device):
            compile_kernels(lambda: self._steps(1), self._device)

    def forget(self) -> None:
        """Capture anew: a graph goes on writing into arrays that were replaced."""
        self._captured.clear()

    def _steps(self, substeps: int) -> None:
        for _ in range(substeps):
            mjw.step2(self._model, self._data)
            mjw.step1(self._model, self._data)

    def _constants(self) -> None:
        mjw.set_const(self._model, self._data, restore=False)

    def _run(self, key: Hashable, work: Callable[[], None]) -> None:
        with wp.ScopedDevice(self._device):
            # The first time kernels are compiled and loaded, which a capture is not
            # the place for.
            if self._device == "cpu" or key not in self._seen:
                self._seen.add(key)
                work()
                return
            if key not in self._captured:
                with _no_collection(), wp.ScopedCapture() as capture:
                    work()
                assert capture.graph is not None
                self._captured[key] = capture.graph
            wp.capture_launch(self._captured[key])


@contextmanager
def _no_collection() -> Iterator[None]:
    """Without garbage collection: arrays of others freed in a capture end it."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
