"""Ground that is not flat: heights, falls and feet are those over the ground below."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.features import column
from data.files.plain import from_plain, to_plain
from data.ground import Ground
from gaitpref.cli.commands.looking.play import live_policy
from gaitpref.cli.main import main
from labeling_ui.scene.clip_motion import load_motion
from labeling_ui.scene.live_robot import Drive
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import RANDOMISE, EnvCfg
from policy.env.randomise import make_env
from policy.env.terrain import EDGE_M, TerrainCfg, heights, on_terrain, turned
from policy.robots.robot import Robot, load_robot, load_robot_xml
from policy.sim.chosen import Listed
from policy.training.checkpoint import load_policy
from tests.helpers.foreign_robots import Drawing, mjcf

KINDS = ("slopes", "steps", "rough")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=EnvCfg().physics_dt_s)


def _env(robot: Robot, num_envs: int, **terrain: object) -> QuadrupedEnv:
    cfg = EnvCfg(terrain=TerrainCfg(**terrain))  # type: ignore[arg-type]
    return QuadrupedEnv(robot, cfg, num_envs, seed=0)


def _put(env: QuadrupedEnv, x_m: float, y_m: float, above_m: float) -> None:
    """Put the only robot there, level and at rest, this far above its ground."""
    assert env.robot.ground is not None
    qpos = torch.from_numpy(env.robot.home_qpos.copy())[None]
    qpos[0, :2] = torch.tensor([x_m, y_m])
    ground_m = float(env.robot.ground.height_m(np.array([x_m, y_m])))
    qpos[0, 2] = ground_m + above_m
    nv = env.robot.mj_model.nv
    env.sim.reset(
        Listed(torch.tensor([0])), qpos, torch.zeros(1, nv, dtype=torch.float64)
    )


def test_flat_is_the_robot_itself_and_its_files_are_as_before(robot: Robot) -> None:
    """Without terrain, nothing is changed, added or written down."""
    assert on_terrain(robot, TerrainCfg()) is robot
    assert robot.ground is None
    assert "terrain" not in to_plain(EnvCfg())
    hills = EnvCfg(terrain=TerrainCfg(kind="slopes", seed=3))
    assert from_plain(EnvCfg, json.loads(json.dumps(to_plain(hills)))) == hills
    assert from_plain(EnvCfg, to_plain(EnvCfg())) == EnvCfg()


@pytest.mark.parametrize("kind", KINDS)
def test_the_ground_is_where_a_falling_ray_meets_it(robot: Robot, kind: str) -> None:
    """Our heights are those that MuJoCo collides with, between the points too."""
    made = on_terrain(robot, TerrainCfg(kind=kind, seed=1))  # type: ignore[arg-type]
    assert made.ground is not None
    mj_data = mujoco.MjData(made.mj_model)
    mujoco.mj_forward(made.mj_model, mj_data)
    hit = np.zeros(1, dtype=np.int32)
    points = np.random.default_rng(0).uniform(-5.9, 5.9, (200, 2))
    found = [
        3.0
        - mujoco.mj_ray(
            made.mj_model,
            mj_data,
            np.array([*point, 3.0]),
            np.array([0.0, 0.0, -1.0]),
            None,
            1,
            made.base_body_id,
            hit,
        )
        for point in points
    ]
    on_robot = np.abs(points).max(axis=1) < 0.5
    expected = made.ground.height_m(points)
    assert np.array(found)[~on_robot] == pytest.approx(expected[~on_robot], abs=1e-9)
    assert np.ptp(expected) > 0.02


def test_heights_are_what_was_asked_for() -> None:
    """Slopes no steeper, steps of one height, rubble within its size; equal seeds."""
    slopes = heights(TerrainCfg(kind="slopes", slope_rad=0.3))
    down_y, down_x = np.gradient(slopes, 0.1)
    assert np.arctan(np.hypot(down_x, down_y).max()) == pytest.approx(0.3, abs=1e-6)
    steps = heights(TerrainCfg(kind="steps", step_m=0.06)) / 0.06
    assert np.abs(steps - steps.round()).max() < 1e-9
    assert len(np.unique(steps.round())) >= 3
    assert np.ptp(heights(TerrainCfg(kind="rough", rough_m=0.03))) <= 0.03
    twice = heights(TerrainCfg(kind="steps", step_m=0.06), taller=2.0)
    assert twice == pytest.approx(steps * 0.12)
    cfg = TerrainCfg(kind="rough", seed=4)
    assert np.array_equal(heights(cfg), heights(cfg))
    assert not np.array_equal(heights(cfg), heights(replace(cfg, seed=5)))


def test_a_robot_on_a_slope_reads_its_height_over_the_ground(robot: Robot) -> None:
    """High on a hill and low in a valley, the standing robot has the same row."""
    env = _env(robot, 1, kind="slopes", slope_rad=0.1)
    ground = env.robot.ground
    assert ground is not None
    place = np.stack(np.meshgrid(*[np.linspace(-4, 4, 81)] * 2), axis=-1)
    level = ground.height_m(place)
    for index in (level.argmax(), level.argmin()):
        x_m, y_m = place.reshape(-1, 2)[index]
        _put(env, x_m, y_m, float(robot.home_qpos[2]) + 0.01)
        row = torch.zeros(1)
        for _ in range(40):
            _, _, dones, extras = env.step(torch.zeros(1, 12))
            assert not dones.any()
            row = extras["features"][0]
        base_w = env.sim.read().base_pos_w[0]
        assert row[column("base_height")][0] == pytest.approx(0.26, abs=0.015)
        assert abs(float(base_w[2]) - 0.26) > 0.05
        assert row[column("foot_contact")].sum() >= 3
        assert row[column("foot_height")].abs().max() < 0.01


def test_falls_are_judged_over_the_step_below(robot: Robot) -> None:
    """Standing in a pit is no fall, lying on a terrace is one."""
    env = _env(robot, 1, kind="steps", step_m=0.2, tread_m=0.6)
    ground = env.robot.ground
    assert ground is not None
    place = np.stack(np.meshgrid(*[np.linspace(-4, 4, 41)] * 2), axis=-1)
    around = np.stack(
        [place + off for off in np.mgrid[-3:4, -3:4].reshape(2, -1).T / 10]
    )
    even = np.ptp(ground.height_m(around), axis=0) < 1e-3
    level = np.where(even, ground.height_m(place), np.nan)
    pit, terrace = (
        place.reshape(-1, 2)[index].tolist()
        for index in (np.nanargmin(level), np.nanargmax(level))
    )
    assert np.nanmax(level) - np.nanmin(level) > 0.35
    _put(env, pit[0], pit[1], float(robot.home_qpos[2]))
    extras = env.step(torch.zeros(1, 12))[3]
    # The base is lower than a fallen one would be on flat ground at 0.
    assert env.sim.read().base_pos_w[0, 2] < 0.127
    assert not extras["fallen"].any()
    _put(env, terrace[0], terrace[1], 0.09)
    assert env.sim.read().base_pos_w[0, 2] > 0.25
    assert env.step(torch.zeros(1, 12))[3]["fallen"].all()


@pytest.mark.parametrize("kind", KINDS)
def test_robots_start_all_over_the_field_on_their_feet(robot: Robot, kind: str) -> None:
    """No foot starts in the ground or far above it, and all face the middle."""
    env = _env(robot, 64, kind=kind)
    state = env.sim.read()
    at_m = state.base_pos_w[:, :2]
    assert (at_m.std(dim=0) > 1.5).all()
    clear_m = state.foot_height - torch.tensor(robot.foot_radius)
    assert clear_m.min() > -0.02
    assert clear_m.median() < 0.06
    w, x, y, z = state.base_wxyz_w.unbind(-1)
    yaw = torch.atan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
    ahead = torch.stack([yaw.cos(), yaw.sin()], dim=-1)
    assert ((ahead * at_m).sum(dim=-1) < 0).float().mean() > 0.9
    for _ in range(10):
        env.step(torch.zeros(64, 12))
    assert env.sim.read().foot_contact.sum(dim=-1).mean() > 2.0


def test_the_edge_ends_an_episode_like_a_time_out(robot: Robot) -> None:
    """Who comes near it is bootstrapped, has not fallen, and starts elsewhere."""
    env = _env(robot, 1, kind="rough")
    _put(env, 6.0 - EDGE_M + 0.05, 0.0, float(robot.home_qpos[2]) + 0.03)
    _, _, dones, extras = env.step(torch.zeros(1, 12))
    assert dones.all()
    assert extras["time_outs"].all()
    assert not extras["fallen"].any()
    assert extras["features"][0, column("fallen")] == 0
    assert env.sim.read().base_pos_w[0, :2].abs().max() <= 6.0 - EDGE_M
    _put(env, 0.0, 0.0, float(robot.home_qpos[2]) + 0.03)
    assert not env.step(torch.zeros(1, 12))[2].any()


def test_a_robot_of_others_gets_larger_steps_on_its_own_floor() -> None:
    """The field takes the floor's place, with its name, friction and contacts."""
    plane = (
        '<geom name="lawn" type="plane" size="0 0 1" friction="0.5" '
        'contype="2" conaffinity="4"/>'
    )
    stranger = load_robot_xml(
        mjcf(Drawing(floor=plane)), name="stranger", physics_dt_s=0.005
    )
    made = on_terrain(stranger, TerrainCfg(kind="steps"))
    lawn = made.mj_model.geom("lawn")
    assert lawn.type[0] == mujoco.mjtGeom.mjGEOM_HFIELD
    assert lawn.friction[0] == 0.5
    assert made.ground is not None
    rises = np.diff(np.unique(made.ground.heights_m.round(4)))
    taller = float(stranger.home_qpos[2]) / 0.2945
    assert rises == pytest.approx(TerrainCfg().step_m * taller, rel=0.03)
    env = QuadrupedEnv(stranger, EnvCfg(terrain=TerrainCfg(kind="steps")), 4, seed=0)
    rows = torch.zeros(0)
    for _ in range(20):
        rows = env.step(torch.zeros(4, 12))[3]["features"]
    assert rows[:, column("foot_contact")].sum(dim=-1).min() >= 2


