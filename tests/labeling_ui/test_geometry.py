"""From a recorded robot to what is drawn, without a browser."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks.walks import ROBOT_XML, walk, walking_dataset
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.stances import stance_phases
from data.errors import DatasetError, EpisodeError
from labeling_ui.page.footfall_svg import curves, footfalls
from labeling_ui.scene.clip_motion import MotionCache, load_motion
from labeling_ui.scene.geometry import instance_poses, robot_geometry
from labeling_ui.scene.glb import LEFT_RGB, RIGHT_RGB, tinted, tinted_glbs
from labeling_ui.scene.solids import box, capsule, cylinder, ellipsoid, rotation_matrix

SHAPES = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="base" pos="0 0 .5"><freejoint/>
      <geom type="sphere" size=".1" rgba="1 0 0 1"/>
      <geom type="box" size=".1 .2 .3" group="3"/>
      <body name="left" pos="0 .2 0">
        <joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 .1 -.2"/>
      </body>
      <body name="right" pos="0 -.2 0">
        <joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 -.1 -.2"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    """Twelve walking episodes, every fourth ends in a fall."""
    return walking_dataset(tmp_path / "set", pairs=4)


@pytest.mark.parametrize(
    ("solid", "volume"),
    [
        (box(np.array([0.1, 0.2, 0.3])), 8 * 0.1 * 0.2 * 0.3),
        (ellipsoid(np.array([0.1, 0.2, 0.3])), 4 / 3 * np.pi * 0.1 * 0.2 * 0.3),
        (cylinder(0.1, 0.3), np.pi * 0.1**2 * 0.6),
        (capsule(0.1, 0.3), np.pi * 0.1**2 * (0.6 + 4 / 3 * 0.1)),
    ],
)
def test_solids_are_closed_and_face_outwards(solid, volume: float) -> None:
    """The signed volume is that of the shape, up to its corners; normals are units."""
    a, b, c = (solid.vertices[solid.faces[:, corner]] for corner in range(3))
    signed = (a * np.cross(b, c)).sum() / 6
    assert signed == pytest.approx(volume, rel=0.06)
    assert np.linalg.norm(solid.normals, axis=-1) == pytest.approx(1.0)
    outwards = np.einsum(
        "fi,fi->f", np.cross(b - a, c - a), solid.normals[solid.faces[:, 0]]
    )
    assert (outwards > -1e-12).all()


def test_what_is_seen_is_drawn_and_nothing_else() -> None:
    """No floor, no collision shapes; mirrored limbs share a mesh after half a turn."""
    geometry = robot_geometry(SHAPES)
    assert len(geometry.meshes) == 2
    trunk, limb = geometry.meshes
    assert [piece.rgb for piece in trunk.pieces] == [(1.0, 0.0, 0.0)]
    assert limb.body_ids == (2, 3)
    assert limb.body_wxyz[1].tolist() == [0.0, 0.0, 0.0, 1.0]


def test_instances_lie_where_mujoco_puts_the_geoms() -> None:
    """Also those of a mesh that is a half turn of another."""
    geometry = robot_geometry(SHAPES)
    rng = np.random.default_rng(0)
    qpos = np.array([0.3, -0.2, 0.6, 1, 0, 0, 0, 0, 0], dtype=float)
    qpos[3:] += 0.3 * rng.standard_normal(6)
    qpos[3:7] /= np.linalg.norm(qpos[3:7])
    positions, wxyzs = instance_poses(geometry, qpos[None])
    mj_data = mujoco.MjData(geometry.mj_model)
    mj_data.qpos[:] = qpos
    mujoco.mj_kinematics(geometry.mj_model, mj_data)
    for instance, geom in ((1, 3), (2, 4)):
        middle = geometry.meshes[1].pieces[0].solid.vertices.mean(axis=0)
        turned = rotation_matrix(wxyzs[0, instance]) @ middle
        found = positions[0, instance] + turned
        assert found == pytest.approx(mj_data.geom_xpos[geom], abs=1e-5)


def test_the_shipped_robot_is_five_meshes() -> None:
    """Trunk, hip, calf and two thighs, which are mirror images."""
    geometry = robot_geometry(ROBOT_XML.read_text())
    assert sorted(len(mesh.body_ids) for mesh in geometry.meshes) == [1, 2, 2, 4, 4]
    assert sum(map(len, tinted_glbs(geometry, LEFT_RGB))) < 500_000


def test_both_sides_keep_dark_parts_dark() -> None:
    """A and B differ in their light parts only, and visibly."""
    shell, rubber = (0.9, 0.91, 0.92), (0.09, 0.09, 0.1)
    left, right = tinted(shell, LEFT_RGB), tinted(shell, RIGHT_RGB)
    assert left[2] > left[0] + 0.4
    assert right[0] > right[2] + 0.4
    assert max(tinted(rubber, LEFT_RGB)) < 0.2


def test_a_robot_that_cannot_be_drawn_says_so() -> None:
    with pytest.raises(EpisodeError, match="does not compile"):
        robot_geometry("<mujoco><nonsense/></mujoco>")
    with pytest.raises(EpisodeError, match="no shape that can be drawn"):
        robot_geometry("<mujoco/>")


def test_a_motion_starts_at_the_origin_and_heads_along_x(dataset: Dataset) -> None:
    """Whatever its place and heading in the episode."""
    sha256 = next(e.sha256 for e in dataset.entries() if e.end_reason == "truncated")
    motion = load_motion(dataset, Clip(sha256, 100, 60))
    assert len(motion.positions) == 61
    assert motion.positions[0, 0, :2] == pytest.approx(0.0, abs=1e-6)
    assert motion.path[-1, 0] == pytest.approx(0.6, abs=0.01)
    assert not motion.fell


def test_behind_its_end_a_clip_holds_its_last_pose(dataset: Dataset) -> None:
    """And a clip that ends with the episode's fall is known to fall."""
    entry = next(e for e in dataset.entries() if e.end_reason == "terminated")
    motion = load_motion(dataset, Clip(entry.sha256, entry.num_steps - 30, 30))
    assert motion.fell
    late, wxyzs, _ = motion.pose(5.0)
    assert late == pytest.approx(motion.positions[-1])
    assert np.linalg.norm(wxyzs, axis=-1) == pytest.approx(1.0, abs=1e-5)
    assert not load_motion(dataset, Clip(entry.sha256, 0, 30)).fell


