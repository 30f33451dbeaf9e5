"""`gaitpref train`: a policy on a hand-written, a criterion's or a learned reward."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from torch import Tensor

from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from data.files.lock import only_writer
from gaitpref.cli.options import options
from gaitpref.cli.shared.actor_arguments import actors_of
from gaitpref.cli.shared.by_hand import (
    Stage,
    refuse_beside_method,
    stage_of,
    told_without_method,
)
from gaitpref.cli.shared.launched import ranks_of_launch
from gaitpref.cli.shared.off_policy import off_policy_of, told_offline
from gaitpref.cli.shared.simulator import require_sim, sim_of
from gaitpref.cli.shared.training_command import refuse_trained, told_stopped
from gaitpref.console.progress import console, training_bar
from gaitpref.console.terminal import EXIT_INTERRUPTED
from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.training.by_method import Retraining, rows_of
from gaitpref.training.off_policy_training import off_policy_cfg, paid_by_step
from gaitpref.training.total_reward import load_score, total_reward
from policy.engines.with_actors import WithActors
from policy.env.curriculum import CurriculumCfg
from policy.env.env_cfg import RANDOMISE, EnvCfg, getup_env
from policy.env.known_terms import KnownTermsCfg
from policy.env.own_law import imu_law
from policy.extensions.bonus import ExplorationBonusCfg
from policy.extensions.kl_penalty import KlPenaltyCfg
from policy.imported.observed import observed_as
from policy.offpolicy.off_policy_runner import OffPolicy
from policy.parallel.ranks import Ranks
from policy.robots.motor_class import soft_servos
from policy.rollouts.walking import from_rest
from policy.training.checkpoint import load_policy
from policy.training.ppo import ScoreFn
from policy.training.setup import Setting, setting_of
from policy.training.train import Engine, train
from policy.training.train_cfg import TrainCfg
from rewardmodel.models.model import RewardModel

_LOOK_S = 5.0
"""A robot that has not set off by then does not."""


def run(command: options.Train) -> int:
    """Run the command; gives the exit code."""
    with ExitStack() as stack:
        ranks = stack.enter_context(ranks_of_launch())
        if ranks.is_first:
            stack.enter_context(only_writer(command.out, console.print))
        return _train(command, ranks)


def _train(command: options.Train, ranks: Ranks) -> int:
    if not command.resume:
        refuse_trained(command.out)
    setting = setting_of(command.init, command.robot)
    cfg = _plain_cfg(command, setting)
    require_sim(cfg.sim)
    refuse_beside_method(
        command,
        {
            "--keep-task": command.keep_task,
            "--mirror": command.mirror,
            "--exploration": command.exploration != "none",
            "--kl-penalty": command.kl_penalty != "none",
        },
    )
    own = Path(command.reward) if command.round == 1 else None
    stage = stage_of(command, own=own if own and own.is_dir() else None, least=1)
    if stage is None:
        reward_fn = _plain_reward(command, setting, cfg.env)
    else:
        retraining = _retraining(command, stage, setting)
        paid = stage.method.paid.of(retraining.model, stage.context)
        reward_fn = retraining.reward(paid, cfg)
        cfg = retraining.trained(cfg)
    cfg, engine = _engine(command, cfg, ranks)
    if isinstance(engine, OffPolicy):
        reward_fn = paid_by_step(reward_fn, console.print)
    with training_bar("training", command.total_steps) as bar:
        result = train(
            command.out,
            setting.robot,
            cfg,
            reward_fn=reward_fn,
            reward_name=command.reward + (" and task" if command.keep_task else ""),
            init=command.init,
            resume=command.resume,
            on_iteration=bar,
            ranks=ranks,
            engine=engine,
        )
    if not result.finished:
        return told_stopped(result.steps) if ranks.is_first else EXIT_INTERRUPTED
    console.print(f"the policy is {result.policy}")
    if command.offline:
        code = told_offline(
            command, result, setting.robot, cfg.env, reward_fn, console.print
        )
        if code:
            return code
    if ranks.is_first and command.reward == "task" and not command.getup:
        _tell_standing(result.policy)
    if ranks.is_first:
        console.next(
            f"`gaitpref play --policy {result.policy} --open` shows it, `gaitpref "
            f"record --policy {result.policy} --dataset DIR` logs what it does"
        )
    return 0


def _tell_standing(file: Path) -> None:
    """Say at which speeds a new walk stays where it is, which no mean of it shows.

    Training sees it walk long before: with the noise of exploration it does.
    """
    policy = load_policy(file)
    cfg = replace(policy.info.env, episode_s=_LOOK_S)
    found = from_rest(policy, policy.robot(), cfg, seed=0)
    standing = [f"{row.asked_m_s:.1f}" for row in found if row.never_set_off]
    if standing:
        console.print(
            f"without the noise of training it does not set off from rest at "
            f"{', '.join(standing)} m/s: train on, with --resume and more --steps"
        )
        if soft := soft_servos(policy.robot()):
            console.print(soft)


def _engine(
    command: options.Train, cfg: TrainCfg, ranks: Ranks
) -> tuple[TrainCfg, Engine | None]:
    """`cfg` as it suits who collects and learns, and who that is; None is PPO in this
    process.

    Raises:
        GaitprefError: options that do not go together, or Ray is not installed.
    """
    actors = actors_of(command, ranks)
    engine = off_policy_of(command, actors, ranks, console.print)
    if engine is not None:
        return off_policy_cfg(cfg), engine
    if actors is None:
        return cfg, None
    return cfg, WithActors(cfg=actors, tell=console.print)


def _plain_cfg(command: options.Train, setting: Setting) -> TrainCfg:
    """The training as the command line says it."""
    env = replace(
        setting.env,
        randomise=RANDOMISE[command.randomize],
        terrain=replace(setting.env.terrain, kind=command.terrain),
        curriculum=CurriculumCfg() if command.curriculum else None,
    )
    if command.getup:
        env = getup_env(env)
    env = _observed(command, setting, env)
    return TrainCfg(
        steps=command.total_steps,
        env=env,
        ppo=replace(
            setting.ppo,
            num_envs=command.envs,
            hidden_sizes=command.actor_sizes or setting.ppo.hidden_sizes,
            bonus=(
                None
                if command.exploration == "none"
                else ExplorationBonusCfg(kind=command.exploration)
            ),
            kl_penalty=(
                None
                if command.kl_penalty == "none"
                else KlPenaltyCfg(kind=command.kl_penalty)
            ),
            mirror=command.mirror,
            privileged_critic=command.randomize != "off" or env.law is not None,
        ),
        seed=command.seed,
        checkpoints=command.checkpoints,
        sim=sim_of(command),
    )


def _observed(command: options.Train, setting: Setting, env: EnvCfg) -> EnvCfg:
    """`env` with what a new policy is to see.

    Raises:
        GaitprefError: that cannot be chosen here.
    """
    what = command.observe
    if command.history > 1 and what != "imu":
        raise GaitprefError(
            "--history shows more than one step with --observe imu; a file says the "
            "frames of each of its terms"
        )
    if what == "all":
        return env
    if command.init is not None:
        raise GaitprefError(
            f"--observe {what} with --init: a policy goes on seeing what it was "
            "trained with; leave one of the two out"
        )
    if command.mirror:
        raise GaitprefError(f"--observe {what} learns in no mirror: leave --mirror out")
    if what == "imu":
        return env.under(imu_law(setting.robot, env, frames=command.history))
    law, left = observed_as(Path(what), setting.robot, env)
    if left:
        console.print(
            f"{what} says what the policy sees; it acts as ours do, so this is not "
            f"taken over: {', '.join(left)}"
        )
    return env.under(law)


def _plain_reward(
    command: options.Train, setting: Setting, env: EnvCfg
) -> ScoreFn | None:
    """What is paid without a method; None is the environment's own."""
    if command.reward == "task":
        return None
    score = load_score(command.reward, criterion_context(setting.robot, env))
    if isinstance(score, RewardModel):
        console.print(told_without_method("pays a learned reward otherwise"))
    return total_reward(
        score, setting.robot, env, known=KnownTermsCfg(), keep_task=command.keep_task
    )


