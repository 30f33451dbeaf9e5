"""Any quadruped is found in its MJCF; the Go1 that ships stands."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from data.features import JOINTS, LEGS
from policy.robots.robot import (
    SHIPPED_XML,
    Robot,
    RobotError,
    load_robot,
    load_robot_xml,
)

DT_S = 0.005
TETRAHEDRON_OBJ = """
v 0 0 0
v 0.03 0 0
v 0 0.02 0
v 0 0 0.05
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""


@pytest.fixture(scope="module")
def go1() -> Robot:
    return load_robot(physics_dt_s=DT_S)


def go1_with(old: str, new: str) -> str:
    """The text of the shipped robot with every match of the pattern `old` replaced."""
    text, count = re.subn(old, new, SHIPPED_XML.read_text(), flags=re.DOTALL)
    assert count > 0
    return text


def mangled_go1() -> str:
    """The shipped robot with numbered names, and legs and servos in reverse order."""
    text = SHIPPED_XML.read_text()
    legs = re.findall(
        r'\n      <body name="\w\w_hip".*?\n      </body>', text, re.DOTALL
    )
    servos = re.findall(r"\n    <position name=.*?/>", text)
    assert (len(legs), len(servos)) == (4, 12)
    for parts in (legs, servos):
        for index, part in enumerate(parts):
            text = text.replace(part, f"@{index}@")
        for index, part in enumerate(reversed(parts)):
            text = text.replace(f"@{index}@", part)
    text = re.sub(r"\n *<site .*?/>", "", text)
    text = re.sub(r"\n *<keyframe>.*</keyframe>", "", text, flags=re.DOTALL)
    text = re.sub(r'( name| joint)="(FR|FL|RR|RL)_hip"', r'\1="m\2.a"', text)
    text = re.sub(r'( name| joint)="(FR|FL|RR|RL)_thigh"', r'\1="m\2.b"', text)
    text = re.sub(r'( name| joint)="(FR|FL|RR|RL)_calf"', r'\1="m\2.c"', text)
    text = re.sub(r' name="(FR|FL|RR|RL)_foot"', "", text)
    for number, leg in enumerate(("RL", "FR", "FL", "RR")):
        text = text.replace(f'"m{leg}.', f'"m{number}.')
    pose = " ".join(f"{0.1 * side} 0.9 -1.8" for side in (-1, 1, -1, 1))
    key = f'<keyframe><key qpos="0 0 0.2945 1 0 0 0 {pose}"/></keyframe>'
    return text.replace("</mujoco>", f"{key}</mujoco>")


def settled(robot: Robot, seconds: float) -> mujoco.MjData:
    """The robot after standing in its home pose for a while, started 1 mm too high."""
    mj_data = mujoco.MjData(robot.mj_model)
    mj_data.qpos[:] = robot.home_qpos
    mj_data.qpos[2] += 0.001
    mj_data.ctrl[robot.actuator_ids] = robot.home_joint_pos
    mujoco.mj_step(robot.mj_model, mj_data, nstep=round(seconds / DT_S))
    mujoco.mj_forward(robot.mj_model, mj_data)
    return mj_data


def contacts(mj_data: mujoco.MjData) -> list[bool]:
    """Whether each foot, in the order of `LEGS`, touches the ground."""
    return [mj_data.sensor(f"gaitpref_contact_{leg}").data[0] > 0 for leg in LEGS]


def test_go1_has_the_published_mass_and_limits(go1: Robot) -> None:
    """5.204 + 4 * (0.680 + 1.009 + 0.196) = 12.744 kg."""
    assert go1.mj_model.body_mass.sum() == pytest.approx(12.744)
    assert go1.torque_limit.tolist() == [23.7, 23.7, 35.55] * 4
    assert go1.joint_range[:3] == pytest.approx(
        np.array([[-0.863, 0.863], [-0.686, 4.501], [-2.818, -0.888]])
    )
    assert go1.home_joint_pos.tolist() == [0.1, 0.9, -1.8, -0.1, 0.9, -1.8] * 2
    assert go1.foot_radius == pytest.approx(np.full(4, 0.023))


