"""From a bag to episodes at the control rate.

Shapes: N states of an episode, T steps (N - 1).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.episodes.episode import Episode, EpisodeMeta
from data.episodes.resample import overlaps, split_at_gaps
from data.features import missing_features
from policy.robots.robot import Robot, load_robot

from .bag_doubts import tell_of_range, tell_of_speed
from .bag_findings import Findings
from .bag_map import SHIPPED_ROBOT, BagError, BagMap
from .clock import runs_of
from .mcap_file import files_of, sha256_of
from .read import read_samples
from .series import Bag, bags_of
from .track import Track, track_of


@dataclass(frozen=True, eq=False)
class BagEpisodes:
    """What came out of a bag, and what did not."""

    episodes: tuple[Episode, ...]
    stretches: int
    """Stretches of time in which joints and base are known, long enough to be used."""
    findings: Findings


def bag_episodes(bag_path: Path, bag_map: BagMap, root: Path) -> BagEpisodes:
    """Every stretch of a bag in which joints and base are known.

    Args:
        bag_path: The bag, a file or a folder.
        bag_map: What its topics mean.
        root: Directory the map's paths start from.

    Raises:
        BagError, RobotError: the bag, its map or the robot cannot be used.
    """
    findings = Findings()
    files = files_of(bag_path, findings)
    runs = runs_of(read_samples(files, bag_map, findings), bag_map, findings)
    bags = bags_of(runs, bag_map, findings)
    robot = _robot(bag_map, root)
    tracks = [
        track_of(bag, bag_map, robot, grid_s)
        for bag in bags
        for grid_s in _grids(bag, bag_map, findings)
    ]
    if not tracks:
        raise BagError(
            f"{bag_path} has no {bag_map.min_episode_s} s in which joints and base are "
            f"both known without a gap of {bag_map.max_gap_s} s{_spans(bags, bag_map)}"
        )
    joint_pos = [track.qpos[:, robot.qpos_adr] for track in tracks]
    joint_vel = [track.qvel[:, robot.qvel_adr] for track in tracks]
    base = [np.linalg.norm(track.qvel[:, :3], axis=1) for track in tracks]
    tell_of_speed(zip(joint_pos, joint_vel, strict=True), base, findings)
    tell_of_range(joint_pos, robot, findings)
    source = {"source": "ros2", "bag": bag_path.name, "bag_sha256": sha256_of(files)}
    parts = [
        (track, part)
        for track in tracks
        for part in _parts(len(track.qpos), bag_map, findings)
    ]
    episodes = tuple(
        _episode(track, part, bag_map, robot, source, number)
        for number, (track, part) in enumerate(parts)
    )
    return BagEpisodes(episodes, len(tracks), findings)


def _robot(bag_map: BagMap, root: Path) -> Robot:
    shipped = bag_map.robot == SHIPPED_ROBOT
    xml = None if shipped else root / bag_map.robot
    robot = load_robot(xml, physics_dt_s=bag_map.control_dt_s)
    if robot.mj_model.nq != 19:
        raise BagError(f"{robot.name} has more to it than a base and twelve joints")
    return robot


def _grids(bag: Bag, bag_map: BagMap, findings: Findings) -> Iterator[np.ndarray]:
    """The times of the states of every stretch that is long enough."""
    known = overlaps(
        split_at_gaps(bag.joint_pos.times_s, bag_map.max_gap_s),
        split_at_gaps(bag.base_pos_w.times_s, bag_map.max_gap_s),
    )
    for start_s, stop_s in known:
        grid_s = np.arange(start_s, stop_s, bag_map.control_dt_s)
        if stop_s - start_s >= bag_map.min_episode_s and len(grid_s) > 1:
            yield grid_s
        else:
            findings.leave_out("stretches shorter than min_episode_s", 1)


def _spans(bags: list[Bag], bag_map: BagMap) -> str:
    """When joints and base are known, where they never are at once."""
    spans = []
    for bag in bags:
        joints, base = bag.joint_pos.times_s, bag.base_pos_w.times_s
        if joints[0] <= base[-1] and base[0] <= joints[-1]:
            return ""
        spans.append(
            f"; {bag_map.joints.topic} is from {joints[0]:.2f} to {joints[-1]:.2f} s, "
            f"{bag_map.base.topic} from {base[0]:.2f} to {base[-1]:.2f} s"
        )
    return spans[0] + '; time = "log" in the map takes the recorder\'s clock'


def _parts(num_states: int, bag_map: BagMap, findings: Findings) -> Iterator[slice]:
    """States of each episode; one ends with the state the next begins with."""
    length = max(1, round(bag_map.episode_s * bag_map.control_hz))
    shortest = max(1, round(bag_map.min_episode_s * bag_map.control_hz))
    for first in range(0, num_states - 1, length):
        stop = min(first + length, num_states - 1)
        if stop - first >= min(shortest, num_states - 1):
            yield slice(first, stop + 1)
        else:
            findings.leave_out("steps at the end of a stretch", stop - first)


def _episode(
    track: Track,
    part: slice,
    bag_map: BagMap,
    robot: Robot,
    source: dict[str, str],
    number: int,
) -> Episode:
    num_steps = part.stop - part.start - 1

    def unknown(*shape: int) -> np.ndarray:
        return np.full(shape, np.nan, dtype=np.float32)

    # A row tells what a step led to: that of the state behind it.
    rows = track.rows[part][1:].astype(np.float32)
    extra = source | {
        "derived_features": " ".join(track.derived),
        "missing_features": " ".join(missing_features(rows)),
    }
    return Episode(
        qpos=track.qpos[part].copy(),
        qvel=track.qvel[part].copy(),
        obs=unknown(num_steps + 1, 48),
        action=unknown(num_steps, 12),
        ctrl=unknown(num_steps, 12),
        features=rows,
        reward=unknown(num_steps),
        end_reason="truncated",
        meta=EpisodeMeta(
            task=bag_map.task,
            seed=0,
            env_index=number,
            command=track.command,
            policy_sha256=source["bag_sha256"],
            policy_step=0,
            stochastic=False,
            control_dt_s=bag_map.control_dt_s,
            physics_dt_s=bag_map.control_dt_s,
            robot=robot.name,
            model_sha256=robot.model_sha256,
            extra=extra,
        ),
        mjcf=robot.mjcf,
    )
