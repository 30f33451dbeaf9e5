"""Measuring the legs of a robot in any pose.

Shapes: nq positions of the model, L = 4 legs of three joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from .anatomy import Skeleton, actuators_of
from .foot import Foot, lowest_end, points_of

STRETCHED_SHARE = 0.95
"""A leg longer than this is straight: it cannot give way, and no gait starts there."""

FOLDED_SHARE = 0.4
"""A leg whose foot is not this far below the thigh's joint does not stand but lie."""

STANDING_S = 2.0
"""A pose is good if the robot still stands after this time."""


@dataclass(frozen=True)
class Legs:
    """Legs that can be measured in any pose."""

    skeleton: Skeleton

    @cached_property
    def feet(self) -> tuple[Foot, ...]:
        """The feet as the model's zero pose shows them."""
        return self.skeleton.feet(self.skeleton.mj_model.qpos0)

    @cached_property
    def tips_b(self) -> np.ndarray:
        """[L, 3] m, the end of every leg in the frame of the body of its foot."""
        skeleton = self.skeleton
        mj_data = skeleton.posed(skeleton.mj_model.qpos0)
        tips_b = []
        for foot, knee in zip(self.feet, skeleton.joints[2::3], strict=True):
            points_w = points_of(skeleton.mj_model, mj_data, foot.geom)
            distances = np.linalg.norm(points_w - mj_data.xanchor[knee], axis=1)
            from_body_w = points_w[np.argmax(distances)] - mj_data.xpos[foot.body]
            tips_b.append(from_body_w @ mj_data.xmat[foot.body].reshape(3, 3))
        return np.array(tips_b)

    @cached_property
    def reach_m(self) -> np.ndarray:
        """[L] m, from the thigh's joint over the knee to the tip."""
        joints = list(self.skeleton.joints)
        mj_data = self.skeleton.posed(self.skeleton.mj_model.qpos0)
        thigh_w, knee_w = mj_data.xanchor[joints[1::3]], mj_data.xanchor[joints[2::3]]
        shanks_m = np.linalg.norm(self.tips_w(mj_data) - knee_w, axis=1)
        return np.linalg.norm(knee_w - thigh_w, axis=1) + shanks_m

    def tips_w(self, mj_data: mujoco.MjData) -> np.ndarray:
        """[L, 3] m, where the tips are."""
        bodies = [foot.body for foot in self.feet]
        rotations = mj_data.xmat[bodies].reshape(-1, 3, 3)
        return mj_data.xpos[bodies] + np.einsum("lij,lj->li", rotations, self.tips_b)

    def gap_m(self, qpos: np.ndarray) -> float:
        """Height of the lowest foot above the floor in the pose `qpos` [nq]."""
        mj_model, mj_data = self.skeleton.mj_model, self.skeleton.posed(qpos)
        ends = [
            lowest_end(mj_model, mj_data, foot.geom)
            for foot in self.skeleton.feet(qpos)
        ]
        return min(float(point_w[2] - radius) for point_w, radius in ends)

    def on_floor(self, qpos: np.ndarray, tolerance_m: float = 0.0) -> np.ndarray:
        """`qpos` [nq] with the base so high that the lowest foot touches the floor."""
        gap_m = self.gap_m(qpos)
        if abs(gap_m) <= tolerance_m:
            return qpos
        lowered = qpos.copy()
        lowered[2] -= gap_m
        return lowered

    def bent(self, qpos: np.ndarray) -> bool:
        """Whether no leg is stretched or folded up in the pose `qpos` [nq]."""
        mj_data = self.skeleton.posed(qpos)
        thigh_w = mj_data.xanchor[list(self.skeleton.joints[1::3])]
        offsets = (self.tips_w(mj_data) - thigh_w) / self.reach_m[:, None]
        stretched = np.linalg.norm(offsets, axis=1) > STRETCHED_SHARE
        folded = offsets[:, 2] > -FOLDED_SHARE
        return not (stretched | folded).any()

    def stands(self, qpos: np.ndarray) -> bool:
        """Whether the robot that holds `qpos` [nq] still stands after a while."""
        return not self.falls(qpos)

    def falls(self, qpos: np.ndarray) -> str:
        """How the robot that holds `qpos` [nq] falls within a while; empty if it does
        not."""
        mj_model, joints = self.skeleton.mj_model, self.skeleton.joints
        mj_data = mujoco.MjData(mj_model)
        mj_data.qpos[:] = qpos
        servos = [actuators_of(mj_model, joint)[0] for joint in joints]
        mj_data.ctrl[servos] = qpos[self.skeleton.joint_qpos]
        steps = round(STANDING_S / mj_model.opt.timestep)
        mujoco.mj_step(mj_model, mj_data, nstep=steps)
        # MuJoCo starts a simulation that blows up again, its clock included.
        finished = mj_data.time > STANDING_S / 2
        if not finished:
            return "the simulation blows up"
        _, x, y, _ = mj_data.qpos[3:7]
        cosine = 1 - 2 * (x * x + y * y)
        if cosine <= 0.9:
            return f"it tilts by {np.degrees(np.arccos(max(cosine, -1.0))):.0f} degrees"
        if mj_data.qpos[2] <= 0.6 * qpos[2]:
            return f"its base sinks from {qpos[2]:.2f} to {mj_data.qpos[2]:.2f} m"
        return ""
