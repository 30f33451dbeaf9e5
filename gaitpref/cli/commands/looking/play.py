"""`gaitpref play`: a policy, or two on the same commands, driven from the browser."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path

import viser

from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from data.features import column
from gaitpref.cli.options import options
from gaitpref.cli.shared.next_of_answers import next_once_answered
from gaitpref.cli.shared.serving import require_port, stoppable, wait_until_stopped
from gaitpref.console.browser import open_page
from gaitpref.console.progress import console, working
from gaitpref.console.terminal import say
from gaitpref.raters.liked import Liked
from labeling_ui.play_server import Like, PlayPage, play_site
from labeling_ui.scene.geometry import robot_geometry
from labeling_ui.scene.live_robot import (
    HISTORY_S,
    Drive,
    LivePolicy,
    LiveState,
    StepFn,
)
from labeling_ui.web.proxy_cfg import LOCAL_RATER
from labeling_ui.web.tokens import TokenStore
from labeling_ui.web.visit import Visit
from policy.env.world import in_world
from policy.law.driven import driven_by
from policy.robots.differences import differences
from policy.robots.robot import load_robot
from policy.robots.shipped import WALK
from policy.rollouts.driven_policy import DrivenPolicy
from policy.training.checkpoint import load_policy


class LiveStep:
    """A driven policy as the page steps it."""

    def __init__(self, driven: DrivenPolicy) -> None:
        self.driven = driven

    def __call__(self, drive: Drive) -> LiveState:
        """One control step."""
        if drive.reset:
            self.driven.begin()
        if any(drive.push_m_s):
            self.driven.push(drive.push_m_s)
        step = self.driven.step(drive.command)
        assert step.final is not None
        row = step.features[0]
        return LiveState(
            qpos=step.final[0][0].numpy(),
            contact=row[column("foot_contact")].numpy(),
            speed_m_s=float(row[column("base_lin_vel_b")][0]),
            height_m=float(row[column("base_height")]),
            fallen=bool(step.fallen[0]),
        )


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
        return LiveStep(DrivenPolicy(deepcopy(policy), robot, memory_s=HISTORY_S))

    return LivePolicy(
        name=f"{path.parent.name}/{path.name}, {policy.info.steps:,} steps{on_other}",
        geometry=robot_geometry(robot.mjcf),
        control_dt_s=env.control_dt_s,
        new_step=new_step,
    )


def _like(command: options.Play) -> Like | None:
    """What keeps what a visitor likes; None where nobody asked for it.

    Raises:
        GaitprefError: there is but one robot, or the data set cannot be used.
    """
    if command.dataset is None:
        return None
    if command.against is None:
        raise GaitprefError(
            "--dataset keeps which of two robots you like: give --against POLICY too, "
            "or leave it out"
        )
    liked = Liked(Dataset.create(command.dataset), LOCAL_RATER)

    def like(steps: Sequence[StepFn], which: int) -> str:
        driven = [step.driven for step in steps if isinstance(step, LiveStep)]
        try:
            return liked(driven, which)
        except (GaitprefError, OSError) as error:
            return f"not kept: {error}"

    return like


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

    like = _like(command)

    def new_page(client: viser.ClientHandle, visit: Visit) -> PlayPage:
        return PlayPage(client, policies, like)

    site = play_site(command.port, TokenStore(paths[0].parent), likes=like is not None)
    with stoppable() as stopped:
        site.start(new_page)
        print(f"the policy is at {site.url}", flush=True)
        if command.open:
            open_page(site.url)
        wait_until_stopped(stopped)
        site.stop()
    console.next(_next(command))
    return 0


def _next(command: options.Play) -> str:
    if command.dataset is not None:
        return next_once_answered(Dataset.open(command.dataset))
    policy = f" --policy {command.policy}" * bool(command.policy)
    against = f" --against {command.against}" * bool(command.against)
    where = ", on the robot it was trained on" * bool(command.robot)
    return f"`gaitpref film{policy}{against} --out walk.gif` films it{where}"
