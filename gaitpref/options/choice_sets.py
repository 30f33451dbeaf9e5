"""Whether episodes show the robot, the course and the rate that a choice is about."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import lru_cache

from data.episodes.choices import COURSE
from data.episodes.episode_records import Episode, EpisodeMeta
from data.errors import GaitprefError
from data.files.plain import from_plain
from policy.env.course import CourseCfg
from policy.env.env_cfg import EnvCfg
from policy.env.world import in_world
from policy.options.choice_row import ChoiceReward
from policy.robots.differences import differences
from policy.robots.robot import Robot, load_robot_xml


@dataclass(frozen=True, eq=False)
class Asked:
    """What chooses, and where: what answers must be about to be paid for it."""

    robot: Robot
    control_dt_s: float
    course: CourseCfg

    def require(self, episode: Episode) -> None:
        """
        Raises:
            GaitprefError: an episode shows another robot, course or rate.
        """
        meta = episode.meta
        if meta.control_dt_s != self.control_dt_s:
            raise GaitprefError(
                f"an episode that was judged acts at {1 / meta.control_dt_s:g} Hz, and "
                f"these gaits at {1 / self.control_dt_s:g} Hz: give gaits of that "
                "rate, or answers about these"
            )
        if unlike := _unlike(self.course, course_of(episode)):
            raise GaitprefError(
                f"an episode that was judged is of another course: {unlike}; give the "
                "--course and the heights of the answers, or answers about this course"
            )
        if meta.model_sha256 == self.robot.model_sha256:
            return
        shown = _robot_in(episode.mjcf, meta.robot, meta.physics_dt_s)
        if differing := differences(self.robot, shown):
            told = "; ".join(differing)
            raise GaitprefError(
                f"an episode that was judged is of another robot than {self.robot.name}"
                f": {meta.robot} has {told}; give gaits of that robot, or answers about"
                " these"
            )


def course_of(episode: Episode) -> CourseCfg:
    """The course that an episode was on.

    Raises:
        GaitprefError: it says of none.
    """
    try:
        return from_plain(CourseCfg, json.loads(episode.meta.extra[COURSE]))
    except (KeyError, TypeError, ValueError) as error:
        raise GaitprefError(
            f"an episode says of no course that it was on ({error}); record it again"
        ) from None


def _unlike(own: CourseCfg, shown: CourseCfg) -> str:
    """In what a course is not `own`, in words; where robots begin on it is all one."""
    kinds, others = (
        [(each.kind, each.start_m, each.length_m) for each in course.obstacles]
        for course in (own, shown)
    )
    if kinds != others:
        told = (" ".join(each.kind for each in c.obstacles) for c in (own, shown))
        here, there = told
        if here == there:
            return "its obstacles lie elsewhere"
        return f"{there} instead of {here}"
    for name in ("step_m", "bar_m", "slope_rad", "length_m", "width_m"):
        here, there = getattr(own, name), getattr(shown, name)
        if here != there:
            return f"a {name} of {there:g} instead of {here:g}"
    return ""


@lru_cache(maxsize=2)
def _robot_in(mjcf: str, name: str, physics_dt_s: float) -> Robot:
    return load_robot_xml(mjcf, name=name, physics_dt_s=physics_dt_s)


def require_about(reward: ChoiceReward, meta: EpisodeMeta, where: str) -> None:
    """
    Raises:
        GaitprefError: the reward is about another robot, course or rate.
    """
    if not reward.robot:
        return
    if (reward.robot, reward.control_dt_s) != (meta.robot, meta.control_dt_s):
        shown = f"{meta.robot} at {1 / meta.control_dt_s:g} Hz"
    elif reward.model_sha256 not in ("", meta.model_sha256):
        shown = f"another model of {meta.robot}, or another course"
    else:
        return
    raise GaitprefError(
        f"this reward is about choices of {reward.robot} at "
        f"{1 / reward.control_dt_s:g} Hz, and {where} shows {shown}: give the reward "
        "that `gaitpref options` wrote beside the policy that was recorded"
    )


def about(reward: ChoiceReward, robot: Robot, env: EnvCfg) -> ChoiceReward:
    """`reward`, which says whose choices it is about, and where."""
    return replace(
        reward,
        robot=robot.name,
        control_dt_s=env.control_dt_s,
        model_sha256=in_world(robot, env).model_sha256,
    )
