"""How much of the base's motion a policy visits without any reward but a bonus.

    python -m benchmarks.exploration [--quick] [--json FILE]

Bins of (forward, left, yaw rate, height, roll, pitch), as wide as `MOTION_SCALE`, that
more than one step of the last quarter of training fell into, over three seeds; and
where the KL of an update settles when its penalty is adapted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Annotated

import torch
import tyro
from torch import Tensor

from policy.env.env_cfg import EnvCfg
from policy.env.known_terms import KnownTermsCfg, known_terms
from policy.extensions.bonus import ExplorationBonusCfg, base_motion
from policy.extensions.kl_penalty import KlPenaltyCfg
from policy.robots.robot import load_robot
from policy.training.ppo import IterationStats, PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

from .harness import Figure, publish

GOALS = {
    "bins_rnd_over_none": ">= 1.5",
    "bins_entropy_over_none": ">= 1.5",
    "kl_adaptive": "0.0067 to 0.015",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure exploration bonuses and the KL penalty."""

    quick: bool = False
    """One seed and few iterations."""
    json: Path | None = None
    """Write the figures here."""


def coverage(
    bonus: ExplorationBonusCfg | None,
    *,
    seed: int,
    iterations: int,
    num_envs: int,
) -> int:
    """Bins that the last quarter of a training against the known terms visited."""
    env = EnvCfg()
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    seen: list[Tensor] = []

    def nothing_but_safety(features: Tensor, starts: Tensor) -> Tensor:
        seen.append(base_motion(features).flatten(0, 1))
        home = torch.tensor(robot.joint_range - robot.home_joint_pos[:, None])
        terms = known_terms(
            features,
            KnownTermsCfg(),
            joint_offset_range=home.float(),
            control_dt_s=env.control_dt_s,
        )
        return torch.stack(tuple(terms.values())).sum(dim=0)

    ppo = PpoCfg(num_envs=num_envs, bonus=bonus)
    cfg = TrainCfg(
        steps=iterations * ppo.steps_per_iteration, env=env, ppo=ppo, seed=seed
    )
    with TemporaryDirectory() as out:
        train(Path(out), robot, cfg, reward_fn=nothing_but_safety)
    states = torch.cat(seen[-max(1, iterations // 4) :])
    _, counts = states.round().unique(dim=0, return_counts=True)
    return int((counts > 1).sum())


def settled_kl(cfg: KlPenaltyCfg, *, iterations: int, num_envs: int) -> float:
    """Median KL of the last half of the updates of a training on the task."""
    env = EnvCfg()
    kls: list[float] = []

    def note(stats: IterationStats) -> None:
        kls.append(stats.scalars["loss/kl"])

    ppo = replace(PpoCfg(num_envs=num_envs), kl_penalty=cfg)
    with TemporaryDirectory() as out:
        train(
            Path(out),
            load_robot(physics_dt_s=env.physics_dt_s),
            TrainCfg(steps=iterations * ppo.steps_per_iteration, env=env, ppo=ppo),
            on_iteration=note,
        )
    return median(kls[len(kls) // 2 :])


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure everything and publish it."""
    torch.set_num_threads(1)
    seeds = range(1 if options.quick else 3)
    size = {"iterations": 16, "num_envs": 32}
    if not options.quick:
        size = {"iterations": 60, "num_envs": 128}
    figures: dict[str, Figure] = {}
    none = [coverage(None, seed=seed, **size) for seed in seeds]
    for bonus in (ExplorationBonusCfg(kind="rnd"), ExplorationBonusCfg(kind="entropy")):
        bins = [coverage(bonus, seed=seed, **size) for seed in seeds]
        figures[f"bins_{bonus.kind}_over_none"] = sum(bins) / sum(none)
    for penalty in (KlPenaltyCfg(kind="fixed"), KlPenaltyCfg(kind="adaptive")):
        figures[f"kl_{penalty.kind}"] = settled_kl(penalty, **size)
    publish("exploration", figures, GOALS, options.json)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