def test_robots_that_differ_walk_on_terrain_too(robot: Robot) -> None:
    """The critic's own group measures over the ground as well."""
    cfg = EnvCfg(
        terrain=TerrainCfg(kind="slopes"), randomise=RANDOMISE["full"], episode_s=0.4
    )
    env = make_env(robot, cfg, 8, seed=0)
    for _ in range(25):
        assert env.step(torch.zeros(8, 12))[3]["features"].isfinite().all()
    obs = env.get_observations()
    assert obs["privileged"][:, 48].min() > 0.1
    assert obs["privileged"][:, 48].max() < 0.35


def test_policies_recordings_and_evaluations_keep_to_their_terrain(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Trained on steps: recorded, evaluated and played on steps, and it says so."""
    out, root = tmp_path / "run", tmp_path / "set"
    arguments = ["--reward", "task", "--envs", "8", "--steps", "192"]
    assert main(["train", "--out", str(out), *arguments, "--terrain", "steps"]) == 0
    policy = load_policy(out / "policy.pt")
    assert policy.info.env.terrain.kind == "steps"
    assert policy.robot().ground is None
    arguments = ["--policy", str(out / "policy.pt")]
    assert main(["record", *arguments, "--dataset", str(root), "--episodes", "2"]) == 0
    entry = Dataset.open(root).entries()[0]
    assert entry.meta.extra["terrain"] == "steps"
    stored = Dataset.open(root).read(entry.sha256)
    seen = load_robot_xml(stored.mjcf, name="go1", physics_dt_s=0.005)
    assert seen.ground is not None
    motion = load_motion(Dataset.open(root), Clip(entry.sha256, 0, stored.num_steps))
    trunk = list(motion.geometry.instance_body_ids).index(seen.base_body_id)
    drawn_m = motion.positions[1:, trunk, 2]
    assert (drawn_m > motion.height_m - 0.02).all()
    assert (drawn_m < motion.height_m + 3 * policy.info.env.terrain.step_m).all()
    capsys.readouterr()
    results = []
    for terrain in ([], ["--terrain", "flat"]):
        main(["evaluate", *arguments, *terrain, "--episodes", "2", "--json"])
        results.append(json.loads(capsys.readouterr().out))
    assert results[0] != results[1]
    step = live_policy(out / "policy.pt", None).new_step()
    state = step(Drive(command=(0.3, 0.0, 0.0)))
    assert 0.15 < state.height_m < 0.35


def test_attitudes_are_turned_about_the_axes_of_the_world() -> None:
    """Half a right angle about z, then about x: checked against MuJoCo."""
    tilted = torch.tensor([[math.cos(0.2), 0.0, math.sin(0.2), 0.0]]).double()
    for axis in range(3):
        by, found = np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(by, np.eye(3)[axis], 0.7)
        mujoco.mju_mulQuat(found, by, tilted[0].numpy())
        mine = turned(tilted, torch.tensor([0.7]).double(), axis=axis)
        assert mine[0].numpy() == pytest.approx(found)


def test_a_field_of_one_row_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 2 x 2 heights, got shape"):
        Ground(heights_m=np.zeros((1, 5)), corner_m=(0, 0), cell_m=(1, 1))
    with pytest.raises(ValueError, match="step_m must be positive"):
        TerrainCfg(step_m=0.0)
