"""Recording episodes of a policy and of its own earlier checkpoints.

Shapes: N environments, T steps of an episode.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from data.episodes.choices import COURSE, told_choices
from data.episodes.episode import EndReason, Episode, EpisodeMeta
from data.episodes.episode_records import COMMAND_CHANGE
from data.files.plain import ADDED_LATER, to_plain
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import CommandCfg, EnvCfg
from policy.env.seeding import spawned
from policy.training.checkpoint import Policy, load_policy
from policy.training.training_dir import CHECKPOINTS_NAME

from .babble import BABBLE_SHA256, Babble
from .rollout import Actor, RolloutStep, first_episodes
from .variation import VariationCfg, Varied

LONGEST_S = 600.0
"""Longest episode: it is held in memory until it is written."""

Command = tuple[float, float, float]
"""Forward m/s, left m/s, yaw rad/s."""


@dataclass(frozen=True, kw_only=True)
class RecordCfg:
    """What is recorded of a policy."""

    episodes: int = 64
    """Episodes in all."""
    episode_s: float = 6.0
    """Length of an episode that does not fall."""
    change_s: float | None = field(default=None, metadata=ADDED_LATER)
    """Time after which the next of the recorded commands is asked for, again and again:
    a whole manoeuvre. None keeps an episode's command."""
    checkpoints: int = 3
    """Earlier checkpoints of the same training that are recorded too."""
    checkpoint_share: float = 0.5
    """Share of the episodes that shows them."""
    noisy_share: float = 0.5
    """Share of a policy's episodes with exploration noise, so that clips differ."""
    variation: VariationCfg = field(default=VariationCfg(), metadata=ADDED_LATER)
    """Other postures, so that clips differ in what a policy never varies itself."""
    babble_share: float = 0.0
    """Share of the episodes that shows random rhythms instead of a policy; all do
    while the policy is untrained, unless the share is 0."""
    babble_m_s: tuple[float, ...] = (0.1, 0.2, 0.3)
    """Forward speeds asked of random rhythms, about as fast as some of them go: at
    speeds none comes near, all clips fail alike."""

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ValueError(f"episodes must be at least 1, got {self.episodes}")
        if not self.episode_s > 0:
            raise ValueError(f"episode_s must be positive, got {self.episode_s}")
        if self.change_s is not None and not self.change_s > 0:
            raise ValueError(f"change_s must be positive, got {self.change_s}")
        if not self.babble_m_s:
            raise ValueError("babble_m_s needs at least one speed")

    def change_steps(self, control_dt_s: float) -> int:
        """Control steps from one command to the next; 0 keeps an episode's command."""
        if self.change_s is None:
            return 0
        return max(1, round(self.change_s / control_dt_s))