def _retraining(command: options.Train, stage: Stage, setting: Setting) -> Retraining:
    """What a round of the loop trains with.

    Raises:
        GaitprefError: something the method needs is missing.
    """
    style = stage.method.tracking is not None
    for name, needed in (
        ("--init POLICY, which it goes on from", command.init),
        ("--dataset DIR, with the clips the reward was fitted to", command.dataset),
    ):
        if needed is None:
            raise GaitprefError(f"--method {command.method} needs {name}")
    if stage.context.is_first:
        raise GaitprefError(
            "--round 0 trains on no learned reward: give --round 1 or a later one"
        )
    assert command.init is not None
    assert command.dataset is not None
    score = load_score(command.reward, criterion_context(setting.robot, setting.env))
    if not isinstance(score, RewardModel):
        raise GaitprefError(
            f"--method {command.method} pays a learned reward: --reward must be a "
            f"directory of `gaitpref fit`, got {command.reward}"
        )
    base = command.base or command.init
    return Retraining(
        method=stage.method,
        context=stage.context,
        robot=setting.robot,
        model=score,
        seen=_newest_rows(Dataset.open(command.dataset)),
        start=load_policy(command.init),
        base=load_policy(base) if style else None,
    )


def _newest_rows(dataset: Dataset) -> Tensor:
    """Rows [T, N, F] of some episodes of the newest round.

    Raises:
        GaitprefError: there is none.
    """
    entries = dataset.entries()
    if not entries:
        raise GaitprefError(
            f"{dataset.root} holds no episode: give the --dataset the "
            "reward was fitted to"
        )
    newest = max(entry.meta.round for entry in entries)
    return rows_of(dataset, [e.sha256 for e in entries if e.meta.round == newest])
