"""A pool of actors without a Ray: what it does of what Ray says became of them."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from policy.engines.actor import Weights
from policy.engines.actor_pool import ActorPool, Counts, RemoteActor
from policy.engines.actors_cfg import ActorsError
from policy.engines.ray_cluster import versions
from policy.engines.trajectory import Origin
from tests.helpers.required import needed

exceptions = needed("ray.exceptions", "RAY")


@dataclass
class RayHere:
    """What a pool asks of Ray, done at once in this process."""

    ends: list[Exception]
    """How actors end that are asked for a rollout; then they live on."""
    refuses: Exception | None = None
    """How actors end before they begin."""
    exceptions: Any = exceptions
    cloudpickle: Any = pickle

    def remote(self, **places: int) -> Callable[[type], Any]:
        """What makes actors of a class."""
        return lambda kind: SimpleNamespace(
            remote=lambda *told: Handle(kind(*told), self.ends, self.refuses)
        )

    def put(self, value: Any) -> Any:
        return value

    def wait(
        self, asked: list[Answer], num_returns: int, timeout: float
    ) -> tuple[list[Answer], list[Answer]]:
        return asked[:num_returns], asked[num_returns:]

    def get(self, answer: Answer) -> Any:
        if answer.error is not None:
            raise answer.error
        return answer.value


@dataclass(frozen=True)
class Handle:
    actor: Any
    ends: list[Exception]
    refuses: Exception | None

    @property
    def begin(self) -> SimpleNamespace:
        return SimpleNamespace(remote=lambda: Answer(error=self.refuses))

    @property
    def collect(self) -> SimpleNamespace:
        return SimpleNamespace(remote=self._collect)

    def _collect(self, *told: Any) -> Answer:
        if self.ends:
            return Answer(error=self.ends.pop(0))
        return Answer(self.actor.collect(*told))


@dataclass(frozen=True, eq=False)
class Answer:
    value: Any = None
    error: Exception | None = None


@dataclass(frozen=True)
class Plan:
    actor: int

    def begin(self) -> Plan:
        return self

    def steps(self, weights: Weights, version: int, sequence: int) -> Any:
        """A rollout of nothing."""
        origin = Origin(self.actor, sequence, version)
        return SimpleNamespace(origin=origin, bytes=8, collect_s=0.0)


def test_an_actor_that_is_killed_for_lack_of_memory_is_replaced() -> None:
    """It goes on with a number that the first one never used up, and both are told."""
    begun: list[tuple[int, int]] = []
    said: list[str] = []

    def plan(actor: int, sequence: int) -> Plan:
        begun.append((actor, sequence))
        return Plan(actor)

    ray = RayHere([exceptions.OutOfMemoryError("the node had 0.1 GB left")])
    pool = ActorPool(
        *(ray, plan, [3]),
        method="steps",
        most_lag=0,
        counts=Counts(),
        tell=said.append,
    )
    pool.hand_out({}, 1)
    sent = pool.next(most=1)
    assert sent.origin == Origin(0, 5, 1)
    assert begun == [(0, 3), (0, 4)]
    assert (pool.counts.replaced, pool.counts.used) == (1, 1)
    assert said == ["actor 0 died and is replaced (the node had 0.1 GB left)"]


def test_a_rollout_that_is_too_old_is_counted_and_dropped() -> None:
    """One as old as may be is used; the next comes of the newest weights, under a
    number of its own."""
    pool = ActorPool(
        *(RayHere([]), lambda actor, sequence: Plan(actor), [0]),
        method="steps",
        most_lag=1,
        counts=Counts(),
        tell=print,
    )
    pool.hand_out({}, 1)
    pool.ask(1)
    pool.hand_out({}, 2)
    assert pool.next(most=1).origin == Origin(0, 1, 1)
    assert (pool.counts.used, pool.counts.dropped, pool.counts.lags) == (1, 0, [1])
    pool.ask(1)
    pool.hand_out({}, 4)
    assert pool.next(most=1).origin == Origin(0, 3, 4)
    assert (pool.counts.used, pool.counts.dropped, pool.counts.lags) == (2, 1, [1, 0])
    assert pool.counts.snapshot() == {
        "used": 2,
        "dropped": 1,
        "replaced": 0,
        "bytes": 16,
    }


def test_versions_are_compared_before_the_plan_is_read() -> None:
    """A machine with other versions may not even be able to read it."""
    actor = RemoteActor(b"no pickle of ours", versions() | {"mujoco": "3.1"})
    with pytest.raises(ActorsError, match=r"has mujoco .*, the learner's machine 3\.1"):
        actor.begin()
    with pytest.raises(ActorsError, match="install the same on both"):
        actor.collect("steps", {}, 1, 1)


def test_a_machine_without_gaitpref_is_told_to_install_it() -> None:
    """As Ray tells of a class whose module is not there."""
    told = "The actor failed to import on the worker: No module named 'policy'"
    begun = exceptions.RayTaskError("RemoteActor.__init__", told, RuntimeError(told))
    ray = RayHere([], refuses=exceptions.ActorDiedError(begun))
    with pytest.raises(ActorsError, match="install gaitpref on every machine of that"):
        ActorPool(
            *(ray, lambda actor, sequence: Plan(actor), [0]),
            method="steps",
            most_lag=1,
            counts=Counts(),
            tell=print,
        )
