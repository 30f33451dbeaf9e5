"""Steps for the memory, taken in this process.

Shapes: S control steps, N environments, D numbers of an observation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol

import torch
from torch import Tensor

from policy.env.env import QuadrupedEnv

from .ring import Chunk
from .tanh_actor import TanhActor

Tell = Callable[[str], None]
"""Gets a line for people."""
Log = dict[str, float]
"""What environments tell of themselves, by TensorBoard tag."""


class Source(Protocol):
    """Where new steps come from."""

    def begin(self) -> None:
        """Prepare the first iteration of a training."""
        ...

    def running(self) -> Any:
        """Context in which `collect` may be called."""
        ...

    def collect(self) -> tuple[Chunk, Log]:
        """The next steps of all environments."""
        ...

    def snapshot(self) -> dict[str, Any]:
        """What it goes on from."""
        ...

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from what `snapshot` gave, among other things."""
        ...


class Here:
    """Steps of environments in this process."""

    def __init__(self, env: QuadrupedEnv, actor: TanhActor, steps: int) -> None:
        """Take `steps` a time in `env`, as `actor` is by then."""
        self._env, self._actor, self._steps = env, actor, steps

    def begin(self) -> None:
        """Spread the time-outs."""
        spread_time_outs(self._env)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Nothing has to be started."""
        yield

    def collect(self) -> tuple[Chunk, Log]:
        """The next steps of all environments."""
        return collected(self._env, self._actor, self._steps)

    def snapshot(self) -> dict[str, Any]:
        """The environments."""
        return {"env": self._env.snapshot()}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from what `snapshot` gave, among other things."""
        self._env.restore(snapshot["env"])


def spread_time_outs(env: QuadrupedEnv) -> None:
    """Let environments not be up all at once, from PyTorch's chance."""
    env.episode_length_buf = torch.randint_like(
        env.episode_length_buf, high=env.max_episode_length
    )


@torch.no_grad()
def collected(env: QuadrupedEnv, actor: TanhActor, steps: int) -> tuple[Chunk, Log]:
    """The next `steps` of `env` under `actor`, from PyTorch's chance."""
    obs = env.get_observations()["policy"]
    kept: dict[str, list[Tensor]] = {
        name: [] for name in ("obs", "features", "starts", "fallen", "cut")
    }
    extras: dict[str, Any] = {"log": {}}
    for _ in range(steps):
        actions, _ = actor.sample(obs)
        kept["obs"].append(obs.clone())
        after, _, _, extras = env.step(actions, score=False)
        obs = after["policy"]
        # A diverged simulation tells nothing of what its action led to.
        kept["cut"].append(extras["time_outs"])
        for name in ("features", "starts", "fallen"):
            kept[name].append(extras[name])
    chunk = Chunk(**{name: torch.stack(each) for name, each in kept.items()})
    return chunk, {name: float(value) for name, value in extras["log"].items()}
