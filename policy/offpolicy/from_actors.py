"""Steps for the memory from actors on Ray; with priorities, Ape-X (Horgan et al. 2018,
arXiv 1803.00933).

Memory is the learner's, and so are priorities. Steps are never too old for it: nothing
is dropped and nothing corrected.

Shapes: K columns of the memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from torch import Tensor

from policy.engines.actor import weights_of
from policy.engines.actor_pool import ActorPool, Counts, seed_of_actor
from policy.engines.actors_cfg import ActorsCfg
from policy.engines.ray_cluster import ray_for
from policy.engines.trajectory import Origin
from policy.robots.robot import Robot
from policy.training.train_cfg import TrainCfg

from .collecting import Log, Tell
from .explorer import ExplorerPlan, SentSteps
from .ring import Chunk, Ring
from .sac import Sac

_NEVER_TOO_OLD = 2**31


class FromActors:
    """Steps of environments in other processes, each of which fills columns of its own.

    Every actor sends once an iteration, so that who is faster makes no difference; only
    where one dies, or after a resume, another training comes of it.
    """

    def __init__(
        self,
        robot: Robot,
        cfg: TrainCfg,
        actors: ActorsCfg,
        learner: Sac,
        ring: Ring,
        *,
        seed: int,
        tell: Tell,
    ) -> None:
        """Take steps with the weights that `learner` has by then, for `ring`.

        Raises:
            ActorsError: environments cannot be shared evenly.
        """
        self._robot, self._cfg, self._actors = robot, cfg, actors
        self._envs = actors.share_of(cfg.ppo.num_envs)
        self._learner, self._ring = learner, ring
        self._seed, self._tell = seed, tell
        self._sequences: dict[int, int] = {}
        self._counts = Counts()
        self._last: dict[int, Origin] = {}
        """What came last into the columns of each seat, since this process began."""
        self._pool: ActorPool | None = None

    def begin(self) -> None:
        """Actors begin by themselves."""

    def snapshot(self) -> dict[str, Any]:
        """How far each actor has come, and what became of what it sent.

        Their environments are theirs: a training that goes on begins new episodes.
        """
        return {
            "sequences": dict(self._sequences),
            "counts": self._counts.snapshot(),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from what `snapshot` gave, among other things."""
        self._sequences = dict(snapshot["sequences"])
        self._counts = Counts.restored(snapshot.get("counts", {}))

    @contextmanager
    def running(self) -> Iterator[None]:
        """Actors on a Ray, which end with it.

        Raises:
            ActorsError: it has fewer cores than there are actors.
            RayError: nothing answers at its address, or its versions differ.
        """
        self._last = {}
        with ray_for(self._actors) as ray:
            numbers = range(self._actors.actors)
            self._pool = ActorPool(
                ray,
                self._plan,
                [self._sequences.get(actor, 0) for actor in numbers],
                method="steps",
                most_lag=_NEVER_TOO_OLD,
                counts=self._counts,
                tell=self._tell,
            )
            try:
                yield
            finally:
                self._pool = None

    def collect(self) -> tuple[Chunk, Log]:
        """The next steps of every actor, or of those that are left."""
        pool = self._pool
        assert pool is not None
        count = self._actors.actors
        pool.counts.lags.clear()
        pool.hand_out(weights_of({"actor": self._learner.actor}), pool.version + 1)
        sent: list[SentSteps] = []
        while len(sent) < count:
            found = pool.next(count - len(sent))
            assert isinstance(found, SentSteps)
            sent.append(found)
        if self._actors.update != "sync":
            # They go on while this process learns.
            pool.ask(count)
        self._sequences |= pool.sequences
        names = sent[0].log
        log = {n: float(np.mean([each.log[n] for each in sent])) for n in names}
        return self.joined(sent), log | pool.figures

    def joined(self, sent: Sequence[SentSteps]) -> Chunk:
        """`sent` side by side, parted from what is in memory where it does not follow
        that."""
        seated = _in_seats(sent)
        chunk = _side_by_side(seated)
        new = self._new_in(seated)
        self._ring.part(new)
        # A reward that looks back must not see what others did before.
        chunk.starts[0, new] = True
        return chunk

    def _new_in(self, seated: Sequence[SentSteps]) -> Tensor:
        """[K] columns whose steps do not follow what came before in them: after an
        actor was replaced, or where another fills in for it."""
        columns: list[int] = []
        for seat, sent in enumerate(seated):
            origin, last = sent.origin, self._last.get(seat)
            self._last[seat] = origin
            follows = last is not None and (origin.actor, origin.sequence) == (
                last.actor,
                last.sequence + 1,
            )
            if not follows:
                begin = seat * self._envs
                columns.extend(range(begin, begin + self._envs))
        return torch.tensor(columns, dtype=torch.long)

    def _plan(self, actor: int, sequence: int) -> ExplorerPlan:
        return ExplorerPlan(
            actor=actor,
            robot_name=self._robot.name,
            robot_mjcf=self._robot.mjcf,
            env=self._cfg.env,
            num_envs=self._envs,
            seed=seed_of_actor(self._seed, actor, sequence),
            sac=self._learner.cfg,
            sizes=self._cfg.ppo.hidden_sizes,
            steps=self._cfg.ppo.steps_per_env,
        )


def _in_seats(sent: Sequence[SentSteps]) -> list[SentSteps]:
    """`sent` by seat, each actor's first in its own; others fill what is left."""
    ordered = sorted(sent, key=lambda each: (each.origin.actor, each.origin.sequence))
    seats: dict[int, SentSteps] = {}
    others: list[SentSteps] = []
    for each in ordered:
        if each.origin.actor in seats:
            others.append(each)
        else:
            seats[each.origin.actor] = each
    return [seats.get(seat) or others.pop(0) for seat in range(len(sent))]


def _side_by_side(seated: Sequence[SentSteps]) -> Chunk:
    return Chunk(
        **{
            name: torch.from_numpy(
                np.concatenate([each.chunk[name] for each in seated], axis=1)
            )
            for name in seated[0].chunk
        }
    )