def test_between_two_states_a_pose_is_between(dataset: Dataset) -> None:
    motion = load_motion(dataset, Clip(dataset.entries()[0].sha256, 0, 40))
    middle, _, _ = motion.pose(0.01)
    assert middle == pytest.approx(motion.positions[:2].mean(axis=0), abs=1e-6)


def test_a_motion_keeps_nothing_else_of_its_episode(dataset: Dataset) -> None:
    """Hundreds are kept ready, and an episode is many times as long."""
    motion = load_motion(dataset, Clip(dataset.entries()[0].sha256, 0, 40))
    arrays = [value for value in vars(motion).values() if isinstance(value, np.ndarray)]
    assert len(arrays) == 8
    for array in arrays:
        owner = array if array.base is None else array.base
        assert owner.nbytes <= 4 * array.nbytes


def test_the_cache_forgets_what_was_used_longest_ago(dataset: Dataset) -> None:
    cache = MotionCache(dataset, max_clips=2)
    sha256 = dataset.entries()[0].sha256
    first, *others = [Clip(sha256, start, 20) for start in (0, 20, 40)]
    motion = cache.get(first)
    assert cache.get(first) is motion
    for clip in others:
        cache.get(clip)
    assert cache.get(first) is not motion


def test_a_clip_beyond_its_episode_is_named(dataset: Dataset) -> None:
    clip = Clip(dataset.entries()[0].sha256, 0, 100_000)
    with pytest.raises(DatasetError, match="ends at step 100000"):
        load_motion(dataset, clip)


def test_footfalls_show_stance_and_fall(dataset: Dataset) -> None:
    """Steps 1 and 2 of four are one bar; only the clip that falls has a red end."""
    assert stance_phases(np.array([0, 1, 1, 0])) == [(1, 3)]
    assert stance_phases(np.ones(3)) == [(0, 3)]
    fallen = next(e for e in dataset.entries() if e.end_reason == "terminated")
    good = next(e for e in dataset.entries() if e.end_reason == "truncated")
    left = load_motion(dataset, Clip(fallen.sha256, fallen.num_steps - 30, 30))
    right = load_motion(dataset, Clip(good.sha256, 0, 60))
    assert footfalls(left, right, 1.2).count("falls here") == 1
    assert curves(left, right, 1.2).count("<polyline") == 6


def test_a_synthetic_walk_is_a_valid_episode() -> None:
    assert walk(50, seed=0, fell=True).features[-1].sum() > 0
