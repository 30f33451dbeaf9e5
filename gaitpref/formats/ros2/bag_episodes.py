"""From a ROS 2 bag to episodes."""

from __future__ import annotations

from pathlib import Path

from data.files.telling import Tell, silent
from gaitpref.formats.logs.log_episodes import (
    LogEpisodes,
    log_episodes,
    robot_of,
    source_of,
)
from gaitpref.formats.logs.log_findings import Findings
from gaitpref.formats.logs.log_map import LogMap

from .bag_files import files_of
from .clock import runs_of
from .read import read_samples
from .runs_told import recordings_of


def bag_episodes(
    bag: Path, log_map: LogMap, root: Path, tell: Tell = silent
) -> LogEpisodes:
    """Every stretch of a bag in which joints and base are known.

    Args:
        bag: A file in MCAP or sqlite3, or the folder of several, packed or not.
        log_map: What its topics mean.
        root: Directory the map's paths start from.
        tell: Gets the stretches that are worked out.

    Raises:
        LogError, RobotError: the bag, its map or the robot cannot be used.
    """
    findings = Findings()
    files = files_of(bag, findings)
    runs = runs_of(read_samples(files, log_map, findings), log_map, findings)
    recordings = recordings_of(runs, log_map, findings)
    source = source_of("ros2", bag, files)
    robot = robot_of(log_map, root)
    return log_episodes(recordings, log_map, robot, findings, source=source, tell=tell)
