"""Robots as they are published: meshes elsewhere, a TOML beside what is included."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from policy.robots.differences import differences
from policy.robots.motor_class import soft_servos, unusual_motors
from policy.robots.robot import RobotError, load_robot, load_robot_xml
from tests.helpers.foreign_robots import Drawing, mjcf, urdf

DT_S = 0.005
OBJ = "v 0 0 0\nv .03 0 0\nv 0 .02 0\nv 0 0 .05\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
NAMED = "package://dog_description/meshes/trunk.obj"
SEEN = f'<visual><geometry><mesh filename="{NAMED}"/></geometry></visual>'
TOUCHES = SEEN.replace("visual", "collision")
MESH = '<asset><mesh name="shell" file="shell.obj"/></asset>'
SHELL = '<geom type="mesh" mesh="shell" contype="0" conaffinity="0" mass="0"/>'


def package(folder: Path, element: str, *, mesh: bool) -> Path:
    """A ROS package whose URDF has a mesh on its trunk."""
    for name in ("urdf", "meshes"):
        (folder / "dog_description" / name).mkdir(parents=True)
    if mesh:
        (folder / "dog_description" / "meshes" / "trunk.obj").write_text(OBJ)
    path = folder / "dog_description" / "urdf" / "dog.urdf"
    path.write_text(
        urdf().replace('<link name="trunk">', f'<link name="trunk">{element}')
    )
    return path


def meshes(path: Path) -> int:
    return load_robot(path, physics_dt_s=DT_S).mj_model.nmesh


def test_the_meshes_of_a_package_are_found_beside(tmp_path: Path) -> None:
    """Where the package is on no path of ROS; what is seen weighs nothing."""
    assert meshes(package(tmp_path, SEEN, mesh=True)) == 1
    robot = load_robot(package(tmp_path / "b", TOUCHES, mesh=True), physics_dt_s=DT_S)
    assert robot.mj_model.nmesh == 1
    assert robot.mj_model.body_subtreemass[0] == pytest.approx(12.2)


def test_meshes_of_a_urdf_that_are_absent(tmp_path: Path) -> None:
    """One that only is looked at is left out and named; one that touches is not."""
    robot = load_robot(package(tmp_path, SEEN, mesh=False), physics_dt_s=DT_S)
    assert robot.mj_model.nmesh == 0
    assert any(f"were left out: {NAMED}" in change for change in robot.changes)
    with pytest.raises(RobotError, match=r"trunk\.obj are in no folder beside it"):
        meshes(package(tmp_path / "b", TOUCHES, mesh=False))


def test_meshes_of_an_mjcf_that_are_absent(tmp_path: Path) -> None:
    """The message names the file and what to do; done so, it is the same robot."""
    path = tmp_path / "dog.xml"
    path.write_text(
        mjcf(Drawing(assets=MESH, extra=f"<body name='hull'>{SHELL}</body>"))
    )
    with pytest.raises(RobotError, match=r"shell\.obj .* --without-visuals"):
        load_robot(path, physics_dt_s=DT_S)
    robot = load_robot(path, physics_dt_s=DT_S, without_visuals=True)
    assert robot.mj_model.nmesh == 0
    assert "1 meshes that only are looked at were left out" in robot.changes
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "shell.obj").write_text(OBJ)
    whole = load_robot(path, physics_dt_s=DT_S)
    assert whole.mj_model.nmesh == 1
    assert not differences(robot, whole)


def test_a_xacro_is_told_from_a_urdf(tmp_path: Path) -> None:
    path = tmp_path / "dog.xacro"
    path.write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include/></robot>'
    )
    with pytest.raises(RobotError, match="it is a xacro"):
        load_robot(path, physics_dt_s=DT_S)


@pytest.fixture
def dog(tmp_path: Path) -> Path:
    """`scene.xml`, which includes `dog.xml`, whose joints have damping."""
    (tmp_path / "dog.xml").write_text(mjcf(Drawing(damping=2.0)))
    scene = tmp_path / "scene.xml"
    scene.write_text('<mujoco model="dog scene"><include file="dog.xml"/></mujoco>')
    return scene


def test_kd_is_all_the_damping_and_joints_can_be_set(dog: Path) -> None:
    """In the TOML of what is included; also where the text is loaded once more."""
    hints = dog.with_name("dog.toml")
    hints.write_text("[servo]\nkd = 0.5\n")
    robot = load_robot(dog, physics_dt_s=DT_S)
    assert robot.name == "dog"
    assert robot.kd.tolist() == [0.5] * 12
    assert not robot.joint_damping.any()
    hints.write_text(
        "[servo]\nkd = [0.5, 0.6, 0.7]\n"
        "[joints]\ndamping = 0.1\nfriction = [0.2, 0.2, 0.3]\nspeed_limit = 30\n"
    )
    robot = load_robot(dog, physics_dt_s=DT_S)
    again = load_robot_xml(robot.mjcf, name="dog", physics_dt_s=0.002)
    for found in (robot, again):
        assert found.kd == pytest.approx(np.tile([0.5, 0.6, 0.7], 4))
        assert found.joint_damping.tolist() == [0.1] * 12
        friction = found.mj_model.dof_frictionloss[found.qvel_adr]
        assert friction.tolist() == [0.2, 0.2, 0.3] * 4
        assert found.speed_limit.tolist() == [30.0] * 12
    assert any("dog.toml says" in change for change in robot.changes)
    dog.with_suffix(".toml").write_text("[servo]\nkd = 0.9\n")
    own = load_robot(dog, physics_dt_s=DT_S)
    assert own.kd.tolist() == [0.9] * 12, "its own comes first"
    hints.unlink()
    dog.with_suffix(".toml").unlink()
    assert load_robot(dog, physics_dt_s=DT_S).kd.tolist() == [2.0] * 12


def test_the_bearings_damp_no_more_than_all_does(dog: Path) -> None:
    dog.with_name("dog.toml").write_text("[servo]\nkd = 0.5\n[joints]\ndamping = 1\n")
    with pytest.raises(RobotError, match="which is all the damping of a joint"):
        load_robot(dog, physics_dt_s=DT_S)


def test_a_urdf_says_how_fast_joints_turn(tmp_path: Path) -> None:
    path = tmp_path / "dog.urdf"
    path.write_text(urdf())
    assert load_robot(path, physics_dt_s=DT_S).speed_limit.tolist() == [20.0] * 12


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("FR = [0, 0.8, 9.9]", r"9\.9 rad for FR_calf, whose joint 'fr_j2' moves from"),
        ("FR = [0.9, 2.5, -1.0]", r"it does not stand for 2 s: it tilts by"),
    ],
)
def test_a_home_that_is_none_is_refused(tmp_path: Path, lines: str, told: str) -> None:
    """Beyond a limit, or a pose in which the robot falls."""
    path = tmp_path / "dog.xml"
    path.write_text(mjcf(Drawing()))
    others = "\n".join(f"{leg} = [0, 0.8, -1.6]" for leg in ("FL", "RR", "RL"))
    path.with_suffix(".toml").write_text(f"[home]\n{lines}\n{others}\n")
    with pytest.raises(RobotError, match=told):
        load_robot(path, physics_dt_s=DT_S)


def test_servos_too_soft_to_stand_on_are_refused(tmp_path: Path) -> None:
    """The stiffness that was said is named as what may be the reason."""
    path = tmp_path / "dog.xml"
    path.write_text(mjcf(Drawing()))
    path.with_suffix(".toml").write_text("[servo]\nkp = 2.0\n")
    with pytest.raises(RobotError, match=r"with the kp of \[servo\], \[2\.0, "):
        load_robot(path, physics_dt_s=DT_S)


def test_motors_of_no_such_robot_are_told(tmp_path: Path) -> None:
    """Too stiff, too weak, without a limit; the robot that ships is like others."""
    assert not unusual_motors(load_robot(physics_dt_s=DT_S))
    path = tmp_path / "dog.xml"
    path.write_text(mjcf(Drawing()))

    def warned(lines: str) -> str:
        path.with_suffix(".toml").write_text(f"[servo]\n{lines}\n")
        return " | ".join(unusual_motors(load_robot(path, physics_dt_s=DT_S)))

    assert warned("kp = 50\nkd = 1\ntorque_limit = 30") == ""
    assert "N m/rad per kg, where quadrupeds run 1 to 3" in warned("kp = 200\nkd = 4")
    assert "the joints would swing" in warned("kp = 50\nkd = 0.4")
    strong = "kp = 50\nkd = 1\ntorque_limit = 900"
    assert "compare with the data sheet" in warned(strong)
    # Stands, and gives way too much to learn a walk with.
    robot = load_robot(path, physics_dt_s=DT_S)
    mass_kg = float(robot.mj_model.body_subtreemass[robot.base_body_id])
    for share, soft in ((0.6, True), (0.7, False)):
        kp = share * 9.81 * mass_kg * float(robot.home_qpos[2])
        robot.mj_model.actuator_gainprm[robot.actuator_ids, 0] = kp
        assert (soft_servos(robot) is not None) == soft
    drawn = mujoco.MjSpec.from_string(mjcf(Drawing(actuator="none")))
    free = load_robot_xml(drawn.to_xml(), name="free", physics_dt_s=DT_S)
    assert "no limit of torque" in " ".join(unusual_motors(free))
