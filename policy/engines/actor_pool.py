"""Actors on Ray: each has one call running, and one that dies is replaced.

Nothing queues up. An actor is asked for its next rollout when its last one has been
taken, so that there are never more rollouts than actors.
"""

from __future__ import annotations

import pickle
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from .actor import Weights
from .actors_cfg import ActorsError
from .ray_cluster import require_same_versions, versions
from .trajectory import Sent

_MOST_DEATHS = 5
"""Of an actor without a rollout in between: it will not do better."""
_TOTALS = ("used", "dropped", "replaced", "bytes")
_LOOK_S = 1.0
_SILENCE_S = 60.0


class Plan(Protocol):
    """All an actor has to know before it begins."""

    def begin(self) -> Any:
        """The actor."""
        ...


MakePlan = Callable[[int, int], Plan]
"""The plan of an actor that goes on with a sequence number: both decide its seed, or an
actor that was replaced would see its first rollouts again."""


def seed_of_actor(seed: int, actor: int, sequence: int) -> int:
    """That of an actor which goes on with `sequence`, in a training of `seed`."""
    entropy = np.random.SeedSequence([seed, actor, sequence])
    return int(entropy.generate_state(1)[0])


class RemoteActor:
    """An actor in a process of its own, on a machine with the learner's versions."""

    def __init__(self, plan: bytes, wanted: dict[str, str]) -> None:
        self._plan, self._wanted = plan, wanted
        self._actor: Any = None

    def begin(self) -> None:
        """Begin, if it has not.

        Raises:
            ActorsError: its machine has other versions than the learner's.
        """
        if self._actor is None:
            require_same_versions(self._wanted, versions(), socket.gethostname())
            # Only now: other versions may not even read it.
            self._actor = pickle.loads(self._plan).begin()

    def collect(
        self, method: str, weights: Weights, version: int, sequence: int
    ) -> Sent:
        """What the method of that name collects with `weights`."""
        # Nobody has waited for one that replaces another.
        self.begin()
        return getattr(self._actor, method)(weights, version, sequence)


@dataclass
class _Seat:
    """One actor, whatever process it is now."""

    handle: Any
    deaths: int = 0
    not_before_s: float = 0.0


@dataclass
class Counts:
    """What became of rollouts since a training began."""

    used: int = 0
    dropped: int = 0
    """Too old."""
    replaced: int = 0
    """Actors that died."""
    bytes: int = 0
    """Received."""
    lags: list[int] = field(default_factory=list)
    """Of the rollouts used last, in versions."""
    collect_s: float = 0.0
    """Of the rollout used last."""

    def snapshot(self) -> dict[str, int]:
        """What a training that goes on must know."""
        return {name: getattr(self, name) for name in _TOTALS}

    @classmethod
    def restored(cls, snapshot: Mapping[str, int]) -> Counts:
        """Those of a snapshot; none where an older version kept none."""
        found = cls()
        for name in _TOTALS:
            setattr(found, name, snapshot.get(name, 0))
        return found