def test_go1_touches_the_floor_in_its_home_pose(go1: Robot) -> None:
    mj_data = mujoco.MjData(go1.mj_model)
    mj_data.qpos[:] = go1.home_qpos
    mujoco.mj_kinematics(go1.mj_model, mj_data)
    bottoms = mj_data.site_xpos[go1.foot_site_ids, 2] - go1.foot_radius
    assert bottoms == pytest.approx(np.zeros(4), abs=1e-4)


def test_go1_stands_still_under_its_servos(go1: Robot) -> None:
    """Its weight bends the legs at first; then it stays where it is."""
    early, late = settled(go1, 1.0), settled(go1, 5.0)
    assert late.qpos[2] == pytest.approx(early.qpos[2], abs=0.005)
    assert late.qpos[2] > 0.25
    assert abs(late.qpos[1]) < 0.005
    assert late.qpos[0] == pytest.approx(early.qpos[0], abs=0.01)
    assert late.qpos[3] > 0.999
    assert np.abs(late.qvel).max() < 0.01


def test_only_feet_and_trunk_touch_the_floor(go1: Robot) -> None:
    mj_model = go1.mj_model
    touching = (mj_model.geom_contype | mj_model.geom_conaffinity) > 0
    names = {mj_model.geom(geom).name for geom in np.flatnonzero(touching)}
    assert names == {"floor", "trunk", *(f"{leg}_foot" for leg in LEGS)}
    assert set(mj_model.geom_group[touching]) == {0, 3}


def test_sensors_come_in_the_promised_order(go1: Robot) -> None:
    sensors = [go1.mj_model.sensor(index) for index in range(go1.mj_model.nsensor)]
    assert [sensor.name for sensor in sensors] == [
        *(f"gaitpref_contact_{leg}" for leg in LEGS),
        *(f"gaitpref_vel_{leg}" for leg in LEGS),
        "gaitpref_contact_base",
    ]
    assert [int(sensor.dim[0]) for sensor in sensors] == [1] * 4 + [3] * 4 + [1]


def test_contact_sensors_tell_air_from_ground(go1: Robot) -> None:
    mj_data = settled(go1, 1.0)
    assert contacts(mj_data) == [True] * 4
    assert mj_data.sensor("gaitpref_contact_base").data[0] == 0
    mj_data.qpos[2] += 0.1
    mujoco.mj_forward(go1.mj_model, mj_data)
    assert contacts(mj_data) == [False] * 4
    mj_data.qpos[2] = 0.05
    mujoco.mj_forward(go1.mj_model, mj_data)
    assert mj_data.sensor("gaitpref_contact_base").data[0] > 0


@pytest.mark.parametrize("lifted", range(4))
def test_a_lifted_foot_alone_loses_contact(go1: Robot, lifted: int) -> None:
    mj_data = settled(go1, 1.0)
    mj_data.qpos[go1.qpos_adr[3 * lifted + 2]] -= 0.3
    mujoco.mj_forward(go1.mj_model, mj_data)
    assert contacts(mj_data) == [leg != lifted for leg in range(4)]


def test_velocity_sensors_read_the_feet_in_the_world_frame(go1: Robot) -> None:
    mj_data = mujoco.MjData(go1.mj_model)
    mj_data.qpos[:] = go1.home_qpos
    mj_data.qvel[:3] = (0.3, -0.2, 0.1)
    mujoco.mj_forward(go1.mj_model, mj_data)
    for leg in LEGS:
        velocity_w = mj_data.sensor(f"gaitpref_vel_{leg}").data
        assert velocity_w == pytest.approx(np.array([0.3, -0.2, 0.1]))


