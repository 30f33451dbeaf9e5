"""What an answer is worth about which gait runs when, and about how joints move.

A simulated rater with one wish judges clips of gaits that change at random on a course.
The same answers are fitted twice: as a reward of choices, which a chooser among frozen
gaits learns on, and as the usual reward of feature rows, on which PPO trains the best
single gait further, on the same course. That gait sees what is ahead too. Both are
measured by the wish itself, on the same starts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from rsl_rl.modules import MLP, EmpiricalNormalization
from tensordict import TensorDict
from torch import Tensor, nn

from data.datasets.dataset import Dataset
from data.files.files import write_atomically
from gaitpref.options.choice_fit import fit_choices
from gaitpref.options.choice_rater import answer_choices
from gaitpref.options.choice_storage import load_choices, save_choices
from gaitpref.options.gait_files import Gaits, course_env
from gaitpref.options.measure import Chosen, chosen_by
from gaitpref.options.train_options import OptionsCfg, OptionsTraining, train_options
from gaitpref.training.total_reward import total_reward
from policy.env.course import AHEAD_DIM
from policy.env.env import QuadrupedEnv
from policy.env.feature_row import OBS_DIM
from policy.env.known_terms import KnownTermsCfg
from policy.networks.widened import widened
from policy.options.choice_row import CHANGES, POWER, PROGRESS, TASK, written_reward
from policy.robots.robot import Robot
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import (
    payload_bytes,
    policy_info,
    read_plain,
)
from policy.training.ppo import PpoCfg, Runner
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from policy.training.training_dir import POLICY_NAME
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.cfg import FitCfg
from rewardmodel.fitting.fit_reward import fit_reward
from rewardmodel.models.storage import load_reward, save_reward

WISH = {PROGRESS: 1.0, POWER: -0.002, CHANGES: -0.1}
"""Metres, less two millimetres for a joule and ten centimetres for a change."""
LEVELS = ("choices", "joints")
_SEEN_DIM = OBS_DIM + AHEAD_DIM - 1
"""Of a gait that sees what is ahead, as a chooser does: all but the time."""
_WEIGHT = 3.0
"""Of the learned reward beside walking and safety, where joints are trained."""
_START_STD, _END_STD = 0.3, 0.15


@dataclass(frozen=True, kw_only=True)
class Asked:
    """One rater and what is trained on its answers."""

    work: Path
    gaits: Gaits
    files: tuple[Path, ...]
    """Of the gaits."""
    cfg: OptionsCfg
    """The course, how choices are learned, and the seed."""
    clips: RecordCfg
    """What is judged."""
    joint_steps: int
    """Environment steps of a training at the level of joints."""


def answer_and_fit(asked: Asked, count: int) -> None:
    """Have `count` pairs answered in all, and fit both rewards; counts must rise."""
    work, seed = asked.work, asked.cfg.seed
    if _reward_of(asked, "joints", count).is_dir():
        return
    dataset = Dataset.create(work / "set")
    if not dataset.entries():
        task = written_reward(TASK, asked.gaits.names, "nothing")
        untaught = work / "untaught.pt"
        training = OptionsTraining(asked.gaits, asked.cfg, task)
        write_atomically(untaught, training.policy())
        dataset.add_episodes(record(untaught, asked.clips, seed=seed))
    answer_choices(dataset, asked.gaits.names, WISH, count=count, seed=seed)
    choices, _ = fit_choices(dataset, asked.gaits.names, seed=seed)
    save_choices(choices, _reward_of(asked, "choices", count))
    model, _ = fit_reward(load_pairs([dataset]), FitCfg(), seed=seed)
    save_reward(model, _reward_of(asked, "joints", count))


def _reward_of(asked: Asked, level: str, count: int) -> Path:
    return asked.work / f"{level}-{count}-reward"


def trained_on_choices(asked: Asked, count: int) -> Chosen:
    """A chooser that learned on the reward of choices."""
    out = asked.work / f"choices-{count}"
    reward = load_choices(_reward_of(asked, "choices", count))
    if not train_options(out, asked.gaits, asked.cfg, reward):
        raise KeyboardInterrupt
    return chosen_by(out / POLICY_NAME)


def trained_at_joints(asked: Asked, count: int, best: int) -> Chosen:
    """Gait `best`, trained further by PPO on the reward of feature rows."""
    out, cfg, gaits = asked.work / f"joints-{count}", asked.cfg, asked.gaits
    start = out / "start.pt"
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(start, seeing_ahead(asked.files[best]))
    course = replace(cfg.course, anywhere=True)
    env = course_env(gaits, course, speed_m_s=cfg.speed_m_s, episode_s=cfg.episode_s)
    sizes = gaits.policies[best].info.ppo.hidden_sizes
    reward = total_reward(
        load_reward(_reward_of(asked, "joints", count)),
        gaits.robot,
        env,
        known=KnownTermsCfg(),
        weight=_WEIGHT,
        keep_task=True,
    )
    settings = TrainCfg(
        steps=asked.joint_steps,
        env=env,
        ppo=PpoCfg(num_envs=cfg.envs, hidden_sizes=sizes),
        seed=cfg.seed,
        checkpoints=0,
        exploration_std=_START_STD,
        final_std=_END_STD,
    )
    found = train(
        out,
        gaits.robot,
        settings,
        reward_fn=reward,
        init=start,
        resume=True,
        engine=joint_runner,
    )
    if not found.finished:
        raise KeyboardInterrupt
    network = Seeing(sizes)
    actor = read_plain(found.policy)["actor_state_dict"]
    network.load_state_dict(
        {k: v for k, v in actor.items() if k[:4] in ("mlp.", "obs_")}
    )
    network.eval()

    def act(obs: Tensor) -> tuple[Tensor, Tensor]:
        return network(obs[:, :_SEEN_DIM]), torch.full((len(obs),), best)

    return act


def seeing_ahead(file: Path) -> bytes:
    """The policy of `file` with inputs for what is ahead, which it does not look at
    yet; its critic, which knew another reward, is left out."""
    payload = read_plain(file)
    actor = widened(payload["actor_state_dict"], OBS_DIM, _SEEN_DIM - OBS_DIM)
    return payload_bytes({"actor_state_dict": actor}, policy_info(file, payload))


class SeeingEnv(QuadrupedEnv):
    """A course whose robots see what is ahead, but not the time: [N, 53]."""

    def get_observations(self) -> TensorDict:
        """See `QuadrupedEnv`."""
        seen = super().get_observations()["policy"][:, :_SEEN_DIM]
        return TensorDict({"policy": seen}, batch_size=[self.num_envs])


def joint_runner(robot: Robot, cfg: TrainCfg, seed: int) -> Runner:
    """An engine of `train` on a course."""
    return Runner(SeeingEnv(robot, cfg.env, cfg.ppo.num_envs, seed=seed), cfg.ppo)


class Seeing(nn.Module):
    """The network of a gait that sees what is ahead."""

    def __init__(self, hidden_sizes: tuple[int, ...]) -> None:
        super().__init__()
        self.obs_normalizer = EmpiricalNormalization(_SEEN_DIM)
        self.mlp = MLP(_SEEN_DIM, 12, list(hidden_sizes), "elu")

    def forward(self, obs: Tensor) -> Tensor:
        """Actions [N, 12] of `obs` [N, 53]."""
        return self.mlp(self.obs_normalizer(obs))
