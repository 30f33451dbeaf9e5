"""A robot with the motors, the pose and the time step of a law."""

from __future__ import annotations

import mujoco
import numpy as np

from policy.robots.robot import Robot, load_robot_xml

from .law import Law


def driven_by(robot: Robot, law: Law) -> Robot:
    """`robot` whose motors follow `law`, beginning in the pose of the law.

    Its joints lose the damping they have in the model: kd of the law is all there is.

    Raises:
        RobotError: it does not compile so.
    """
    mj_model = robot.mj_model
    spec = mujoco.MjSpec.from_string(robot.mjcf)
    spec.compile()
    kp, kd = law.canonical(law.kp_nm_per_rad), law.canonical(law.kd_nm_s_per_rad)
    limits = robot.torque_limit
    if law.torque_limit_nm is not None:
        limits = law.canonical(law.torque_limit_nm)
    actuators = {actuator.id: actuator for actuator in spec.actuators}
    joints = {joint.id: joint for joint in spec.joints}
    for index in range(12):
        servo = actuators[int(robot.actuator_ids[index])]
        servo.gainprm = [kp[index], *[0.0] * (len(servo.gainprm) - 1)]
        bias = [0.0, -kp[index], -kd[index]]
        servo.biasprm = [*bias, *[0.0] * (len(servo.biasprm) - 3)]
        servo.damping = np.zeros_like(servo.damping)
        servo.ctrllimited = int(mujoco.mjtLimited.mjLIMITED_FALSE)
        servo.ctrlrange, servo.inheritrange = [0.0, 0.0], 0.0
        limited = bool(np.isfinite(limits[index]))
        servo.forcelimited = int(limited)
        if limited:
            servo.forcerange = [-limits[index], limits[index]]
        joint = joints[int(mj_model.dof_jntid[robot.qvel_adr[index]])]
        joint.damping = np.zeros_like(joint.damping)
        # A second limit would undercut that of the law.
        joint.actfrclimited = int(mujoco.mjtLimited.mjLIMITED_FALSE)
        if law.joint_friction_nm is not None:
            joint.frictionloss = law.joint_friction_nm
    if spec.option.integrator == mujoco.mjtIntegrator.mjINT_EULER:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.timestep = law.physics_dt_s
    for key in list(spec.keys):
        if key.name == "home":
            spec.delete(key)
    spec.add_key(name="home", qpos=_home(robot, law))
    spec.compile()
    return load_robot_xml(spec.to_xml(), name=robot.name, physics_dt_s=law.physics_dt_s)


def _home(robot: Robot, law: Law) -> np.ndarray:
    """The default pose of the law [nq], its lowest foot on the ground."""
    mj_data = mujoco.MjData(robot.mj_model)
    before = robot.home_foot_pos_w[:, 2].min()
    mj_data.qpos[:] = robot.home_qpos
    mj_data.qpos[robot.qpos_adr] = law.canonical(law.default_joint_pos_rad)
    mujoco.mj_kinematics(robot.mj_model, mj_data)
    qpos = np.array(mj_data.qpos)
    qpos[2] += before - mj_data.site_xpos[robot.foot_site_ids][:, 2].min()
    return qpos
