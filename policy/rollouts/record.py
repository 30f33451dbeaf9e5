"""Recording episodes of a policy and of its own earlier checkpoints.

Shapes: N environments, T steps of an episode.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from data.episodes.choices import told_choices
from data.episodes.episode import Episode
from data.files.telling import Tell, silent
from policy.env.env import QuadrupedEnv
from policy.env.seeding import spawned
from policy.env.world import in_world
from policy.sim.batch_sim import BatchSim
from policy.training.checkpoint import Policy, load_policy
from policy.training.training_dir import CHECKPOINTS_NAME

from .babble import Babble
from .record_cfg import Command, RecordCfg, recorded_commands
from .rolled_out import episode_of, logged, meta_of
from .rollout import Actor, RolloutStep, first_episodes
from .variation import Varied


def checkpoint_files(policy_file: Path, count: int) -> list[Path]:
    """The newest `count` checkpoints that training left beside `policy_file`."""
    folder = policy_file.parent / CHECKPOINTS_NAME
    found = sorted(folder.glob("step_*.pt")) if folder.is_dir() else []
    return found[-count:] if count else []


def record(
    policy_file: Path,
    cfg: RecordCfg,
    *,
    seed: int,
    round: int = 0,
    policies: Sequence[Policy] | None = None,
    commands: Sequence[Command] | None = None,
    threads: int = 0,
    tell: Tell = silent,
) -> Iterator[Episode]:
    """Episodes of the policy and of its checkpoints, one after the other.

    Args:
        policy_file: The policy; `checkpoints/` beside it holds the earlier ones.
        cfg: How many, how long.
        seed: Start states and exploration noise.
        round: Stored with every episode.
        policies: Used instead of those found on disk; the newest first.
        commands: Asked for instead of the few that are recorded.
        threads: Of the simulator (0: as of `BatchSim`); the episodes are the same.
        tell: Gets the control steps that are done, of as many as there are at most.
    """
    if policies is None:
        earlier = checkpoint_files(policy_file, cfg.checkpoints)
        policies = [load_policy(f) for f in (policy_file, *reversed(earlier))]
    babbled = int(cfg.episodes * cfg.babble_share)
    if babbled and not policies[0].info.steps:
        babbled = cfg.episodes
    counts = [*_shares(cfg, cfg.episodes - babbled, len(policies)), babbled]
    sources = [*policies, policies[0]]
    lengths = [
        replace(policy.info.env, episode_s=cfg.episode_s).episode_steps * bool(count)
        for policy, count in zip(sources, counts, strict=True)
    ]
    for index, (policy, count) in enumerate(zip(sources, counts, strict=True)):
        if count:
            source_seed = int(
                np.random.SeedSequence([seed, index]).generate_state(1)[0]
            )
            yield from _record_one(
                policy,
                cfg,
                count,
                seed=source_seed,
                round=round,
                babble=index == len(policies),
                commands=commands,
                threads=threads,
                tell=partial(_tell_behind, tell, sum(lengths[:index]), sum(lengths)),
            )


def _tell_behind(tell: Tell, before: int, of: int, done: int) -> None:
    tell(before + done, of)


def _shares(cfg: RecordCfg, episodes: int, sources: int) -> list[int]:
    """Episodes for each policy: the newest gets what the checkpoints leave."""
    earlier = sources - 1
    each = int(episodes * cfg.checkpoint_share) // earlier if earlier else 0
    return [episodes - each * earlier] + [each] * earlier


def _record_one(
    policy: Policy,
    cfg: RecordCfg,
    count: int,
    *,
    seed: int,
    round: int,
    babble: bool,
    commands: Sequence[Command] | None,
    threads: int,
    tell: Callable[[int], None],
) -> Iterator[Episode]:
    """Episodes of `policy`, or of random rhythms in its place."""
    gaits = policy.info.ppo.gaits
    if gaits is not None:
        # It remembers what runs, and is told below who changes gaits at random.
        policy = deepcopy(policy)
    env_cfg = replace(policy.info.env, episode_s=cfg.episode_s)
    env_seed, actor_seed = spawned(seed, 2)
    robot = in_world(policy.robot(), env_cfg)
    env = QuadrupedEnv(
        robot,
        env_cfg,
        count,
        seed=env_seed,
        sim=BatchSim(robot, count, threads=threads),
        keep_final=True,
    )
    # Who lies is asked for nothing but to get up.
    choices = commands or recorded_commands(
        env_cfg.commands,
        cfg.babble_m_s if babble and env_cfg.getup is None else None,
    )
    noisy = _noisy(count, len(choices), 0.0 if babble else cfg.noisy_share)
    rng = torch.Generator().manual_seed(actor_seed)
    actor, varied = _actor(policy, env, cfg, rng, babble=babble)
    change_steps = cfg.change_steps(env_cfg.control_dt_s)
    if gaits is not None:
        # What varies between clips of it is which gait runs when.
        policy.wander(torch.from_numpy(noisy), rng)
    steps, ran = [], []
    noise = torch.from_numpy(noisy).float()
    rollout = first_episodes(actor, env, noise=noise, rng=rng)
    for step in _told(rollout, env, choices, change_steps):
        steps.append(step)
        tell(len(steps))
        if (gait := policy.gait) is not None and not babble:
            ran.append(gait.numpy())
    arrays, lengths = logged(steps)
    for index in range(count):
        meta = meta_of(
            None if babble else policy,
            env,
            command=choices[index % len(choices)],
            seed=seed,
            index=index,
            stochastic=bool(noisy[index]),
            round=round,
            change_steps=change_steps,
            varied=bool(varied[index]),
        )
        num_steps = int(lengths[index])
        if gaits is not None and ran:
            own = np.stack(ran)[:num_steps, index]
            meta.extra.update(told_choices(gaits.names, own))
        rows = {name: array[index, :num_steps] for name, array in arrays.items()}
        yield episode_of(steps[num_steps - 1], rows, index, meta, env.robot.mjcf)


def _actor(
    policy: Policy,
    env: QuadrupedEnv,
    cfg: RecordCfg,
    rng: torch.Generator,
    *,
    babble: bool,
) -> tuple[Actor, np.ndarray]:
    """Who acts in `env`, and in which environments [N] in another posture."""
    none = np.zeros(env.num_envs, dtype=bool)
    if babble:
        return _babble(env, rng), none
    if not cfg.variation.share:
        return policy, none
    varied = Varied(
        policy,
        env.robot,
        cfg.variation,
        env.num_envs,
        action_scale_rad=env.action_scale_rad,
        rng=rng,
    )
    return varied, varied.chosen.numpy()


def _told(
    steps: Iterator[RolloutStep],
    env: QuadrupedEnv,
    choices: Sequence[Command],
    change_steps: int,
) -> Iterator[RolloutStep]:
    """`steps` of `env`, whose robots are told one of `choices` after the other.

    Args:
        steps: The rollout, not yet begun.
        env: What it steps.
        choices: Environment `i` begins with `choices[i]`, round and round.
        change_steps: Control steps from one command to the next; 0 keeps the first.
    """

    def tell(turn: int) -> None:
        asked = [choices[(i + turn) % len(choices)] for i in range(env.num_envs)]
        env.fix_commands(torch.tensor(asked))

    tell(0)
    for done, step in enumerate(steps, start=1):
        yield step
        if change_steps and done % change_steps == 0:
            tell(done // change_steps)


def _babble(env: QuadrupedEnv, rng: torch.Generator) -> Babble:
    return Babble(
        env.num_envs,
        control_dt_s=env.cfg.control_dt_s,
        action_scale_rad=env.action_scale_rad,
        rng=rng,
    )


def _noisy(count: int, period: int, share: float) -> np.ndarray:
    """Which episodes act with noise [N]: the same share of every command."""
    turn = np.arange(count) // period
    return np.floor((turn + 1) * share) > np.floor(turn * share)
