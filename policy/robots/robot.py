"""Finding the parts of a quadruped in any MJCF with a free base and twelve hinges.

What the environment needs and the model lacks (a floor, position servos, a pose to
stand in, foot sites, sensors) is added; what cannot be found is asked for in a small
TOML beside the model (`hints.py`).

Shapes: nq positions and nv velocities of the model; legs and joints in the order of
`data.features.LEGS` and `data.features.JOINTS`.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, fields, replace
from pathlib import Path

import mujoco
import numpy as np

from data.files.files import require_regular
from data.files.limits import ROBOT_BYTES
from data.ground import Ground

from .additions import add_sites_and_sensors, is_complete
from .anatomy import Skeleton, find_anatomy, find_base, find_joints
from .frozen import freeze_other_joints, make_feet_collide
from .ground_shape import ensure_floor, ground_of
from .hints import Hints, embed_hints, embedded_hints, find_hints, read_hints
from .hints import RobotError as RobotError
from .inline import flatten
from .mesh_files import mend_meshes
from .servos import ensure_servos, set_joints
from .speed_limits import speed_limits
from .stance import ensure_home
from .urdf import read_urdf, urdf_in

SHIPPED_XML = Path(__file__).parent / "go1.xml"
"""The robot that is used when none is brought."""

_NAME_CHARS = 60
"""Of what a robot is called, which becomes the name of files."""
MIN_ITERATIONS, MIN_LS_ITERATIONS = 10, 20
"""Fewer solver iterations than these make CPU and GPU physics differ visibly."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A compiled model and where in it the parts of the quadruped are."""

    name: str
    mj_model: mujoco.MjModel
    mjcf: str
    """Flattened model with everything added; compiles to `mj_model`."""
    model_sha256: str
    """Hash of `mjcf`."""
    base_body_id: int
    qpos_adr: np.ndarray
    """[12] address of every joint in qpos."""
    qvel_adr: np.ndarray
    """[12] address of every joint in qvel."""
    actuator_ids: np.ndarray
    """[12] the position servo of every joint."""
    home_qpos: np.ndarray
    """[nq] home pose of the whole model."""
    home_joint_pos: np.ndarray
    """[12] rad"""
    joint_range: np.ndarray
    """[12, 2] rad; infinite where the model sets no limit."""
    torque_limit: np.ndarray
    """[12] N m; infinite where the model sets no limit."""
    foot_site_ids: np.ndarray
    """[4]"""
    foot_radius: np.ndarray
    """[4] m from the site down to the lowest point of the foot in the home pose."""
    changes: tuple[str, ...] = ()
    """What was added to the model or replaced in it, in words."""
    ground: Ground | None = None
    """The ground under the robot; None is the plane z = 0."""

    @property
    def home_foot_pos_w(self) -> np.ndarray:
        """[4, 3] m, the foot sites in the home pose."""
        mj_data = mujoco.MjData(self.mj_model)
        mj_data.qpos[:] = self.home_qpos
        mujoco.mj_kinematics(self.mj_model, mj_data)
        return mj_data.site_xpos[self.foot_site_ids]

    @property
    def kp(self) -> np.ndarray:
        """[12] N m/rad, stiffness of the servos."""
        return self.mj_model.actuator_gainprm[self.actuator_ids, 0]

    @property
    def speed_limit(self) -> np.ndarray:
        """[12] rad/s that the joints turn at most; infinite where nobody says so.

        MuJoCo holds no joint to it.
        """
        joints = self.mj_model.dof_jntid[self.qvel_adr]
        return speed_limits(self.mj_model, joints.tolist())

    @property
    def joint_damping(self) -> np.ndarray:
        """[12] N m s/rad that the model damps the joints with beside the servos' kd."""
        mj_model = self.mj_model
        of_servos = mj_model.actuator_damping[self.actuator_ids]
        return mj_model.dof_damping[self.qvel_adr] + of_servos

    @property
    def kd(self) -> np.ndarray:
        """[12] N m s/rad, all that damps the joints: of the servos and of the model."""
        servo_kd = -self.mj_model.actuator_biasprm[self.actuator_ids, 2]
        return servo_kd + self.joint_damping

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)


def load_robot(
    xml: Path | None = None, *, physics_dt_s: float, without_visuals: bool = False
) -> Robot:
    """The robot in a file of MJCF or URDF.

    Args:
        xml: The file; by default the Go1 that ships.
        physics_dt_s: Time step of the physics.
        without_visuals: Leave out meshes that only are looked at.

    Raises:
        FileError: the path leads to no file, or to one that is too large.
        RobotError: the file is missing, does not compile or is no quadruped, or the
            robot does not stand in the pose that was said.
    """
    path = SHIPPED_XML if xml is None else xml
    if not path.exists():
        raise RobotError(
            f"{path}: there is no such file; give the path of an MJCF file"
        )
    require_regular(path, ROBOT_BYTES)
    spec, told = _read(path, without_visuals=without_visuals)
    hints_file = find_hints(path)
    if hints_file is None:
        # A model that was completed before carries what was said of it.
        hints = _said_before(spec)
    else:
        hints = read_hints(hints_file)
        told.append(f"{hints_file} says what the model leaves open")
    robot = _completed(spec, hints, str(path), _name_of(spec, path), physics_dt_s)
    return replace(robot, changes=(*told, *robot.changes))


def _read(path: Path, *, without_visuals: bool) -> tuple[mujoco.MjSpec, list[str]]:
    """The model in a file with meshes that are there, and what was changed."""
    urdf = urdf_in(path)
    try:
        if urdf is not None:
            return read_urdf(urdf, path, without_visuals=without_visuals)
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise _not_compiling(str(path), error) from None
    told = mend_meshes(spec, path, without_visuals=without_visuals)
    return spec, [told] if told else []


