"""rl_games and Tianshou step the batch of robots, where they are installed.

Their pins of psutil and pandas do not go with this project's, so that they are in no
extra: without them, the test is of their documented interfaces.
"""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from data.errors import GaitprefError
from gaitpref.adapters.gym_registration import ENV_ID
from gaitpref.adapters.other_vecenvs import RlGamesVecEnv, TianshouVecEnv
from policy.env.env_cfg import EnvCfg


def envs(count: int = 3, episode_s: float = 0.06) -> gymnasium.vector.VectorEnv:
    return gymnasium.make_vec(ENV_ID, num_envs=count, cfg=EnvCfg(episode_s=episode_s))


def test_the_interface_of_rl_games() -> None:
    """`IVecEnv`: arrays of one type, time-outs told, episodes begun anew."""
    env = RlGamesVecEnv(envs(), seed=4)
    first = env.reset()
    assert (first.shape, first.dtype) == ((3, 48), np.float32)
    for step in range(3):
        obs, rewards, dones, infos = env.step(np.zeros((3, 12), np.float32))
        assert rewards.dtype == np.float32
        assert dones.all() == (step == 2)
        assert infos["time_outs"].tolist() == [float(step == 2)] * 3
        assert obs.shape == (3, 48)
    told = env.get_env_info()
    assert told["action_space"].shape == (12,)
    assert np.array_equal(env.reset(), first)


def test_the_interface_of_tianshou() -> None:
    """`BaseVectorEnv`: an end shows its own observation, the reset the next one's."""
    env = TianshouVecEnv(envs(), seed=4)
    first, facts = env.reset()
    assert (len(env), first.shape, facts.tolist()) == (3, (3, 48), [{}, {}, {}])
    seen = first
    for step in range(3):
        seen, rewards, terminated, truncated, facts = env.step(
            np.zeros((3, 12), np.float32), np.arange(3)
        )
        assert rewards.shape == (3,)
        assert not terminated.any()
        assert truncated.all() == (step == 2)
    begun, _ = env.reset(np.array([0, 2]))
    assert begun.shape == (2, 48)
    assert not np.allclose(begun, seen[[0, 2]])
    with pytest.raises(GaitprefError, match="all 3 robots step at once"):
        env.step(np.zeros((2, 12), np.float32), np.array([0, 2]))


def test_tianshou_learns_from_it() -> None:
    """Its collector and one update of its PPO."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        why = "not in an extra: wants pandas below 3"
        algorithm = pytest.importorskip("tianshou.algorithm", reason=why)
        base = importlib.import_module("tianshou.algorithm.algorithm_base")
        reinforce = importlib.import_module("tianshou.algorithm.modelfree.reinforce")
        optim = importlib.import_module("tianshou.algorithm.optim")
        data = importlib.import_module("tianshou.data")
        common = importlib.import_module("tianshou.utils.net.common")
        continuous = importlib.import_module("tianshou.utils.net.continuous")
        env = TianshouVecEnv(envs(4, 0.4))
        nets = [common.Net(state_shape=(48,), hidden_sizes=[16]) for _ in range(2)]
        actor = continuous.ContinuousActorProbabilistic(
            preprocess_net=nets[0], action_shape=(12,), unbounded=True
        )
        critic = continuous.ContinuousCritic(preprocess_net=nets[1])
        policy = reinforce.ProbabilisticActorPolicy(
            actor=actor,
            dist_fn=lambda both: torch.distributions.Independent(
                torch.distributions.Normal(*both), 1
            ),
            action_space=env.action_space[0],
        )
        adam = optim.AdamOptimizerFactory(lr=1e-3)
        ppo = algorithm.PPO(policy=policy, critic=critic, optim=adam)
        buffer = data.VectorReplayBuffer(400, len(env))
        collector = data.Collector(ppo, env, buffer)
        collector.reset()
        found = collector.collect(n_step=200)
        with base.policy_within_training_step(policy):
            ppo.update(buffer, 50, 1)
    assert found.n_collected_steps == 200
    assert found.n_collected_episodes >= 8
    assert all(torch.isfinite(weight).all() for weight in policy.parameters())
    assert np.isfinite(collector.buffer.obs).all()


def test_rl_games_learns_from_it(tmp_path: Path) -> None:
    """Two updates of its PPO."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        why = "not in an extra: wants psutil below 6"
        vecenv = pytest.importorskip("rl_games.common.vecenv", reason=why)
        known = importlib.import_module("rl_games.common.env_configurations")
        torch_runner = importlib.import_module("rl_games.torch_runner")
        vecenv.register(
            "gaitpref", lambda name, count, **_: RlGamesVecEnv(envs(count, 0.4))
        )
        known.register(
            "quadruped", {"vecenv_type": "gaitpref", "env_creator": lambda **_: None}
        )
        runner = torch_runner.Runner()
        runner.load({"params": _params(tmp_path)})
        runner.run({"train": True})
    saved = list(tmp_path.rglob("*.pth"))
    assert saved
    weights = torch.load(saved[0], weights_only=False)["model"]
    assert all(torch.isfinite(value).all() for value in weights.values())


def _params(folder: Path) -> dict[str, Any]:
    """The smallest configuration that rl_games takes."""
    layer = {"name": "default"}
    flat = {"name": "const_initializer", "val": 0}
    space = {
        "mu_activation": "None",
        "sigma_activation": "None",
        "mu_init": layer,
        "sigma_init": flat,
        "fixed_sigma": True,
    }
    mlp = {"units": [16], "activation": "elu", "initializer": layer}
    network = {
        "name": "actor_critic",
        "separate": False,
        "space": {"continuous": space},
        "mlp": mlp,
    }
    config = {
        "name": "quadruped",
        "full_experiment_name": "run",
        "train_dir": str(folder),
        "env_name": "quadruped",
        "device": "cpu",
        "device_name": "cpu",
        "ppo": True,
        "mixed_precision": False,
        "normalize_input": True,
        "normalize_value": True,
        "normalize_advantage": True,
        "value_bootstrap": True,
        "num_actors": 4,
        "reward_shaper": {"scale_value": 1.0},
        "gamma": 0.99,
        "tau": 0.95,
        "e_clip": 0.2,
        "clip_value": True,
        "entropy_coef": 0.0,
        "learning_rate": 3e-4,
        "lr_schedule": "None",
        "truncate_grads": True,
        "grad_norm": 1.0,
        "horizon_length": 16,
        "minibatch_size": 32,
        "mini_epochs": 2,
        "critic_coef": 1.0,
        "bounds_loss_coef": 0.0,
        "max_epochs": 2,
        "save_frequency": 1,
        "save_best_after": 0,
    }
    return {
        "seed": 1,
        "algo": {"name": "a2c_continuous"},
        "model": {"name": "continuous_a2c_logstd"},
        "network": network,
        "config": config,
    }
