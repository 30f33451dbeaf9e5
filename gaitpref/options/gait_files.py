"""Policy files as the gaits of one policy that chooses among them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from data.episodes.choices import NAME
from data.errors import GaitprefError
from policy.env.course import CourseCfg, stands_on
from policy.env.env_cfg import CommandCfg, EnvCfg
from policy.env.terrain import TerrainCfg
from policy.options.choosing import ChoosingCfg
from policy.options.gaits_model import GaitsCfg, GaitsModel
from policy.robots.differences import differences
from policy.robots.robot import Robot
from policy.training.checkpoint import (
    Policy,
    PolicyInfo,
    load_policy,
    payload_bytes,
    read_plain,
)
from policy.training.ppo import PpoCfg


@dataclass(frozen=True, eq=False)
class Gaits:
    """Frozen policies of one robot, by name."""

    names: tuple[str, ...]
    policies: tuple[Policy, ...]
    weights: tuple[dict[str, torch.Tensor], ...]
    """Of each one's network."""
    robot: Robot

    @property
    def env(self) -> EnvCfg:
        """What the first of them was trained in."""
        return self.policies[0].info.env

    def model(self, choosing: ChoosingCfg, *, seed: int) -> GaitsModel:
        """A policy of them whose chooser knows nothing yet."""
        cfg = GaitsCfg(
            names=self.names,
            sha256s=tuple(policy.sha256 for policy in self.policies),
            hidden_sizes=tuple(p.info.ppo.hidden_sizes for p in self.policies),
            control_dt_s=self.env.control_dt_s,
            choosing=choosing,
        )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = GaitsModel(gaits=cfg)
        for gait, weights in zip(model.gaits, self.weights, strict=True):
            gait.load_state_dict(weights)
        return model.eval()


def named_files(texts: tuple[str, ...]) -> dict[str, Path]:
    """Policy files by name, of texts `NAME=FILE`.

    Raises:
        GaitprefError: a text is none, a name comes twice, or there are fewer than two.
    """
    files: dict[str, Path] = {}
    for text in texts:
        name, equals, path = text.partition("=")
        if not equals or not path or not NAME.fullmatch(name):
            raise GaitprefError(
                f"--policy {text!r}: give NAME=FILE, as walk=runs/walk/policy.pt, the "
                "name of letters, digits, '_', '.' and '-'"
            )
        if name in files:
            raise GaitprefError(
                f"--policy {name!r} is there twice: name each gait once"
            )
        files[name] = Path(path)
    if len(files) < 2:
        raise GaitprefError(
            f"{len(files)} policies leave nothing to choose: give --policy NAME=FILE "
            "twice or more"
        )
    return files


def load_gaits(files: Mapping[str, Path]) -> Gaits:
    """The policies of `files`, if one robot can change between them.

    Raises:
        GaitprefError: one cannot be used, or not beside the first.
    """
    policies = {name: load_policy(path) for name, path in files.items()}
    (first, policy), *others = policies.items()
    robot = policy.robot()
    for name, each in policies.items():
        _require_own(name, files[name], each)
    for name, other in others:
        _require_alike(first, policy, robot, name, other)
    weights = []
    for path in files.values():
        actor = read_plain(path)["actor_state_dict"]
        weights.append(
            {k: v for k, v in actor.items() if k.startswith(("mlp.", "obs_norm"))}
        )
    return Gaits(tuple(policies), tuple(policies.values()), tuple(weights), robot)


def _require_own(name: str, path: Path, policy: Policy) -> None:
    info = policy.info
    if info.ppo.gaits is not None:
        raise GaitprefError(
            f"{name}: {path} chooses among gaits itself; give the policies that it "
            "chooses among"
        )
    if info.env.team is not None:
        raise GaitprefError(
            f"{name}: {path} walks in a team of two and sees the other robot; give "
            "policies of a robot alone"
        )
    if info.env.law is None and info.ppo.recipe is not None:
        raise GaitprefError(
            f"{name}: the network of {path} is none of PPO's, as that of --algorithm "
            "fastsac, and gaits run those alone: give policies of PPO"
        )
    if info.env.law is not None:
        raise GaitprefError(
            f"{name}: {path} sees and acts under a law of its own, and gaits that "
            "follow one another must share one: give policies that `gaitpref train` "
            "made without --observe, and did not import"
        )
    if info.env.getup is not None:
        raise GaitprefError(f"{name}: {path} gets up and does not walk; leave it out")


def _require_alike(
    first: str, policy: Policy, robot: Robot, name: str, other: Policy
) -> None:
    if differing := differences(robot, other.robot()):
        raise GaitprefError(
            f"{name} is of another robot than {first}: it has {'; '.join(differing)}; "
            "give policies of one robot"
        )
    one, two = policy.info.env, other.info.env
    for what, unit in (
        ("control_dt_s", "s"),
        ("physics_dt_s", "s"),
        ("action_scale_rad", "rad"),
        ("action_limit", ""),
    ):
        here, there = getattr(one, what), getattr(two, what)
        if here != there:
            raise GaitprefError(
                f"{name} has a {what} of {there:g} {unit}, {first} of {here:g} {unit}: "
                "gaits that follow one another must act alike; train one of them anew"
            )


def course_env(
    gaits: Gaits, course: CourseCfg, *, speed_m_s: float, episode_s: float
) -> EnvCfg:
    """The course for these gaits, straight ahead at one speed.

    Raises:
        RobotError: their robot cannot stand on it.
    """
    stands_on(gaits.robot, course)
    nowhere, asked = (0.0, 0.0), (speed_m_s, speed_m_s)
    return replace(
        gaits.env,
        episode_s=episode_s,
        terrain=TerrainCfg(),
        course=course,
        curriculum=None,
        commands=CommandCfg(
            forward_m_s=asked,
            left_m_s=nowhere,
            yaw_rad_s=nowhere,
            evaluated_m_s=asked,
        ),
    )


def options_bytes(
    gaits: Gaits,
    model: GaitsModel,
    env: EnvCfg,
    *,
    steps: int,
    reward: str,
    seed: int,
) -> bytes:
    """The contents of the file of a policy that chooses among gaits."""
    info = PolicyInfo(
        steps=steps,
        reward=reward,
        seed=seed,
        env=env,
        ppo=PpoCfg(gaits=model.cfg),
        robot_name=gaits.robot.name,
        robot_mjcf=gaits.policies[0].info.robot_mjcf,
    )
    return payload_bytes({"actor_state_dict": dict(model.state_dict())}, info)