def recorded_commands(
    cfg: CommandCfg, forward_m_s: tuple[float, ...] | None = None
) -> list[Command]:
    """The few commands that are recorded, each once, so that many clips share one."""
    low, high = cfg.evaluated_m_s
    speeds = forward_m_s or (low, (low + high) / 2, high)
    middle = speeds[len(speeds) // 2]
    commands = [
        *((speed, 0.0, 0.0) for speed in speeds),
        (middle, cfg.left_m_s[1], 0.0),
        (middle, 0.0, cfg.yaw_rad_s[1]),
    ]
    return list(dict.fromkeys(commands))


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
) -> Iterator[Episode]:
    """Episodes of the policy and of its checkpoints, one after the other.

    Args:
        policy_file: The policy; `checkpoints/` beside it holds the earlier ones.
        cfg: How many, how long.
        seed: Start states and exploration noise.
        round: Stored with every episode.
        policies: Used instead of those found on disk; the newest first.
    """
    if policies is None:
        earlier = checkpoint_files(policy_file, cfg.checkpoints)
        policies = [load_policy(f) for f in (policy_file, *reversed(earlier))]
    babbled = int(cfg.episodes * cfg.babble_share)
    if babbled and not policies[0].info.steps:
        babbled = cfg.episodes
    counts = [*_shares(cfg, cfg.episodes - babbled, len(policies)), babbled]
    for index, (policy, count) in enumerate(
        zip([*policies, policies[0]], counts, strict=True)
    ):
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
            )


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
) -> Iterator[Episode]:
    """Episodes of `policy`, or of random rhythms in its place."""
    gaits = policy.info.ppo.gaits
    if gaits is not None:
        # It remembers what runs, and is told below who changes gaits at random.
        policy = deepcopy(policy)
    env_cfg = replace(policy.info.env, episode_s=cfg.episode_s)
    env_seed, actor_seed = spawned(seed, 2)
    env = QuadrupedEnv(policy.robot(), env_cfg, count, seed=env_seed, keep_final=True)
    # Who lies is asked for nothing but to get up.
    choices = recorded_commands(
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
        if (gait := policy.gait) is not None and not babble:
            ran.append(gait.numpy())
    # Once for all: taking steps apart for every episode costs a third of the rollout.
    arrays = {
        name: np.stack([np.asarray(getattr(step, name)) for step in steps], axis=1)
        for name in LOGGED
    }
    lengths = np.sum([np.asarray(step.alive) for step in steps], axis=0)
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


def meta_of(
    policy: Policy | None,
    env: QuadrupedEnv,
    *,
    command: Command,
    seed: int,
    index: int = 0,
    stochastic: bool = False,
    round: int = 0,
    change_steps: int = 0,
    varied: bool = False,
) -> EpisodeMeta:
    """What is stored with an episode of `policy`, or of random rhythms, in `env`.

    Args:
        policy: Who acts; None are random rhythms.
        env: Where.
        command: What was asked first.
        seed: Where its chance came from.
        index: Which of the environments it is of.
        stochastic: With exploration noise.
        round: Of the loop.
        change_steps: Control steps from one command to the next; 0 keeps the first.
        varied: In another posture.
    """
    cfg = env.cfg
    return EpisodeMeta(
        task="walk" if cfg.getup is None else "getup",
        seed=seed,
        env_index=index,
        command=command,
        policy_sha256=BABBLE_SHA256 if policy is None else policy.sha256,
        policy_step=0 if policy is None else policy.info.steps,
        stochastic=stochastic,
        control_dt_s=cfg.control_dt_s,
        physics_dt_s=cfg.physics_dt_s,
        robot=env.robot.name,
        model_sha256=env.robot.model_sha256,
        round=round,
        extra=_extra(
            cfg,
            "nothing" if policy is None else policy.info.reward,
            change_steps=change_steps,
            varied=varied,
        ),
    )


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


def _extra(
    cfg: EnvCfg, trained_against: str, *, change_steps: int, varied: bool
) -> dict[str, str]:
    """What is stored with an episode as text."""
    extra = {"trained_against": trained_against}
    if change_steps:
        extra[COMMAND_CHANGE] = str(change_steps)
    if varied:
        extra["posture"] = "varied"
    if cfg.terrain.kind != "flat":
        extra |= {"terrain": cfg.terrain.kind, "terrain_seed": str(cfg.terrain.seed)}
    if cfg.course is not None:
        extra[COURSE] = json.dumps(to_plain(cfg.course, whole=True), sort_keys=True)
    return extra


def _babble(env: QuadrupedEnv, rng: torch.Generator) -> Babble:
    return Babble(
        env.num_envs,
        control_dt_s=env.cfg.control_dt_s,
        action_scale_rad=env.action_scale_rad,
        rng=rng,
    )


LOGGED = ("qpos", "qvel", "obs", "action", "targets", "features", "reward")


def episode_of(
    last: RolloutStep,
    rows: dict[str, np.ndarray],
    index: int,
    meta: EpisodeMeta,
    mjcf: str,
) -> Episode:
    """The first episode of environment `index`: its `rows` [T, ...] up to `last`."""
    if last.final is None:
        raise ValueError("recording needs an environment made with keep_final=True")
    qpos, qvel, obs = (each[index].numpy()[None] for each in last.final)
    end: EndReason = "truncated"
    if last.aborted[index]:
        end = "aborted"
    elif last.fallen[index]:
        end = "terminated"
    return Episode(
        qpos=np.concatenate([rows["qpos"], qpos]),
        qvel=np.concatenate([rows["qvel"], qvel]),
        obs=np.concatenate([rows["obs"], obs]),
        action=rows["action"],
        ctrl=rows["targets"],
        features=rows["features"],
        reward=rows["reward"],
        end_reason=end,
        meta=meta,
        mjcf=mjcf,
    )


def _noisy(count: int, period: int, share: float) -> np.ndarray:
    """Which episodes act with noise [N]: the same share of every command."""
    turn = np.arange(count) // period
    return np.floor((turn + 1) * share) > np.floor(turn * share)
