"""Kernels of MuJoCo Warp, compiled side by side instead of one after the other.

Warp compiles a kernel where it is first started: a hundred times on the way through the
first step, two minutes and more of one core. Which they are is known once the step was
gone through without starting any.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import warp as wp

from policy.parallel.cores import cores

Kinds = dict[int | None, set[Any]]
"""Modules of kernels by the threads of a block they are started with."""


def compile_kernels(work: Callable[[], None], device: str) -> None:
    """Compile what `work` starts on `device`; later runs find it in Warp's cache.

    What `work` would compute is not: give it data that is not needed any more.
    """
    with _only_noted() as noted:
        work()
    for threads, modules in noted.items():
        wp.force_load(
            device=device,
            modules=list(modules),
            block_dim=threads,
            max_workers=cores(),
        )


@contextmanager
def _only_noted() -> Iterator[Kinds]:
    """Note kernels instead of starting them, and go through every branch once."""
    noted: Kinds = defaultdict(set)

    def launch(
        kernel: Any,
        dim: Any,
        *arguments: Any,
        block_dim: int | None = None,
        **named: Any,
    ) -> None:
        # Of what the robot has none, no kernel is compiled.
        if 0 not in (dim if isinstance(dim, Iterable) else (dim,)):
            noted[block_dim].add(kernel.module)

    def loop(condition: Any, while_body: Callable[..., None], **named: Any) -> None:
        while_body(**named)

    def branch(
        condition: Any,
        on_true: Callable[..., None] | None = None,
        on_false: Callable[..., None] | None = None,
        **named: Any,
    ) -> None:
        for body in (on_true, on_false):
            if body is not None:
                body(**named)

    instead = {
        "launch": launch,
        "launch_tiled": launch,
        "capture_while": loop,
        "capture_if": branch,
    }
    own = {name: getattr(wp, name) for name in instead}
    try:
        for name, function in instead.items():
            setattr(wp, name, function)
        yield noted
    finally:
        for name, function in own.items():
            setattr(wp, name, function)
