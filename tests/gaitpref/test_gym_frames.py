"""Pictures of the environment, in processes of their own: MuJoCo chooses once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from data.errors import GaitprefError
from gaitpref.adapters.gym_registration import ENV_ID

PICTURES = """
import gymnasium, numpy as np, gaitpref
envs = gymnasium.make("gaitpref/Quadruped-v0", render_mode="rgb_array")
assert envs.metadata["render_fps"] == 50
envs.reset(seed=0)
first = envs.render()
for _ in range(25):
    envs.step(np.ones(12, np.float32))
assert first.dtype == np.uint8 and first.shape[2] == 3 and first.std() > 5
assert np.abs(first.astype(float) - envs.render()).mean() > 1
envs.close()
many = gymnasium.make_vec("gaitpref/Quadruped-v0", num_envs=2, render_mode="rgb_array")
many.reset(seed=0)
pictures = many.render()
assert len(pictures) == 2 and pictures[0].shape == first.shape
many.close()
"""
VIDEO = """
import gymnasium, numpy as np, gaitpref
from gymnasium.wrappers import RecordVideo
env = gymnasium.make("gaitpref/Quadruped-v0", render_mode="rgb_array")
env = RecordVideo(env, "videos", video_length=10)
env.reset(seed=0)
for _ in range(12):
    env.step(np.zeros(12, np.float32))
env.close()
"""


def run(program: str, folder: Path, gl: str) -> subprocess.CompletedProcess[str]:
    """Run in a process in which MuJoCo draws by `gl`."""
    root = str(Path(__file__).resolve().parents[2])
    paths = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env=os.environ | {"MUJOCO_GL": gl, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def drawing() -> str:
    """The way to draw without a screen that works here."""
    robot = (
        "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'))"
    )
    for gl in ("egl", "osmesa"):
        if run(robot, Path.cwd(), gl).returncode == 0:
            return gl
    pytest.skip("there is no offscreen renderer here")


def test_there_are_pictures_of_one_robot_and_of_many(
    tmp_path: Path, drawing: str
) -> None:
    done = run(PICTURES, tmp_path, drawing)
    assert done.returncode == 0, done.stderr


def test_record_video_writes_a_film(tmp_path: Path, drawing: str) -> None:
    pytest.importorskip("moviepy", reason="Gymnasium's RecordVideo needs moviepy")
    done = run(VIDEO, tmp_path, drawing)
    assert done.returncode == 0, done.stderr
    (film,) = (tmp_path / "videos").glob("*.mp4")
    assert film.stat().st_size > 1000


def test_where_nothing_can_draw_it_is_said(tmp_path: Path) -> None:
    program = PICTURES.partition("assert")[0]
    done = run(program, tmp_path, "disable")
    assert done.returncode == 1
    assert "draws no pictures" in done.stderr.splitlines()[-1]
    assert "MUJOCO_GL=disable" in done.stderr.splitlines()[-1]


def test_another_way_to_render_is_refused() -> None:
    with pytest.raises(GaitprefError, match="gaitpref play"):
        gymnasium.make_vec(ENV_ID, num_envs=1, render_mode="human")


@pytest.mark.parametrize("shape", [(11,), (1, 12), ()])
def test_an_action_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    env = gymnasium.make(ENV_ID).unwrapped
    env.reset(seed=0)
    with pytest.raises(GaitprefError, match=r"actions must have shape \(1, 12\)"):
        env.step(np.zeros(shape, np.float32))
