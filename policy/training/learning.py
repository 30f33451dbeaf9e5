"""What `train` asks of who collects and learns: PPO here or with actors, or another."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol

from torch import Tensor

from policy.parallel.ranks import Ranks

from .ppo import IterationStats, PpoCfg
from .reward_ppo import ScoreFn


class Algorithm(Protocol):
    """What is learned, and what for."""

    reward_fn: ScoreFn | None
    """None is the environment's own."""
    OF_RANK: ClassVar[Any]
    """What `save` gives that each rank has for itself."""

    def save(self) -> dict[str, Any]:
        """All it goes on from."""
        ...

    def load(self, loaded_dict: dict[str, Any], load_cfg: None, strict: bool) -> Any:
        """Go on from what `save` gave, among other things."""
        ...


class Learning(Protocol):
    """One training in progress, whose files `train` keeps."""

    ranks: Ranks
    device: str
    current_learning_iteration: int
    """Iterations done."""

    @property
    def alg(self) -> Algorithm:
        """What is learned."""
        ...

    @property
    def ppo(self) -> PpoCfg:
        """How the policy file says it was trained, its network among it."""
        ...

    @property
    def told(self) -> dict[str, Any]:
        """What beside its settings makes a training what it is."""
        ...

    @property
    def std(self) -> Tensor | None:
        """Exploration noise that a plan may set; None where the learner finds it."""
        ...

    def networks(self) -> Mapping[str, Mapping[str, Any]]:
        """Weights that must stay finite, by the name of their network."""
        ...

    def policy_states(self) -> dict[str, Any]:
        """State dictionaries of a policy file."""
        ...

    def start_from(self, init: Path, payload: dict[str, Any]) -> None:
        """Take over the networks of the policy file `init`, which holds `payload`."""
        ...

    def begin(self) -> None:
        """Prepare the first iteration of a training."""
        ...

    def learn(
        self,
        num_learning_iterations: int,
        on_iteration: Callable[[IterationStats], bool],
    ) -> None:
        """Run iterations until so many are done since the beginning, or the callback
        says no."""
        ...

    def snapshot(self) -> dict[str, Any]:
        """What beside `alg` and iterations a training goes on from."""
        ...

    def restore(self, snapshot: dict[str, Any], /) -> None:
        """Go on from what `snapshot` gave, among other things."""
        ...