def _name_of(spec: mujoco.MjSpec, path: Path) -> str:
    """What a robot is called: its model, else its file, else its folder."""
    words = [w for w in re.findall(r"[\w-]+", spec.modelname) if w.lower() != "scene"]
    if words and words != ["MuJoCo", "Model"]:
        return "_".join(words)[:_NAME_CHARS]
    return path.stem if path.stem.lower() != "scene" else path.resolve().parent.name


def load_robot_xml(text: str, *, name: str, physics_dt_s: float) -> Robot:
    """The robot in the MJCF `text`, for example out of a checkpoint or an episode.

    Raises:
        RobotError: the text does not compile or is no quadruped.
    """
    spec = _parse(text, name)
    # What was flattened before stays the same to the letter, and so does its hash.
    if is_complete(spec) and spec.option.timestep == physics_dt_s:
        return _describe(text, name, name)
    return _completed(spec, _said_before(spec), name, name, physics_dt_s)


def _said_before(spec: mujoco.MjSpec) -> Hints:
    """The hints that a completed model carries, less those that made its servos."""
    return replace(embedded_hints(spec), servo=None)


def _completed(
    spec: mujoco.MjSpec, hints: Hints, source: str, name: str, physics_dt_s: float
) -> Robot:
    """The robot in `spec` with everything the environment needs."""
    spec.option.timestep = physics_dt_s
    spec.option.iterations = max(spec.option.iterations, MIN_ITERATIONS)
    spec.option.ls_iterations = max(spec.option.ls_iterations, MIN_LS_ITERATIONS)
    changes: list[str] = []
    skeleton = _skeleton(spec, source, hints)
    for change in (
        freeze_other_joints,
        make_feet_collide,
        ensure_floor,
        set_joints,
        ensure_servos,
        ensure_home,
    ):
        told = change(spec, skeleton)
        if told:
            changes.append(told)
            # A change takes the ids of the elements of a spec away.
            skeleton = _skeleton(spec, source, hints)
    embed_hints(spec, hints)
    mj_model = _compile(spec, source)
    add_sites_and_sensors(spec, mj_model, find_anatomy(mj_model, source, hints))
    try:
        mjcf = flatten(spec)
    except ValueError as error:
        raise _not_compiling(source, error) from None
    return replace(_describe(mjcf, source, name), changes=tuple(changes))


def _skeleton(spec: mujoco.MjSpec, source: str, hints: Hints) -> Skeleton:
    """The legs of what `spec` compiles to."""
    mj_model = _compile(spec, source)
    base = find_base(mj_model, source)
    joints = find_joints(mj_model, base, source, hints)
    return Skeleton(mj_model, joints, source, hints)


def _describe(mjcf: str, source: str, name: str) -> Robot:
    # The text rounds numbers. What it compiles to is simulated, so that who reads it
    # later has the same robot to the last bit.
    spec = _parse(mjcf, source)
    mj_model = _compile(spec, source)
    found = find_anatomy(mj_model, source, embedded_hints(spec))
    joints, servos = list(found.joints), list(found.servos)
    qpos_adr = mj_model.jnt_qposadr[joints]
    return Robot(
        name=name,
        mj_model=mj_model,
        mjcf=mjcf,
        model_sha256=hashlib.sha256(mjcf.encode()).hexdigest(),
        base_body_id=found.base,
        qpos_adr=qpos_adr,
        qvel_adr=mj_model.jnt_dofadr[joints],
        actuator_ids=np.array(servos),
        home_qpos=found.home_qpos,
        home_joint_pos=found.home_qpos[qpos_adr],
        joint_range=np.where(
            mj_model.jnt_limited[joints, None] > 0,
            mj_model.jnt_range[joints],
            (-np.inf, np.inf),
        ),
        torque_limit=np.minimum(
            _limit(
                mj_model.actuator_forcelimited, mj_model.actuator_forcerange, servos
            ),
            _limit(mj_model.jnt_actfrclimited, mj_model.jnt_actfrcrange, joints),
        ),
        foot_site_ids=np.array([foot.site for foot in found.feet], dtype=int),
        foot_radius=np.array([foot.radius for foot in found.feet]),
        ground=ground_of(mj_model),
    )


def _limit(limited: np.ndarray, bounds: np.ndarray, ids: list[int]) -> np.ndarray:
    """The largest magnitude that `bounds` [n, 2] allow each of `ids`, or infinity."""
    return np.where(limited[ids] > 0, np.abs(bounds[ids]).max(axis=1), np.inf)


def _parse(text: str, source: str) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_string(text)
    except ValueError as error:
        raise _not_compiling(source, error) from None


def _compile(spec: mujoco.MjSpec, source: str) -> mujoco.MjModel:
    try:
        mj_model = spec.compile()
    except ValueError as error:
        raise _not_compiling(source, error) from None
    if mujoco.__version__ == "4.0.0" and mujoco.mj_isSparse(mj_model):
        raise RobotError(
            f"{source}: its {mj_model.nv} degrees of freedom make constraints sparse, "
            "which MuJoCo 4.0.0 solves wrongly; take away what is not the robot or set "
            '<option jacobian="dense"/>'
        )
    return mj_model


def _not_compiling(source: str, error: ValueError) -> RobotError:
    told = "; ".join(line.strip() for line in str(error).splitlines() if line.strip())
    if "could not find decoder" in told:
        return RobotError(f"{source} is no robot: an MJCF (.xml) or a URDF is wanted")
    return RobotError(
        f"{source}: MuJoCo {mujoco.__version__} cannot compile it ({told}); mend the "
        "model until MuJoCo's own viewer opens it"
    )
