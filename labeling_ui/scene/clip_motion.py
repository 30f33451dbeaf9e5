"""A clip ready to be shown: poses of all its states, footfalls and curves.

Shapes: S states of a clip, T steps (S - 1), I instances of the robot's meshes.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.episodes.choices import choices_of
from data.episodes.clips import Clip
from data.episodes.episode import Episode
from data.episodes.visible_habits import visible_habits
from data.errors import DatasetError
from data.features import column

from .geometry import RobotGeometry, instance_poses, multiply_wxyz, robot_geometry
from .obedience import Obeyed, obeyed, ways

Command = tuple[float, float, float]
"""Forward m/s, left m/s, yaw rad/s."""
PATH_WINDOW_S = 0.5
"""The camera follows the base averaged over this time: its bobbing stays visible."""
MAX_CLIPS = 256
"""Clips kept ready; one of 60 steps takes 25 kB."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A clip, turned and shifted so that it starts at the origin and heads along x."""

    clip: Clip
    geometry: RobotGeometry
    dt_s: float
    """Time between two states."""
    positions: np.ndarray
    """[S, I, 3] m, float32"""
    wxyzs: np.ndarray
    """[S, I, 4], float32"""
    path: np.ndarray
    """[S, 2] m, where the base is over ground, averaged over PATH_WINDOW_S."""
    task: str
    """What the robot was to do, as the episode names it."""
    commands: tuple[Command, ...]
    """What the robot was told to do, one after the other."""
    ways: tuple[np.ndarray, np.ndarray]
    """Marks of the way that it is told to go, [S, W, 3] m and wxyz [S, W, 4]."""
    obeyed: Obeyed | None
    """How far it came; None where the task knows no command."""
    fell: bool
    """The clip ends with the fall of the robot."""
    contact: np.ndarray
    """[T, 4] feet on the ground, in the order of `data.features.LEGS`; of a team those
    of the first robot."""
    speed_m_s: np.ndarray
    """[T] forward speed of the base; like what follows, of a team the mean of both."""
    height_m: np.ndarray
    """[T] height of the base."""
    torque_nm: np.ndarray
    """[T] mean magnitude over the joints."""
    gaits: tuple[tuple[str, int, int], ...]
    """Name, first step and step behind the last of each gait that a policy chose, one
    after the other; empty where it has one."""
    habits: np.ndarray
    """[H] what is seen of it, as `visible_habits` gives it."""

    @property
    def duration_s(self) -> float:
        """From the first state to the last."""
        return (len(self.positions) - 1) * self.dt_s

    def pose(self, time_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions [I, 3], attitudes [I, 4] and path [2] at `time_s`.

        Between two states it interpolates; behind the last it stays there.
        """
        row, share = self._place(time_s)
        positions = _between(self.positions, row, share)
        wxyzs = _between(self.wxyzs, row, share)
        wxyzs /= np.sqrt(np.einsum("ij,ij->i", wxyzs, wxyzs))[:, None]
        return positions, wxyzs, _between(self.path, row, share)

    def way(self, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Marks of the way it is told to go at `time_s`: [W, 3] m and wxyz [W, 4]."""
        row, share = self._place(time_s)
        positions, wxyzs = self.ways
        return _between(positions, row, share), _between(wxyzs, row, share)

    def _place(self, time_s: float) -> tuple[int, np.float32]:
        """The state before `time_s`, and how far it is to the next."""
        place = min(max(time_s / self.dt_s, 0.0), len(self.positions) - 1.0)
        row = min(int(place), len(self.positions) - 2)
        return row, np.float32(place - row)


def load_motion(dataset: Dataset, clip: Clip) -> Motion:
    """Read a clip and work out everything that is shown of it.

    Raises:
        DatasetError: the data set lacks the episode, or the episode is shorter.
        EpisodeError: the episode's file cannot be used.
    """
    episode = dataset.read(clip.rollout)
    if clip.stop > episode.num_steps:
        raise DatasetError(
            f"clip {clip.key} ends at step {clip.stop}, its episode has "
            f"{episode.num_steps}; the pairs belong to another data set"
        )
    geometry = robot_geometry(episode.mjcf)
    robots = [robot.qpos[clip.start : clip.stop + 1] for robot in episode.robots]
    qpos = robots[0]
    # Of a team, the view follows the middle of both.
    middle = np.mean([robot[:, :3] for robot in robots], axis=0)
    world = episode.world_qpos[clip.start : clip.stop + 1]
    positions, wxyzs = instance_poses(geometry, world)
    window = round(PATH_WINDOW_S / episode.meta.control_dt_s)
    floor_m = _smooth(geometry.floor_m(middle[:, :2])[:, None], window)
    positions[..., 2] -= floor_m
    turn = _heading_wxyz(qpos[0, 3:7]) * (1, 0, 0, -1)
    origin = np.array([*middle[0, :2], 0.0])
    wxyzs = multiply_wxyz(turn, wxyzs).astype(np.float32)
    dt_s = episode.meta.control_dt_s
    ground = _turned(middle - origin, turn)[:, :2]
    both = [robot.features[clip.rows] for robot in episode.robots]
    rows = both[0]
    path = _smooth(ground, window).astype(np.float32)
    told = episode.meta.task != "getup"
    heading_rad = _headings_rad(qpos[:, 3:7])
    asked = _asked(episode, rows) if told else np.zeros((len(rows), 3))
    return Motion(
        clip=clip,
        geometry=geometry,
        dt_s=dt_s,
        positions=_turned(positions - origin, turn).astype(np.float32),
        # Neighbouring states on the same half of the sphere can be averaged.
        wxyzs=_continuous(wxyzs),
        path=path,
        task=episode.meta.task,
        commands=_commands(episode, rows),
        ways=ways(path, heading_rad, asked),
        obeyed=obeyed(ground, heading_rad, asked, dt_s) if told else None,
        fell=episode.end_reason == "terminated" and clip.stop == episode.num_steps,
        contact=rows[:, column("foot_contact")] > 0.5,
        # Means are copies: a view would keep the whole episode in memory.
        speed_m_s=np.mean([own[:, column("base_lin_vel_b")][:, 0] for own in both], 0),
        height_m=np.mean([own[:, column("base_height")][:, 0] for own in both], 0),
        torque_nm=np.mean(
            [np.abs(own[:, column("joint_torque")]).mean(axis=-1) for own in both], 0
        ),
        gaits=_gaits(episode, clip),
        habits=np.mean([visible_habits(own, dt_s) for own in both], axis=0),
    )


def _gaits(episode: Episode, clip: Clip) -> tuple[tuple[str, int, int], ...]:
    said = choices_of(episode.meta.extra, episode.num_steps)
    return () if said is None else tuple(said.runs(clip.rows))


def _commands(episode: Episode, rows: np.ndarray) -> tuple[Command, ...]:
    """Commands of a clip with feature `rows`, each once for as long as it holds."""
    if not episode.meta.command_change_steps:
        return (episode.meta.command,)
    asked = rows[:, column("command")]
    first = np.r_[True, (asked[1:] != asked[:-1]).any(axis=1)]
    return tuple((forward, left, yaw) for forward, left, yaw in asked[first].tolist())


def _asked(episode: Episode, rows: np.ndarray) -> np.ndarray:
    """The command at each step [T, 3] of a clip with feature `rows`."""
    if not episode.meta.command_change_steps:
        return np.tile(np.array(episode.meta.command), (len(rows), 1))
    return rows[:, column("command")].astype(float)


def _headings_rad(base_wxyz: np.ndarray) -> np.ndarray:
    """Headings [S] of attitudes [S, 4], from 0 and without jumps."""
    w, x, y, z = base_wxyz.T
    yaw = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    return yaw - yaw[0]


class MotionCache:
    """The motions used last, shared by all visitors and threads."""

    def __init__(self, dataset: Dataset, *, max_clips: int = MAX_CLIPS) -> None:
        self._dataset = dataset
        self._max_clips = max_clips
        self._lock = threading.Lock()
        self._motions: OrderedDict[Clip, Motion] = OrderedDict()

    def get(self, clip: Clip) -> Motion:
        """The motion of `clip`, loaded if it is not there; errors as `load_motion`."""
        with self._lock:
            if clip in self._motions:
                self._motions.move_to_end(clip)
                return self._motions[clip]
        # Two threads may load the same clip, which does no harm.
        motion = load_motion(self._dataset, clip)
        with self._lock:
            self._motions[clip] = motion
            while len(self._motions) > self._max_clips:
                self._motions.popitem(last=False)
        return motion

    def of_pair(self, pair: Pair) -> tuple[Motion, Motion]:
        """The motions of both clips, a first; errors as `load_motion`."""
        return self.get(pair.a), self.get(pair.b)


def _between(rows: np.ndarray, row: int, share: np.float32) -> np.ndarray:
    here = rows[row]
    return here + share * (rows[row + 1] - here)


def _heading_wxyz(base_wxyz: np.ndarray) -> np.ndarray:
    """The part of an attitude [4] that turns about the vertical."""
    w, x, y, z = base_wxyz
    half = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) / 2
    return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])


def _turned(points: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Points [..., 3] turned by `turn` [4], which is about the vertical."""
    angle = 2 * np.arctan2(turn[3], turn[0])
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T


def _continuous(wxyzs: np.ndarray) -> np.ndarray:
    """Attitudes [S, I, 4] with no change of sign from one to the next."""
    turned = (wxyzs[1:] * wxyzs[:-1]).sum(axis=-1) < 0
    flips = np.cumprod(np.where(turned, -1, 1), axis=0)
    return np.concatenate([wxyzs[:1], wxyzs[1:] * flips[..., None]]).astype(np.float32)


def _smooth(points: np.ndarray, window: int) -> np.ndarray:
    """Points [S, d] averaged over `window` states, going on straight at the ends."""
    half = min(window // 2, len(points) - 1)
    if half < 1:
        return points
    start = 2 * points[0] - points[half:0:-1]
    end = 2 * points[-1] - points[-2 : -half - 2 : -1]
    sums = np.cumsum(
        np.concatenate([np.zeros((1, points.shape[1])), start, points, end]), axis=0
    )
    width = 2 * half + 1
    return (sums[width:] - sums[:-width]) / width