def test_a_mangled_copy_is_the_same_robot(go1: Robot) -> None:
    """Names and order do not matter: every part is found and moves alike."""
    other = load_robot_xml(mangled_go1(), name="mangled", physics_dt_s=DT_S)
    assert other.qpos_adr.tolist() != go1.qpos_adr.tolist()
    assert other.actuator_ids.tolist() != go1.actuator_ids.tolist()
    assert other.home_joint_pos.tolist() == go1.home_joint_pos.tolist()
    assert other.torque_limit.tolist() == go1.torque_limit.tolist()
    ours, theirs = (mujoco.MjData(robot.mj_model) for robot in (go1, other))
    targets = go1.home_joint_pos + np.linspace(-0.2, 0.2, len(JOINTS))
    for robot, mj_data in ((go1, ours), (other, theirs)):
        mj_data.qpos[:] = robot.home_qpos
        mj_data.ctrl[robot.actuator_ids] = targets
        mujoco.mj_step(robot.mj_model, mj_data, nstep=40)
        mujoco.mj_forward(robot.mj_model, mj_data)
    assert theirs.qpos[other.qpos_adr] == pytest.approx(
        ours.qpos[go1.qpos_adr], abs=1e-5
    )
    assert theirs.qvel[other.qvel_adr] == pytest.approx(
        ours.qvel[go1.qvel_adr], abs=1e-3
    )
    assert theirs.site_xpos[other.foot_site_ids] == pytest.approx(
        ours.site_xpos[go1.foot_site_ids], abs=1e-5
    )
    assert contacts(theirs) == contacts(ours)


def test_the_flattened_text_is_the_same_robot(go1: Robot) -> None:
    """It compiles alone, moves alike to the last bit, and flattens to itself."""
    again = mujoco.MjModel.from_xml_string(go1.mjcf)
    first = go1.mj_model
    for size in ("nq", "nv", "nu", "nsensor", "nsensordata", "nsite", "ngeom"):
        assert getattr(again, size) == getattr(first, size)
    rng = np.random.default_rng(0)
    ours, theirs = mujoco.MjData(first), mujoco.MjData(again)
    ours.qpos[:] = theirs.qpos[:] = go1.home_qpos
    for _ in range(100):
        ours.ctrl[:] = theirs.ctrl[:] = go1.home_joint_pos + rng.normal(0, 0.2, 12)
        mujoco.mj_step(first, ours)
        mujoco.mj_step(again, theirs)
        assert np.array_equal(ours.qpos, theirs.qpos)
    assert np.array_equal(ours.sensordata, theirs.sensordata)
    reloaded = load_robot_xml(go1.mjcf, name="go1", physics_dt_s=DT_S)
    assert reloaded.model_sha256 == go1.model_sha256


def test_the_timestep_is_set_and_weak_solvers_are_raised() -> None:
    text = go1_with(r'iterations="10"\s*ls_iterations="20"', 'iterations="1"')
    option = load_robot_xml(text, name="weak", physics_dt_s=0.004).mj_model.opt
    assert (option.timestep, option.iterations) == (0.004, 10)
    assert option.ls_iterations >= 20
    robot = load_robot(physics_dt_s=DT_S)
    assert (
        load_robot_xml(robot.mjcf, name="go1", physics_dt_s=0.002).mj_model.opt.timestep
        == 0.002
    )


def test_a_foot_may_be_a_capsule_or_a_box() -> None:
    """The site sits in the round end of a capsule, or on the sole of a box."""
    sphere = r'type="sphere" size="0.023" pos="0 0 -0.213"/>\s*<site [^>]*>'
    capsule = 'type="capsule" size="0.015" fromto="0 0 -0.1 0 0 -0.22"/>'
    robot = load_robot_xml(go1_with(sphere, capsule), name="c", physics_dt_s=DT_S)
    assert robot.foot_radius == pytest.approx(np.full(4, 0.015))
    assert robot.mj_model.site_pos[robot.foot_site_ids] == pytest.approx(
        np.tile([0, 0, -0.22], (4, 1)), abs=1e-6
    )
    box = 'type="box" size="0.02 0.01 0.02" pos="0 0 -0.213" euler="0 0.9 0"/>'
    robot = load_robot_xml(go1_with(sphere, box), name="b", physics_dt_s=DT_S)
    assert robot.foot_radius == pytest.approx(np.zeros(4), abs=1e-6)


