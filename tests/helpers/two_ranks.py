"""What two ranks do in tests/policy/test_ranks.py: `torchrun -m tests.helpers.two_ranks
OUT` leaves it in OUT."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from data.errors import GaitprefError
from policy.env.curriculum import CurriculumCfg
from policy.env.env_cfg import RANDOMISE, EnvCfg
from policy.env.randomise import make_env
from policy.extensions.bonus import ExplorationBonusCfg
from policy.parallel.ranks import Ranks, joined
from policy.robots.robot import load_robot
from policy.training.ppo import PpoCfg, Runner
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

ENV = EnvCfg(episode_s=0.4)
ONE_BATCH = PpoCfg(
    num_envs=8, hidden_sizes=(8,), minibatches=1, epochs=2, desired_kl=0.5
)
TRAINED = TrainCfg(
    steps=8 * 24 * 4,
    env=replace(
        ENV, randomise=RANDOMISE["light"], curriculum=CurriculumCfg(window_s=0.5)
    ),
    ppo=replace(
        ONE_BATCH,
        minibatches=2,
        privileged_critic=True,
        bonus=ExplorationBonusCfg(kind="rnd"),
    ),
)


class Steady:
    """A reward that looks back: the more, the longer the robot keeps its height."""

    history_steps = 3

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        height = features[..., 9]
        change = (height - height.roll(3, dims=0)).abs()
        # Neither across a start nor, at the first one, around the end.
        begun = starts | starts.roll(1, dims=0) | starts.roll(2, dims=0)
        return 1.0 - 10.0 * change.where(~begun, torch.zeros(()))


def one_update(out: Path, ranks: Ranks) -> None:
    """Collect a rollout, learn from it, and leave both in OUT/update_RANK.pt."""
    torch.manual_seed(0)
    robot = load_robot(physics_dt_s=ENV.physics_dt_s)
    share = ranks.share_of(ONE_BATCH.num_envs)
    env = make_env(robot, ENV, share, seed=ranks.rank, ranks=ranks)
    runner = Runner(env, ONE_BATCH, ranks)
    torch.manual_seed(ranks.rank)
    runner.learn(1, lambda stats: False)
    alg, storage = runner.alg, runner.alg.storage
    names = ("actions", "values", "returns", "advantages", "actions_log_prob")
    networks = {"actor": alg.actor, "critic": alg.critic}
    assert storage.distribution_params is not None
    left = {
        "observations": storage.observations["policy"],
        "distribution": list(storage.distribution_params),
        **{name: getattr(storage, name) for name in names},
        "gradients": [p.grad for n in networks.values() for p in n.parameters()],
        "weights": {key: network.state_dict() for key, network in networks.items()},
        "learning_rate": alg.learning_rate,
    }
    torch.save(left, out / f"update_{ranks.rank}.pt")


def four_iterations(out: Path, ranks: Ranks) -> None:
    """Train OUT/whole at once, and OUT/parts with a stop in the middle."""
    robot = load_robot(physics_dt_s=ENV.physics_dt_s)
    half = replace(TRAINED, steps=TRAINED.steps // 2)
    train(out / "whole", robot, TRAINED, reward_fn=Steady(), ranks=ranks)
    train(out / "parts", robot, half, reward_fn=Steady(), ranks=ranks)
    train(out / "parts", robot, TRAINED, reward_fn=Steady(), resume=True, ranks=ranks)
    other = replace(half, seed=ranks.rank)
    try:
        train(out / f"other_{ranks.rank}", robot, other, ranks=ranks)
    except GaitprefError as error:
        (out / f"refused_{ranks.rank}").write_text(str(error))


if __name__ == "__main__":
    torch.set_num_threads(1)
    with joined() as all_of_them:
        place = Path(sys.argv[1])
        one_update(place, all_of_them)
        four_iterations(place, all_of_them)
