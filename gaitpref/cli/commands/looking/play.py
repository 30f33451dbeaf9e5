"""`gaitpref play`: a policy, or two on the same commands, driven from the browser."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import torch
import viser

from data.errors import GaitprefError
from data.features import column
from gaitpref.cli.options import options
from gaitpref.cli.shared.serving import require_port, stoppable, wait_until_stopped
from gaitpref.console.browser import open_page
from gaitpref.console.progress import working
from gaitpref.console.terminal import say
from labeling_ui.play_server import PlayPage, play_site
from labeling_ui.scene.geometry import robot_geometry
from labeling_ui.scene.live_robot import Drive, LivePolicy, LiveState, StepFn
from labeling_ui.web.tokens import TokenStore
from labeling_ui.web.visit import Visit
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.env.world import in_world
from policy.law.driven import driven_by
from policy.robots.differences import differences
from policy.robots.robot import Robot, load_robot
from policy.robots.shipped import WALK
from policy.sim.batch_sim import BatchSim
from policy.sim.chosen import Listed
from policy.training.checkpoint import Policy, load_policy

_FOREVER_S = 1e6


class PolicyRunner:
    """A policy in an environment of one robot that never runs out of time."""

    def __init__(self, policy: Policy, robot: Robot, *, seed: int = 0) -> None:
        self._policy, self._robot, self._seed = policy, robot, seed
        self._only = Listed(torch.zeros(1, dtype=torch.long))
        self._env = self._new_env()

    def __call__(self, drive: Drive) -> LiveState:
        """One control step."""
        if drive.reset:
            self._seed += 1
            self._env = self._new_env()
        env = self._env
        if any(drive.push_m_s):
            qpos, qvel = env.sim.raw_state()
            qvel[0, :2] += torch.tensor(drive.push_m_s)
            env.sim.reset(self._only, qpos, qvel)
        env.fix_commands(torch.tensor([drive.command]))
        action = self._policy(env.get_observations()["policy"])
        extras = env.step(action)[3]
        row = extras["features"][0]
        return LiveState(
            qpos=extras["final"][0][0].numpy(),
            contact=row[column("foot_contact")].numpy(),
            speed_m_s=float(row[column("base_lin_vel_b")][0]),
            height_m=float(row[column("base_height")]),
            fallen=bool(extras["fallen"][0]),
        )

    def _new_env(self) -> QuadrupedEnv:
        cfg = live_cfg(self._policy.info.env)
        sim = BatchSim(self._robot, 1, threads=1)
        return QuadrupedEnv(
            self._robot, cfg, 1, seed=self._seed, sim=sim, keep_final=True
        )


def live_cfg(cfg: EnvCfg) -> EnvCfg:
    """The environment a policy was trained in, without an end."""
    return replace(cfg, episode_s=_FOREVER_S)


def live_policy(path: Path, xml: Path | None) -> LivePolicy:
    """A policy file as the page takes it.

    Raises:
        GaitprefError: the policy or the robot cannot be used.
    """
    policy = load_policy(path)
    env = policy.info.env
    robot = trained = policy.robot()
    on_other = ""
    if xml is not None:
        robot = load_robot(xml, physics_dt_s=env.physics_dt_s)
        if env.law is not None:
            robot = driven_by(robot, env.law)
        if differing := differences(trained, robot):
            on_other = f", on {robot.name}, trained on {trained.name}"
            say(
                f"{path} was trained on {trained.name}, and {xml} is another robot: it "
                f"has {'; '.join(differing)}. What it does there says little of it"
            )
    robot = in_world(robot, env)

    def new_step() -> StepFn:
        # A policy that chooses among gaits remembers which one runs: of one visitor.
        return PolicyRunner(deepcopy(policy), robot)

    return LivePolicy(
        name=f"{path.parent.name}/{path.name}, {policy.info.steps:,} steps{on_other}",
        geometry=robot_geometry(robot.mjcf),
        control_dt_s=env.control_dt_s,
        new_step=new_step,
    )


def run(command: options.Play) -> int:
    """Serve the page until it is stopped; gives the exit code."""
    require_port(command.port)
    paths = [command.policy or WALK, *([command.against] if command.against else [])]
    with working("loading the policies"):
        policies = tuple(live_policy(path, command.robot) for path in paths)
    if len({policy.control_dt_s for policy in policies}) > 1:
        raise GaitprefError(
            f"{paths[0]} and {paths[1]} act at different rates; play one at a time"
        )

    def new_page(client: viser.ClientHandle, visit: Visit) -> PlayPage:
        return PlayPage(client, policies)

    site = play_site(policies, command.port, TokenStore(paths[0].parent))
    with stoppable() as stopped:
        site.start(new_page)
        print(f"the policy is at {site.url}", flush=True)
        if command.open:
            open_page(site.url)
        wait_until_stopped(stopped)
        site.stop()
    return 0