def test_meshes_travel_in_the_text_and_pictures_stay_behind(tmp_path: Path) -> None:
    """A model with files beside it flattens to a text that needs none of them."""
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "shin.obj").write_text(TETRAHEDRON_OBJ)
    text = go1_with(
        r'type="sphere" size="0.023" pos="0 0 -0.213" material="rubber"',
        'type="mesh" mesh="shin" pos="0 0 -0.2" material="rubber"',
    )
    asset = '<asset><mesh name="shin" file="shapes/shin.obj" scale="2 1 1"/>'
    path = tmp_path / "mine.xml"
    path.write_text(text.replace("<asset>", asset))
    robot = load_robot(path, physics_dt_s=DT_S)
    assert robot.name == "go1", "after its model, not its file"
    assert "shin.obj" not in robot.mjcf
    again = mujoco.MjModel.from_xml_string(robot.mjcf)
    original = mujoco.MjModel.from_xml_path(str(path))
    assert again.mesh_vert == pytest.approx(original.mesh_vert, abs=2e-5)
    assert again.mesh_face.tolist() == original.mesh_face.tolist()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            r'<freejoint name="base"/>|<keyframe>.*</keyframe>',
            "",
            "^mine: found 0 free joints where a quadruped alone on its ground has 1; "
            "give its base body a <freejoint/> ",
        ),
        (
            r'<joint name="RL_calf" class="calf"/>',
            "",
            "^mine: MuJoCo .* cannot compile it .*RL_calf.*; mend the model",
        ),
        (
            r'<joint name="RL_calf"[^\n]*|<position name="RL_calf"[^\n]*'
            "|<keyframe>.*</keyframe>",
            "",
            r"^mine: the hinges on body 'trunk' form chains of \[3, 3, 3, 2\] where a "
            "quadruped has 4 legs of 3; nest each leg's bodies as hip, thigh, calf, or "
            "name the joints of the legs, out of FR_hip, .*, in a TOML file beside",
        ),
        (
            r'(<joint name="RL_hip")',
            r'\1 type="slide"',
            r"^mine: the hinges on body 'trunk' form chains of \[3, 3, 3, 2\] where",
        ),
        (
            r'<geom name="RR_foot"[^/]*/>',
            "",
            "^mine: body 'RR_calf' at the end of a leg has no geom that collides; give",
        ),
        (
            r'(<body name="RR_hip" pos=")-0.1881',
            r"\g<1>0.1881",
            r"^mine: the legs begin at \(x, y\) = \(0.19, -0.05\), .* one is expected "
            "in each corner; turn the base so that x points forward",
        ),
        (r"</mujoco>", "", "^mine: MuJoCo .* cannot compile it .*; mend the model"),
    ],
)
def test_what_is_no_quadruped_is_told_in_one_line(
    old: str, new: str, message: str
) -> None:
    """The message names the file, what was found, what is right and what to do."""
    with pytest.raises(RobotError, match=message) as caught:
        load_robot_xml(go1_with(old, new), name="mine", physics_dt_s=DT_S)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(mujoco.__version__ != "4.0.0", reason="mended in MuJoCo 4.0.1")
def test_sparse_models_are_refused_where_they_are_solved_wrongly() -> None:
    text = go1_with("<option", '<option jacobian="sparse"/><option')
    message = (
        "^mine: its 18 degrees of freedom make constraints sparse, which MuJoCo 4.0.0 "
        'solves wrongly; .* set <option jacobian="dense"/>$'
    )
    with pytest.raises(RobotError, match=message):
        load_robot_xml(text, name="mine", physics_dt_s=DT_S)


def test_a_missing_file_is_told_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "nowhere.xml"
    with pytest.raises(RobotError, match=r"nowhere.xml: there is no such file; give"):
        load_robot(path, physics_dt_s=DT_S)


def test_the_arrays_of_a_robot_are_read_only(go1: Robot) -> None:
    with pytest.raises(ValueError, match="read-only"):
        go1.home_qpos[0] = 1.0