class ActorPool:
    """Actors that are given weights, and rollouts to collect, by number."""

    def __init__(
        self,
        ray: Any,
        plan: MakePlan,
        sequences: list[int],
        *,
        method: str,
        most_lag: int,
        counts: Counts,
        tell: Callable[[str], None],
    ) -> None:
        """Start an actor for each of `sequences`, the numbers of their last rollouts.

        Args:
            ray: The connected module.
            plan: Makes what an actor has to know.
            method: Of the actor, which collects.
            most_lag: Versions between the newest weights and those of a rollout.
            counts: Of the training so far; they go on.
            tell: Gets a line about who died.

        Raises:
            ActorsError: one cannot begin, or its machine has other versions.
        """
        self._ray, self._plan, self._tell = ray, plan, tell
        self._method, self._most_lag = method, most_lag
        self._sequences = list(sequences)
        self._kind = ray.remote(num_cpus=1, max_restarts=0)(RemoteActor)
        self.counts, self._versions = counts, versions()
        self._weights, self.version = None, 0
        self._asked: dict[Any, tuple[int, int]] = {}
        self._seats = [_Seat(self._started(each)) for each in range(len(sequences))]
        self._used = list(sequences)
        self._wait_for_all()

    @property
    def sequences(self) -> dict[int, int]:
        """Number of the last rollout each actor was asked for."""
        return dict(enumerate(self._sequences))

    @property
    def figures(self) -> dict[str, float]:
        """What became of rollouts so far, by TensorBoard tag."""
        counts = self.counts
        return {
            "actors/lag_mean": float(np.mean(counts.lags)),
            "actors/lag_most": float(max(counts.lags)),
            "actors/used": float(counts.used),
            "actors/dropped": float(counts.dropped),
            "actors/replaced": float(counts.replaced),
            "actors/megabytes": counts.bytes / 1e6,
            "actors/collect_s": counts.collect_s,
        }

    def hand_out(self, weights: Weights, version: int) -> None:
        """Let rollouts that are asked for from now on be of `weights`."""
        self._weights, self.version = self._ray.put(weights), version

    def ask(self, most: int) -> None:
        """Ask idle actors for a rollout each, of which `most` may be under way."""
        busy = {actor for actor, _ in self._asked.values()}
        now_s = time.monotonic()
        for actor, seat in enumerate(self._seats):
            if len(self._asked) >= most:
                return
            if actor in busy or now_s < seat.not_before_s:
                continue
            self._sequences[actor] += 1
            sequence = self._sequences[actor]
            answer = seat.handle.collect.remote(
                self._method, self._weights, self.version, sequence
            )
            self._asked[answer] = actor, sequence

    def next(self, most: int) -> Sent:
        """The next rollout that can be used, with at most `most` under way.

        Raises:
            ActorsError: an actor dies again and again.
        """
        silent_since_s = time.monotonic()
        while True:
            self.ask(most)
            if not self._asked:
                # Of nothing to wait for, Ray answers at once.
                time.sleep(_LOOK_S)
            ready, _ = self._ray.wait(list(self._asked), num_returns=1, timeout=_LOOK_S)
            for answer in ready:
                sent = self._taken(answer)
                if sent is not None:
                    return sent
            if time.monotonic() - silent_since_s > _SILENCE_S:
                silent_since_s = time.monotonic()
                self._tell(
                    f"no actor has sent anything for {_SILENCE_S:.0f} s: waiting for "
                    "cores of the Ray they run on"
                )

    def _taken(self, answer: Any) -> Sent | None:
        """What an actor sent; None where it died, or where that is too old."""
        actor, sequence = self._asked.pop(answer)
        seat = self._seats[actor]
        errors = self._ray.exceptions
        try:
            sent: Sent = self._ray.get(answer)
        except errors.RayTaskError as error:
            # What the actor itself raised is told as if it had been raised here.
            raise error.cause from None
        except (
            errors.RayActorError,
            errors.ObjectLostError,
            errors.OutOfMemoryError,
        ) as error:
            self._replace(actor, error)
            return None
        if sent.origin.sequence != sequence or sequence <= self._used[actor]:
            raise RuntimeError(
                f"actor {actor} sent rollout {sent.origin.sequence} where {sequence} "
                f"was asked for, after {self._used[actor]}"
            )
        self._used[actor], seat.deaths = sequence, 0
        lag = self.version - sent.origin.version
        if lag > self._most_lag:
            self.counts.dropped += 1
            return None
        self.counts.used += 1
        self.counts.bytes += sent.bytes
        self.counts.collect_s = sent.collect_s
        self.counts.lags.append(lag)
        return sent

    def _replace(self, actor: int, error: Exception) -> None:
        seat = self._seats[actor]
        seat.deaths += 1
        reason = " ".join(str(error).split())[:160]
        if seat.deaths > _MOST_DEATHS:
            raise ActorsError(
                f"actor {actor} died {seat.deaths} times without a rollout in between "
                f"({reason}): is there memory left where it runs? The same command "
                "with --resume goes on"
            ) from None
        self.counts.replaced += 1
        self._tell(f"actor {actor} died and is replaced ({reason})")
        # The first time soon; a machine in trouble is given time.
        seat.not_before_s = time.monotonic() + min(2.0 ** (seat.deaths - 2), 30.0)
        seat.handle = self._started(actor)

    def _started(self, actor: int) -> Any:
        plan = self._plan(actor, self._sequences[actor])
        return self._kind.remote(self._ray.cloudpickle.dumps(plan), self._versions)

    def _wait_for_all(self) -> None:
        errors = self._ray.exceptions
        asked = [seat.handle.begin.remote() for seat in self._seats]
        while True:
            placed, waiting = self._ray.wait(
                asked, num_returns=len(asked), timeout=_SILENCE_S
            )
            if not waiting:
                break
            self._tell(f"{len(waiting)} actors wait for cores of the Ray they run on")
        for answer in placed:
            try:
                self._ray.get(answer)
            except errors.RayTaskError as error:
                raise error.cause from None
            except errors.RayActorError as error:
                raise _cannot_begin(error) from None


def _cannot_begin(error: Exception) -> ActorsError:
    reason = " ".join(str(error).split())
    told = f"an actor cannot begin ({reason[-200:]})"
    if "No module named" in reason:
        return ActorsError(
            f"{told}: install gaitpref on every machine of that Ray, as here, by "
            "`pip install -e '.[scale]' -c constraints.txt`"
        )
    return ActorsError(
        f"{told}: `ray status` tells whether that Ray still runs, and what it has left"
    )
