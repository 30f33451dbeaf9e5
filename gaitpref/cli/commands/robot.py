"""`gaitpref robot inspect`: what was found in a model, in words and as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.features import LEGS
from data.files.files import write_atomically
from gaitpref.cli.options import options
from gaitpref.console.progress import console
from gaitpref.console.terminal import say
from gaitpref.report.robot_picture import draw
from policy.env.env_cfg import EnvCfg
from policy.robots.motor_class import soft_servos, unusual_motors
from policy.robots.robot import Robot, load_robot


def run(command: options.Robot) -> int:
    """Describe the robot and draw it; gives the exit code."""
    robot = load_robot(
        command.xml,
        physics_dt_s=EnvCfg().physics_dt_s,
        without_visuals=command.without_visuals,
    )
    say(describe(robot))
    folder = command.out or Path()
    folder.mkdir(parents=True, exist_ok=True)
    picture = folder / f"{robot.name}.png"
    write_atomically(picture, draw(robot))
    say(f"picture    {picture}")
    if command.out is not None:
        completed = folder / f"{robot.name}.xml"
        write_atomically(completed, robot.mjcf.encode())
        say(f"model      {completed}")
    walk = (command.out or Path("runs") / robot.name) / "walk"
    console.next(
        f"where that is your robot, `gaitpref train --out {walk} --reward task --robot "
        f"{command.xml}` teaches it to walk"
    )
    return 0


def describe(robot: Robot) -> str:
    """Everything that was found, line by line."""
    mj_model = robot.mj_model
    base = mj_model.body(robot.base_body_id).name
    mass_kg = float(mj_model.body_subtreemass[robot.base_body_id])
    lines = [
        f"robot      {robot.name}, {mass_kg:.1f} kg, of which {base!r} weighs "
        f"{float(mj_model.body_mass[robot.base_body_id]):.1f} kg",
        f"home       base at {robot.home_qpos[2]:.3f} m",
        "",
        f"{'leg':4} {'joint':24} {'home':>7} {'from':>7} {'to':>7}   rad"
        f" {'limit':>8} N m {'kp':>8} {'kd':>7}",
        *(_joint_line(robot, index) for index in range(12)),
        "",
        f"{'leg':4} {'foot on body':24} {'x':>7} {'y':>7} {'z':>7}   m {'radius':>8} m",
        *_foot_lines(robot),
        "",
        *(f"changed    {change}" for change in robot.changes),
    ]
    if not robot.changes:
        lines.append("changed    nothing but sites and sensors, which were added")
    lines += (f"warning    {warning}" for warning in unusual_motors(robot))
    if soft := soft_servos(robot):
        lines.append(f"warning    {soft}")
    return "\n".join(lines)


def _joint_line(robot: Robot, index: int) -> str:
    mj_model = robot.mj_model
    joint = int(np.flatnonzero(mj_model.jnt_qposadr == robot.qpos_adr[index])[0])
    low, high = robot.joint_range[index]
    return (
        f"{LEGS[index // 3] if index % 3 == 0 else '':4} "
        f"{mj_model.joint(joint).name:24} {robot.home_joint_pos[index]:7.2f} "
        f"{low:7.2f} {high:7.2f}       {robot.torque_limit[index]:8.1f}     "
        f"{robot.kp[index]:8.1f} {robot.kd[index]:7.2f}"
    )


def _foot_lines(robot: Robot) -> list[str]:
    mj_model = robot.mj_model
    feet_w = robot.home_foot_pos_w
    lines = []
    for leg, site, at_w, radius in zip(
        LEGS, robot.foot_site_ids, feet_w, robot.foot_radius, strict=True
    ):
        body = mj_model.body(int(mj_model.site_bodyid[site])).name
        x, y, z = at_w
        radius = round(float(radius), 3) + 0.0
        lines.append(
            f"{leg:4} {body or '(without a name)':24} {x:7.3f} {y:7.3f} {z:7.3f}     "
            f"{radius:8.3f}"
        )
    return lines
