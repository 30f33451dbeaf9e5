"""What was rolled out as the episode that is logged, with what is told of it.

Shapes: N environments, T steps of an episode.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from data.episodes.choices import COURSE
from data.episodes.episode import EndReason, Episode, EpisodeMeta
from data.episodes.episode_records import COMMAND_CHANGE, TEAM_TASK
from data.files.plain import to_plain
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.training.checkpoint import Policy

from .babble import BABBLE_SHA256
from .record_cfg import Command
from .rollout import RolloutStep

LOGGED = ("qpos", "qvel", "obs", "action", "targets", "features", "reward")


def logged(steps: Sequence[RolloutStep]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """What is logged of `steps`, each [N, T, ...], and the episodes' lengths [N].

    Once for all: taking steps apart for every episode costs a third of the rollout.
    """
    arrays = {
        name: np.stack([np.asarray(getattr(step, name)) for step in steps], axis=1)
        for name in LOGGED
    }
    return arrays, np.sum([np.asarray(step.alive) for step in steps], axis=0)


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
        task=TEAM_TASK if cfg.team else "walk" if cfg.getup is None else "getup",
        seed=seed,
        env_index=index,
        command=command,
        policy_sha256=BABBLE_SHA256 if policy is None else policy.sha256,
        policy_step=0 if policy is None else policy.info.steps,
        stochastic=stochastic,
        control_dt_s=cfg.control_dt_s,
        physics_dt_s=cfg.physics_dt_s,
        robot=env.robot.name,
        model_sha256=env.sim.robot.model_sha256,
        round=round,
        extra=_extra(
            cfg,
            "nothing" if policy is None else policy.info.reward,
            change_steps=change_steps,
            varied=varied,
        ),
    )


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
