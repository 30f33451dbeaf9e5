"""`gaitpref data view`: what viewers are given of stored clips."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from tests.helpers.motion import trotting_dataset

reader = pytest.importorskip("mcap_ros2.reader", reason="needs the extra `view`")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return trotting_dataset(tmp_path_factory.mktemp("set"))


def view(dataset: Dataset, out: Path, *what: str) -> dict[str, list]:
    """Run the command; gives time in s and message by topic."""
    root = ["--dataset", str(dataset.root)]
    assert main(["data", "view", *root, *what, "--out", str(out)]) == 0
    found: dict[str, list] = {}
    for message in reader.read_ros2_messages(out):
        rows = found.setdefault(message.channel.topic, [])
        rows.append((message.log_time_ns / 1e9, message.ros_msg))
    return found


def test_a_model_beside_the_episodes_is_drawn_as_one_inside(
    dataset: Dataset, tmp_path: Path
) -> None:
    """The viewer's file is the same, and needs no data set."""
    apart = trotting_dataset(tmp_path / "apart", models_apart=True)
    assert all(entry.mjcf_sha256 for entry in apart.entries())
    files = []
    for number, each in enumerate((dataset, apart)):
        entry = each.entries()[0]
        files.append(tmp_path / f"{number}.mcap")
        view(each, files[-1], "--episode", entry.sha256[:12])
    assert files[0].stat().st_size > 10_000
    found = []
    for file in files:
        read = reader.read_ros2_messages(file)
        found.append([(m.channel.topic, str(m.ros_msg)) for m in read])
    assert found[0] == found[1]


def test_both_clips_of_a_pair_run_side_by_side(
    dataset: Dataset, tmp_path: Path
) -> None:
    """From time 0, 1.2 m apart, both heading along x, with their own numbers."""
    with dataset.answers_copy() as store:
        pair = store.pairs()[0]
    found = view(dataset, tmp_path / "pair.mcap", "--pair", pair.pair_id[:12])
    topics = {f"/{side}/{kind}" for side in "ab" for kind in ("tf", "scene", "scalars")}
    assert set(found) == topics
    for side, clip, lateral_m in (("a", pair.a, 0.6), ("b", pair.b, -0.6)):
        episode = dataset.read(clip.rollout)
        poses = found[f"/{side}/tf"]
        assert [time for time, _ in poses] == pytest.approx(np.arange(41) * 0.02)
        bases = [message.transforms[0] for _, message in poses]
        assert bases[0].child_frame_id == f"{side}/trunk"
        assert bases[0].header.frame_id == "world"
        places = [(b.transform.translation.x, b.transform.translation.y) for b in bases]
        travelled = episode.qpos[clip.start : clip.stop + 1, 0]
        expected = np.stack([travelled - travelled[0], np.full(41, lateral_m)], axis=-1)
        assert places == pytest.approx(expected)
        times = [time for time, _ in found[f"/{side}/scalars"]]
        assert times == pytest.approx(np.arange(1, 41) * 0.02)
        heights = [message.base_height for _, message in found[f"/{side}/scalars"]]
        assert heights == pytest.approx(
            episode.qpos[clip.start + 1 :, 2][:40], abs=1e-6
        )
        ((time, scene),) = found[f"/{side}/scene"]
        frames = {t.child_frame_id for t in poses[0][1].transforms}
        assert time == 0
        assert {marker.header.frame_id for marker in scene.markers} <= frames
        assert len(scene.markers) > 20


def test_every_body_is_where_mujoco_has_it(dataset: Dataset, tmp_path: Path) -> None:
    """A whole episode, found by the first letters of its hash."""
    entry = dataset.entries()[0]
    found = view(dataset, tmp_path / "e.mcap", "--episode", entry.sha256[:8])
    assert set(found) == {"/robot/tf", "/robot/scene", "/robot/scalars"}
    episode = dataset.read(entry.sha256)
    mj_model = mujoco.MjModel.from_xml_string(episode.mjcf)
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:] = episode.qpos[7]
    mujoco.mj_kinematics(mj_model, mj_data)
    start = episode.qpos[0, :2]
    for body, transform in enumerate(found["/robot/tf"][7][1].transforms, 1):
        place, turn = transform.transform.translation, transform.transform.rotation
        expected = mj_data.xpos[body] - (*start, 0.0)
        assert (place.x, place.y, place.z) == pytest.approx(expected, abs=1e-9)
        wxyz = (turn.w, turn.x, turn.y, turn.z)
        assert wxyz == pytest.approx(mj_data.xquat[body], abs=1e-9)


def test_the_layout_names_topics_that_are_there(
    dataset: Dataset, tmp_path: Path
) -> None:
    """Every curve is a field of a message, every panel has a place."""
    with dataset.answers_copy() as store:
        pair = store.pairs()[0]
    found = view(dataset, tmp_path / "pair.mcap", "--pair", pair.pair_id)
    layout = json.loads((tmp_path / "pair.layout.json").read_text())
    curves = 0
    for name, panel in layout["configById"].items():
        assert name in json.dumps(layout["layout"])
        for path in panel.get("paths", ()):
            topic, _, field = path["value"].partition(".")
            assert isinstance(getattr(found[topic][0][1], field), float)
            curves += 1
    assert curves == 14


def test_rerun_converts_the_file(dataset: Dataset, tmp_path: Path) -> None:
    """The program of the package index reads it to the end, transforms and all."""
    # Beside the interpreter: an environment that is not activated is on no PATH.
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent))
    if importlib.util.find_spec("rerun") is None or rerun is None:
        pytest.skip("needs rerun-sdk, which is not installed")
    with dataset.answers_copy() as store:
        pair = store.pairs()[0]
    view(dataset, tmp_path / "pair.mcap", "--pair", pair.pair_id)
    out = tmp_path / "pair.rrd"
    converted = subprocess.run(
        [rerun, "mcap", "convert", tmp_path / "pair.mcap", "-o", out],
        capture_output=True,
        text=True,
        env={"PATH": str(Path(rerun).parent), "HOME": str(tmp_path)},
    )
    assert converted.returncode == 0, converted.stderr
    assert "error" not in converted.stderr.lower()
    printed = subprocess.run(
        [rerun, "rrd", "print", "-vv", out], capture_output=True, text=True
    )
    assert "Transform3D" in printed.stdout
    assert "base_height" in printed.stdout


def test_what_cannot_be_shown_is_said(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither or both, and an id that fits none or several."""
    root = [
        "data",
        "view",
        "--dataset",
        str(dataset.root),
        "--out",
        str(tmp_path / "x"),
    ]
    for what, message in (
        ([], "either --pair ID or --episode ID"),
        (["--pair", "p", "--episode", "e"], "either --pair ID or --episode ID"),
        (["--pair", "zz"], "0 pairs of"),
        (["--episode", ""], "3 episodes of"),
    ):
        assert main([*root, *what]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
