"""Processes that train one policy together, each on environments of its own.

Synchronous data parallelism (Heess et al. 2017, arXiv 1707.02286): every rank takes the
same step, along the mean of the gradients of all. What is averaged here is the same on
all ranks to the last bit, so that their networks stay the same.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta

import torch
from torch import Tensor
from torch import distributed as dist

from data.errors import GaitprefError, RankLost

from .cores import cores

_TIMEOUT = timedelta(minutes=10)
"""How long a rank waits for another in the middle of a training; one that dies is
noticed at once."""
_PATIENCE = timedelta(days=365)
"""How long ranks wait for the first one to begin a training."""
_NO_TRAINING = -1


@dataclass(frozen=True, eq=False)
class Ranks:
    """The processes of a training as one of them sees them; one alone by default."""

    rank: int = 0
    """Which of them this is; the first one writes."""
    size: int = 1
    """How many there are."""
    here: int = 1
    """How many of them run on this machine."""
    waiting: dist.ProcessGroup | None = None
    """Where the others wait for the first."""

    @property
    def is_first(self) -> bool:
        """Whether this is the one that writes."""
        return self.rank == 0

    @property
    def threads(self) -> int:
        """Threads this one may simulate with: its share of this machine's cores."""
        return max(1, cores() // self.here)

    def share_of(self, num_envs: int) -> int:
        """How many of `num_envs` environments each rank has.

        Raises:
            GaitprefError: they cannot be shared evenly.
        """
        if num_envs % self.size:
            raise GaitprefError(
                f"{num_envs} environments cannot be shared evenly by {self.size} "
                f"ranks: give --envs {(num_envs // self.size + 1) * self.size}, or "
                "start a number of ranks that divides them"
            )
        return num_envs // self.size

    def average(self, tensors: Sequence[Tensor]) -> None:
        """Put the mean over all ranks into each of `tensors`, which are of one kind."""
        if self.size == 1:
            return
        flat = torch.cat([tensor.reshape(-1) for tensor in tensors])
        dist.all_reduce(flat)
        flat /= self.size
        parts = flat.split([tensor.numel() for tensor in tensors])
        for tensor, part in zip(tensors, parts, strict=True):
            tensor.copy_(part.view_as(tensor))

    def mean(self, values: Tensor) -> Tensor:
        """Mean of the `values` of all ranks, which have equally many."""
        mean = values.mean()
        self.average([mean])
        return mean

    def mean_and_std(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation of the `values` of all ranks, which have equally
        many."""
        if self.size == 1:
            return values.mean(), values.std()
        mean = self.mean(values)
        square = self.mean((values - mean).square())
        count = values.numel() * self.size
        return mean, (square * count / (count - 1)).sqrt()

    def means(self, numbers: Mapping[str, float]) -> dict[str, float]:
        """Every number's mean over all ranks, which name the same ones."""
        values = torch.tensor(list(numbers.values()), dtype=torch.float64)
        self.average([values])
        return dict(zip(numbers, values.tolist(), strict=True))

    def any(self, happened: bool) -> bool:
        """Whether it happened on one of them."""
        return self.means({"happened": float(happened)})["happened"] > 0.0

    def meet(self) -> None:
        """Go on when all have come here."""
        # torch's own barrier would go over GPUs, which not every rank need have.
        self.any(False)

    def gathered(self, content: bytes) -> list[Tensor]:
        """The bytes that every rank has, on the first one; nothing on the others."""
        size = torch.tensor([len(content)])
        sizes = [torch.zeros_like(size) for _ in range(self.size)]
        dist.all_gather(sizes, size)
        longest = max(int(each) for each in sizes)
        padded = torch.zeros(longest, dtype=torch.uint8)
        padded[: len(content)] = _as_tensor(content)
        if not self.is_first:
            dist.gather(padded, dst=0)
            return []
        parts = [torch.zeros_like(padded) for _ in range(self.size)]
        dist.gather(padded, parts, dst=0)
        return [
            part[: int(each)].clone() for part, each in zip(parts, sizes, strict=True)
        ]

    def require_same(self, what: str) -> None:
        """Go on only if `what` decides a training is the same everywhere.

        Raises:
            GaitprefError: it is not; on every rank.
        """
        if self.size == 1:
            return
        own = _as_tensor(hashlib.sha256(what.encode()).digest())
        all_of_them = [torch.zeros_like(own) for _ in range(self.size)]
        dist.all_gather(all_of_them, own)
        for rank, other in enumerate(all_of_them):
            if not other.equal(all_of_them[0]):
                raise GaitprefError(
                    f"rank {rank} was started with other settings, or sees other "
                    "files, than rank 0: give all of them the same command, version "
                    "and directories"
                )

    def begin(self, training: int) -> None:
        """On the first rank: call the others, who wait in `awaited`, to `training`."""
        self._told(training)

    def end(self) -> None:
        """On the first rank: tell the others that there will be no more training."""
        self._told(_NO_TRAINING)

    def awaited(self) -> int | None:
        """Not on the first rank: the training it calls to next; None at the end."""
        told = self._told(_NO_TRAINING)
        return None if told == _NO_TRAINING else told

    def _told(self, number: int) -> int:
        """The number the first one gives."""
        if self.size == 1:
            return number
        told = torch.tensor([number])
        dist.broadcast(told, src=0, group=self.waiting)
        return int(told)


ALONE = Ranks()


def _as_tensor(content: bytes) -> Tensor:
    return torch.frombuffer(bytearray(content), dtype=torch.uint8)


@contextmanager
def joined() -> Iterator[Ranks]:
    """The ranks that torchrun started, this process being one of them.

    They speak through gloo about what is in memory, and through NCCL about what is on
    a GPU, where each has one of its own: all of them, or none can be heard.

    Raises:
        RankLost: another one died, or was not heard of for ten minutes.
    """
    backend = "gloo"
    if int(os.environ["LOCAL_WORLD_SIZE"]) <= torch.cuda.device_count():
        backend = "cpu:gloo,cuda:nccl"
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    with others_alive():
        dist.init_process_group(backend, timeout=_TIMEOUT)
        waiting = dist.new_group(backend="gloo", timeout=_PATIENCE)
        assert isinstance(waiting, dist.ProcessGroup)
        yield Ranks(
            rank=dist.get_rank(),
            size=dist.get_world_size(),
            here=int(os.environ["LOCAL_WORLD_SIZE"]),
            waiting=waiting,
        )
        dist.destroy_process_group()


@contextmanager
def others_alive() -> Iterator[None]:
    """Whatever torch says of a rank that is gone, in one line.

    Raises:
        RankLost: another rank is gone.
    """
    try:
        yield
    except RuntimeError as error:
        if not isinstance(error, dist.DistError) and "gloo" not in str(error):
            raise
        raise RankLost(
            "another rank of this training died or cannot be reached, so it stopped: "
            "the same command, `train` with --resume, goes on from what was saved last"
        ) from None
