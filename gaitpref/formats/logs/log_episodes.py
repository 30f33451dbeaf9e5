"""From what a log says to episodes at the control rate.

Shapes: N states of an episode.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.episodes.episode import Episode
from data.episodes.resample import overlaps, split_at_gaps
from data.files.files import sha256_bytes, sha256_file
from data.files.telling import Tell, silent
from policy.robots.robot import Robot, load_robot

from .as_episode import as_episode
from .doubts import tell_of_range, tell_of_speed
from .leg_odometry import with_base_from_legs
from .log_findings import Findings
from .log_map import SHIPPED_ROBOT, LogError, LogMap
from .recording import Recording
from .track import Track, track_of


@dataclass(frozen=True, eq=False)
class LogEpisodes:
    """What came out of a log, and what did not."""

    episodes: tuple[Episode, ...]
    stretches: int
    """Stretches of time in which joints and base are known, long enough to be used."""
    findings: Findings


def log_episodes(
    recordings: Sequence[Recording],
    log_map: LogMap,
    robot: Robot,
    findings: Findings,
    *,
    source: dict[str, str],
    tell: Tell = silent,
) -> LogEpisodes:
    """Every stretch of a log in which joints and base are known.

    Args:
        recordings: What the log says, one for each run of its clock.
        log_map: What it is resampled to.
        robot: As `robot_of` gives it.
        findings: Told what is left out and looks odd.
        source: Kept with every episode; `log` names it, `log_sha256` is its hash.
        tell: Gets the stretches that are worked out.

    Raises:
        LogError: nothing of it can be used.
    """
    known = [
        recording
        if recording.base_pos_w is not None and recording.base_wxyz is not None
        else with_base_from_legs(recording, log_map, robot, findings)
        for recording in recordings
    ]
    stretches = [
        (recording, grid_s)
        for recording in known
        for grid_s in _grids(recording, log_map, findings)
    ]
    tracks: list[Track] = []
    for recording, grid_s in stretches:
        tell(len(tracks), len(stretches))
        tracks.append(track_of(recording, log_map, robot, grid_s))
    if not tracks:
        raise LogError(
            f"{source['log']} has no {log_map.min_episode_s} s in which joints and "
            f"base are both known without a gap of {log_map.max_gap_s} s"
            f"{_spans(known, log_map)}"
        )
    joint_pos = [track.qpos[:, robot.qpos_adr] for track in tracks]
    joint_vel = [track.qvel[:, robot.qvel_adr] for track in tracks]
    base = [np.linalg.norm(track.qvel[:, :3], axis=1) for track in tracks]
    tell_of_speed(zip(joint_pos, joint_vel, strict=True), base, findings)
    tell_of_range(joint_pos, robot, findings)
    parts = [
        (track, part)
        for track in tracks
        for part in _parts(len(track.qpos), log_map, findings)
    ]
    episodes = tuple(
        _episode(track, part, log_map, robot, source, number)
        for number, (track, part) in enumerate(parts)
    )
    return LogEpisodes(episodes, len(tracks), findings)


def source_of(kind: str, log: Path, files: Sequence[Path]) -> dict[str, str]:
    """What is kept of a log: its kind, its name, and the hash of its file, or of the
    hashes of its files."""
    hashes = [sha256_file(path) for path in files]
    joined = "\n".join(hashes).encode()
    sha256 = hashes[0] if len(hashes) == 1 else sha256_bytes(joined)
    return {"source": kind, "log": log.name, "log_sha256": sha256}


def robot_of(log_map: LogMap, root: Path) -> Robot:
    """The robot that a map in the directory `root` names.

    Raises:
        LogError, RobotError: there is none, or it is more than a quadruped.
    """
    shipped = log_map.robot == SHIPPED_ROBOT
    xml = None if shipped else root / log_map.robot
    robot = load_robot(xml, physics_dt_s=log_map.control_dt_s)
    if robot.mj_model.nq != 19:
        raise LogError(f"{robot.name} has more to it than a base and twelve joints")
    return robot


def _grids(
    recording: Recording, log_map: LogMap, findings: Findings
) -> Iterator[np.ndarray]:
    """The times of the states of every stretch that is long enough."""
    assert recording.base_pos_w is not None
    known = overlaps(
        split_at_gaps(recording.joint_pos.times_s, log_map.max_gap_s),
        split_at_gaps(recording.base_pos_w.times_s, log_map.max_gap_s),
    )
    for start_s, stop_s in known:
        # The last sample is a state too, however its time is rounded.
        count = int((stop_s - start_s) * log_map.control_hz + 0.01) + 1
        grid_s = start_s + np.arange(count) * log_map.control_dt_s
        if stop_s - start_s >= log_map.min_episode_s and len(grid_s) > 1:
            yield grid_s
        else:
            findings.leave_out("stretches shorter than min_episode_s", 1)


def _spans(recordings: Sequence[Recording], log_map: LogMap) -> str:
    """When joints and base are known, where they never are at once."""
    spans = []
    for recording in recordings:
        assert recording.base_pos_w is not None
        joints, base = recording.joint_pos.times_s, recording.base_pos_w.times_s
        if joints[0] <= base[-1] and base[0] <= joints[-1]:
            return ""
        spans.append(
            f"; {log_map.joints.topic} is from {joints[0]:.2f} to {joints[-1]:.2f} s, "
            f"{log_map.base_topic} from {base[0]:.2f} to {base[-1]:.2f} s"
        )
    return spans[0] + '; time = "log" in the map takes the recorder\'s clock'


def _parts(num_states: int, log_map: LogMap, findings: Findings) -> Iterator[slice]:
    """States of each episode; one ends with the state the next begins with."""
    length = max(1, round(log_map.episode_s * log_map.control_hz))
    shortest = max(1, round(log_map.min_episode_s * log_map.control_hz))
    for first in range(0, num_states - 1, length):
        stop = min(first + length, num_states - 1)
        if stop - first >= min(shortest, num_states - 1):
            yield slice(first, stop + 1)
        else:
            findings.leave_out("steps at the end of a stretch", stop - first)


def _episode(
    track: Track,
    part: slice,
    log_map: LogMap,
    robot: Robot,
    source: dict[str, str],
    number: int,
) -> Episode:
    return as_episode(
        robot,
        track.qpos[part],
        track.qvel[part],
        track.rows[part],
        dt_s=log_map.control_dt_s,
        command=track.command,
        task=log_map.task,
        number=number,
        sha256=source["log_sha256"],
        extra=source
        | {
            "derived_features": " ".join(track.derived),
            "estimated_features": " ".join(track.estimated),
        },
    )
