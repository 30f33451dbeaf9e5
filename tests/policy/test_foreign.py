"""Robots that others drew: whatever can be found is found, the rest is asked for."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from data.features import LEGS
from policy.env.env_cfg import CommandCfg
from policy.env.velocity_commands import commands_for
from policy.robots.robot import Robot, RobotError, load_robot, load_robot_xml
from tests.helpers.foreign_robots import Drawing, mjcf

DT_S = 0.005
MESH_OBJ = (
    "v 0 0 0\nv .03 0 0\nv 0 .02 0\nv 0 0 .05\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
)

DRAWINGS = {
    "motors": Drawing(),
    "geared": Drawing(actuator="geared"),
    "no actuators": Drawing(actuator="none"),
    "position": Drawing(actuator="position"),
    "filtered": Drawing(actuator="filtered"),
    "other order": Drawing(order=("rr", "fr", "rl", "fl")),
    "other signs": Drawing(sign=-1.0),
    "no limits": Drawing(limits=False),
    "legs to the side": Drawing(folded=True),
    "no floor": Drawing(floor=""),
    "a floor for others": Drawing(floor='<geom type="plane" size="0 0 1"/>'),
    "stairs": Drawing(
        floor='<geom type="plane" size="0 0 1"/>'
        '<body pos="0.2 0 0"><geom type="box" size="0.2 1 0.3"/></body>'
    ),
    "height field": Drawing(
        assets='<asset><hfield name="hills" nrow="2" ncol="2" size="5 5 1 0.1" '
        'elevation="0 1 1 0"/></asset>',
        floor='<geom type="hfield" hfield="hills"/>',
    ),
    "capsule feet": Drawing(
        foot='<geom type="capsule" size="0.02" fromto="0 0 -.1 0 0 -.25"/>'
    ),
    "an arm": Drawing(
        extra='<body name="arm" pos="0.2 0 0.1"><joint name="elbow" axis="0 1 0"/>'
        '<geom class="robot_seen" type="capsule" size=".02" fromto="0 0 0 .2 0 0"/>'
        "</body>",
        more='<sensor><jointpos joint="elbow"/></sensor>',
        key=f'<keyframe><key qpos="0 0 .6 1 0 0 0 {"0 " * 12} .3"/></keyframe>',
    ),
    "stretched keyframe": Drawing(
        key=f'<keyframe><key qpos="0 0 .6 1 0 0 0 {"0 " * 12}"/></keyframe>',
        limits=False,
    ),
    "lying keyframe": Drawing(
        key='<keyframe><key name="down" qpos="0 0 .1 1 0 0 0 '
        f'{"0 1.3 -2.65 " * 4}"/></keyframe>'
    ),
}


def settled(robot: Robot) -> mujoco.MjData:
    """The robot after holding its home pose for two seconds."""
    mj_data = mujoco.MjData(robot.mj_model)
    mj_data.qpos[:] = robot.home_qpos
    mj_data.ctrl[robot.actuator_ids] = robot.home_joint_pos
    mujoco.mj_step(robot.mj_model, mj_data, nstep=round(2.0 / DT_S))
    mujoco.mj_forward(robot.mj_model, mj_data)
    return mj_data


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_stranger_stands_on_its_four_feet(name: str) -> None:
    """Loaded without a word, it holds its home pose; its text is the same robot."""
    robot = load_robot_xml(mjcf(DRAWINGS[name]), name=name, physics_dt_s=DT_S)
    mj_data = settled(robot)
    for leg in LEGS:
        assert mj_data.sensor(f"gaitpref_contact_{leg}").data[0] > 0, leg
    assert mj_data.sensor("gaitpref_contact_base").data[0] == 0
    assert mj_data.qpos[2] > 0.8 * robot.home_qpos[2]
    assert np.abs(mj_data.qvel).max() < 0.1
    feet_b = mj_data.site_xpos[robot.foot_site_ids] - mj_data.qpos[:3]
    assert np.sign(feet_b[:, :2]).tolist() == [[1, -1], [1, 1], [-1, -1], [-1, 1]]
    joints = [robot.mj_model.joint(int(j)).name for j in robot.qvel_adr - 5]
    assert joints == [f"{leg.lower()}_j{index}" for leg in LEGS for index in range(3)]
    again = load_robot_xml(robot.mjcf, name=name, physics_dt_s=DT_S)
    assert again.model_sha256 == robot.model_sha256
    assert np.array_equal(again.home_qpos, robot.home_qpos)
    assert np.array_equal(settled(again).qpos, mj_data.qpos)


def test_a_motor_obeys_the_law_within_its_limits() -> None:
    """torque = kp * error - kd * velocity, and no more than the motor gives."""
    robot = load_robot_xml(mjcf(Drawing()), name="m", physics_dt_s=DT_S)
    mj_model, mj_data = robot.mj_model, mujoco.MjData(robot.mj_model)
    mj_data.qpos[:] = robot.home_qpos
    mj_data.qvel[robot.qvel_adr] = 0.5
    mj_data.ctrl[robot.actuator_ids] = robot.home_joint_pos + 0.05
    mujoco.mj_forward(mj_model, mj_data)
    kp = mj_model.actuator_gainprm[robot.actuator_ids, 0]
    kd = -mj_model.actuator_biasprm[robot.actuator_ids, 2]
    assert (kp > 50).all()
    assert (kd > 0.5).all()
    torque = mj_data.qfrc_actuator[robot.qvel_adr]
    assert torque == pytest.approx(0.05 * kp - 0.5 * kd)
    mj_data.ctrl[robot.actuator_ids] = robot.home_joint_pos + 3.0
    mujoco.mj_forward(mj_model, mj_data)
    assert mj_data.qfrc_actuator[robot.qvel_adr] == pytest.approx(np.full(12, 40.0))
    assert robot.torque_limit.tolist() == [40.0] * 12


def test_a_gear_multiplies_the_limit_and_a_filter_keeps_its_gains() -> None:
    geared = load_robot_xml(
        mjcf(Drawing(actuator="geared")), name="g", physics_dt_s=DT_S
    )
    assert geared.torque_limit.tolist() == [40.0] * 12
    filtered = load_robot_xml(
        mjcf(Drawing(actuator="filtered")), name="f", physics_dt_s=DT_S
    )
    assert filtered.mj_model.na == 0
    assert filtered.mj_model.actuator_gainprm[:, 0].tolist() == [120.0] * 12
    assert filtered.mj_model.actuator_biasprm[:, 2].tolist() == [-2.0] * 12
    position = load_robot_xml(
        mjcf(Drawing(actuator="position")), name="p", physics_dt_s=DT_S
    )
    assert not any("servo" in change for change in position.changes)


def test_what_was_changed_is_told() -> None:
    robot = load_robot_xml(mjcf(DRAWINGS["an arm"]), name="a", physics_dt_s=DT_S)
    told = " | ".join(robot.changes)
    assert re.search(r"joints of no leg were fixed: elbow", told)
    assert re.search(r"12 joints with actuator got position servos: kp \d", told)
    assert re.search(r"home was searched|home is a keyframe", told)
    assert robot.mj_model.nq == 19


def _in_files(folder: Path, drawing: Drawing, hints: str | None = None) -> Path:
    path = folder / "stranger.xml"
    path.write_text(mjcf(drawing))
    if hints is not None:
        path.with_suffix(".toml").write_text(hints)
    return path


def test_meshes_includes_and_folders_are_followed(tmp_path: Path) -> None:
    """A scene that includes a robot whose feet are meshes in a folder of their own."""
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "toe.obj").write_text(MESH_OBJ)
    drawing = Drawing(
        assets='<compiler meshdir="assets"/><asset><mesh file="toe.obj"/></asset>',
        foot='<geom type="mesh" mesh="toe" pos="0 0 -0.27"/>',
        floor="",
    )
    _in_files(tmp_path, drawing)
    scene = tmp_path / "scene.xml"
    scene.write_text(
        '<mujoco><include file="stranger.xml"/><worldbody>'
        '<geom name="ground" type="plane" size="0 0 1" contype="2" conaffinity="4"/>'
        "</worldbody></mujoco>"
    )
    robot = load_robot(scene, physics_dt_s=DT_S)
    assert "toe.obj" not in robot.mjcf
    assert robot.mj_model.geom("ground").id >= 0
    assert not any("floor" in change for change in robot.changes)
    mj_data = settled(robot)
    assert all(mj_data.sensor(f"gaitpref_contact_{leg}").data[0] > 0 for leg in LEGS)


def test_hints_decide_home_servos_and_feet(tmp_path: Path) -> None:
    """What the TOML beside the model says is taken, and travels with the model."""
    drawing = Drawing(
        foot='<geom name="{leg}" class="robot_seen" type="sphere" size=".03" '
        'pos="0 0 -.25"/>'
    )
    home = "\n".join(f"{leg} = [0.0, 0.7, -1.4]" for leg in LEGS)
    feet = "\n".join(f'{leg} = "{leg.lower()}_toe"' for leg in LEGS)
    path = _in_files(
        tmp_path,
        drawing,
        f"[home]\n{home}\n[feet]\n{feet}\n[servo]\nkp = 90\nkd = [1, 2, 3]\n",
    )
    text = path.read_text()
    for leg in drawing.order:
        text = text.replace('name="{leg}"', f'name="{leg}_toe"', 1)
    path.write_text(text)
    robot = load_robot(path, physics_dt_s=DT_S)
    assert robot.home_joint_pos.tolist() == [0.0, 0.7, -1.4] * 4
    servos = robot.actuator_ids
    assert robot.mj_model.actuator_gainprm[servos, 0].tolist() == [90.0] * 12
    assert robot.mj_model.actuator_biasprm[servos, 2].tolist() == [-1, -2, -3] * 4
    assert robot.torque_limit.tolist() == [40.0] * 12
    again = load_robot_xml(robot.mjcf, name="again", physics_dt_s=DT_S)
    assert again.foot_site_ids.tolist() == robot.foot_site_ids.tolist()
    mj_data = settled(robot)
    assert all(mj_data.sensor(f"gaitpref_contact_{leg}").data[0] > 0 for leg in LEGS)


def test_hints_say_which_leg_is_which(tmp_path: Path) -> None:
    """A robot drawn backwards walks the way its hints say."""
    swap = {"FR": "rl", "FL": "rr", "RR": "fl", "RL": "fr"}
    legs = "\n".join(
        f'{leg} = ["{mine}_j0", "{mine}_j1", "{mine}_j2"]' for leg, mine in swap.items()
    )
    robot = load_robot(
        _in_files(tmp_path, Drawing(), f"[legs]\n{legs}\n"), physics_dt_s=DT_S
    )
    names = [robot.mj_model.joint(int(j)).name for j in robot.qvel_adr[::3] - 5]
    assert names == [f"{mine}_j0" for mine in swap.values()]
    again = load_robot_xml(robot.mjcf, name="again", physics_dt_s=DT_S)
    assert again.qpos_adr.tolist() == robot.qpos_adr.tolist()


@pytest.mark.parametrize(
    ("hints", "message", "line"),
    [
        ("[legs\n", "it is no TOML", ""),
        ("[foot]\n", r"no table \[foot\]; the tables are legs, feet, home, servo", ""),
        (
            "[home]\nFR = [0, 1]\n",
            r"\[home\] has FR = \[0, 1\]; it must have these four lines",
            "RL = [0.0, 0.8, -1.6]",
        ),
        ("[servo]\nkp = -3\n", "each a positive number .*; it has kp = -3", ""),
        (
            "[feet]\n" + "\n".join(f'{leg} = "toe"' for leg in LEGS),
            r"\[feet\] says FR = 'toe', which is no geom behind the knee",
            "",
        ),
        (
            "[legs]\n" + "\n".join(f'{leg} = ["a", "b", "c"]' for leg in LEGS),
            r"\[legs\] names 'a', which is no hinge of the model; its hinges are fl_j0",
            "",
        ),
    ],
)
def test_bad_hints_are_told(
    tmp_path: Path, hints: str, message: str, line: str
) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        load_robot(_in_files(tmp_path, Drawing(), hints), physics_dt_s=DT_S)
    assert line in caught.value.lines


@pytest.mark.parametrize(
    ("drawing", "message", "lines"),
    [
        (
            Drawing(foot=""),
            "body 'fr_shank' at the end of a leg has no geom that collides",
            '[feet]\nFR = "FR_foot"',
        ),
        (
            Drawing(actuator="motor", more="<!-- weak -->"),
            "it falls in the poses that were tried",
            "[home]\nFR = [",
        ),
    ],
)
def test_what_cannot_be_found_is_asked_for_with_the_lines_to_write(
    drawing: Drawing, message: str, lines: str
) -> None:
    """The lines can be pasted: they are TOML with the right tables."""
    text = mjcf(drawing).replace('ctrlrange="-40 40"', 'ctrlrange="-1 1"')
    with pytest.raises(RobotError, match=message) as caught:
        load_robot_xml(text, name="mine", physics_dt_s=DT_S)
    assert caught.value.lines.startswith(lines)


def test_commands_suit_the_size_of_a_robot() -> None:
    """Equal Froude numbers; the robot that ships keeps what is configured."""
    cfg = CommandCfg()
    assert commands_for(load_robot(physics_dt_s=DT_S), cfg) is cfg
    stranger = load_robot_xml(mjcf(Drawing()), name="stranger", physics_dt_s=DT_S)
    suited = commands_for(stranger, cfg)
    taller = float(stranger.home_qpos[2]) / 0.2945
    assert taller > 1.2
    for mine, its in (
        (cfg.forward_m_s[1], suited.forward_m_s[1]),
        (cfg.evaluated_m_s[0], suited.evaluated_m_s[0]),
    ):
        assert its**2 / taller == pytest.approx(mine**2, rel=0.05)
    assert suited.yaw_rad_s[1] < cfg.yaw_rad_s[1]
    assert suited.resample_s == cfg.resample_s
