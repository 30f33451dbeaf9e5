"""What an off-policy training cannot be told."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from data.errors import GaitprefError
from policy.engines.actors_cfg import ActorsCfg
from policy.engines.with_actors import require_for_actors
from policy.training.train_cfg import TrainCfg


def require_possible(
    cfg: TrainCfg,
    *,
    replay: Sequence[Path],
    offline: bool,
    actors: ActorsCfg | None,
) -> None:
    """Refuse what would have no effect.

    Raises:
        GaitprefError: there is such a setting.
    """
    ppo = cfg.ppo
    if ppo.bonus is not None or ppo.kl_penalty is not None:
        raise GaitprefError(
            "an exploration bonus and a KL penalty are PPO's: leave --exploration and "
            "--kl-penalty out, or --algorithm fastsac"
        )
    if cfg.sim is not None and cfg.sim.device != "cpu":
        raise GaitprefError(
            "off-policy learning is on the processor: leave --device out, or "
            "--algorithm fastsac"
        )
    if actors is not None:
        require_for_actors(cfg, actors)
        if actors.update == "gradients":
            raise GaitprefError(
                "--update gradients is A3C's; off-policy, actors send steps: give "
                "--update sync, or leave it out"
            )
        if offline:
            raise GaitprefError(
                "--offline takes no new step, so there is nothing for --actors to do: "
                "leave one of the two out"
            )
    if offline and not replay:
        raise GaitprefError(
            "--offline takes no new step, so it needs what to learn from: give "
            "--replay DATASET too"
        )
