"""Memory of a GPU: who asks for more robots than fit is told how many would."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from .sim import SimError

_SHARE = 0.8
"""Of the memory that is counted on: it comes in pieces, and some stay empty."""


class DeviceMemoryError(SimError):
    """More robots than fit into the memory of a GPU."""


@contextmanager
def told_of_memory(num_envs: int) -> Iterator[None]:
    """Say in one line that the memory of the GPU is used up, and what would fit.

    Raises:
        DeviceMemoryError: it is.
    """
    try:
        yield
    except (torch.OutOfMemoryError, RuntimeError) as error:
        # Warp has no exception of its own.
        ours = isinstance(error, torch.OutOfMemoryError)
        if not (ours or "Failed to allocate" in str(error)):
            raise
        free, whole = torch.cuda.mem_get_info()
        each = max(whole - free, 1) / num_envs
        raise too_many(num_envs, int(_SHARE * whole / each)) from None


def too_many(num_envs: int, fit: int) -> DeviceMemoryError:
    """What to raise where `num_envs` robots are too many and about `fit` are not."""
    free, whole = (each / 2**30 for each in torch.cuda.mem_get_info())
    return DeviceMemoryError(
        f"{num_envs:,} robots do not fit into the memory of "
        f"{torch.cuda.get_device_name()} ({free:.1f} of {whole:.1f} GB are free): "
        f"about {max(fit, 0):,} would; give fewer with --envs, or end what else uses it"
    )
