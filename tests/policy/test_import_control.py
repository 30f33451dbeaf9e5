"""Imported policies of others against plain MuJoCo: the import adds no error."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import torch
import yaml

from policy.imported.bring import bring, understand
from policy.law.origin import Measured
from tests.helpers.others import GO2, ROBOT_LAB, needs_others
from tests.helpers.plain_walk import walked

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
SEEN = {"base_ang_vel": 0.25, "projected_gravity": 1.0, "command": 1.0}
SEEN |= {"joint_pos": 1.0, "joint_vel": 0.05, "last_action": 1.0}
"""What robot_lab's network sees, and its scales, by the names of a policy.json."""


@pytest.fixture(scope="module")
def brought(tmp_path_factory: pytest.TempPathFactory) -> dict[Any, Measured]:
    """What the import measured, by command."""
    policy = bring(understand(ROBOT_LAB), GO2, tmp_path_factory.mktemp("in"))
    assert policy.info.origin is not None
    return {each.command: each for each in policy.info.origin.acceptance}


def _told() -> dict[str, Any]:
    """Its two files of numbers in the words of a policy.json, put over by hand."""
    config = yaml.safe_load(ROBOT_LAB.with_name("config.yaml").read_text())
    base = yaml.safe_load((ROBOT_LAB.parents[1] / "base.yaml").read_text())
    config, base = config["go2/robot_lab"], base["go2"]
    part = {"clip": None, "frames": 1}
    return {
        "observation": [{"name": n, "scale": s, **part} for n, s in SEEN.items()],
        "law_record": {"by_term": True, "newest_first": False, "obs_limit": 100.0},
        "joint_names": base["joint_names"],
        "physics_dt_s": base["dt"],
        "control_dt_s": base["dt"] * base["decimation"],
        "kp_nm_per_rad": config["rl_kp"],
        "kd_nm_s_per_rad": config["rl_kd"],
        "torque_limit_nm": config["torque_limits"],
        "home_joint_pos_rad": config["default_dof_pos"],
        "home_base_height_m": 0.34,
        "action_offset_rad": config["default_dof_pos"],
        "action_scale_rad": config["action_scale"],
        "action_limit": 100.0,
        "target_clip_rad": None,
    }


def _walked(spec: Any, command: tuple[float, float, float]) -> np.ndarray:
    """Mean speeds over 8 s; the network is run by torch as it came."""
    network = torch.jit.load(ROBOT_LAB)

    def act(obs: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return network(torch.from_numpy(obs))[0].numpy()

    moved = walked(spec, _told(), act, command, 500)
    assert len(moved) == 500
    return moved[100:].mean(axis=0)


@needs_others
@pytest.mark.parametrize(
    "command", [(0.5, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.0, 1.0)]
)
def test_an_import_walks_as_its_network_does_in_plain_mujoco(
    command: tuple[float, float, float], brought: dict[Any, Measured]
) -> None:
    """On the same model: what it lacks of its command is no fault of the import."""
    plain = _walked(mujoco.MjSpec.from_file(str(GO2)), command)
    row = brought[command]
    assert row.fell_at_s is None
    found = (row.forward_m_s, row.left_m_s, row.yaw_rad_s)
    assert found == pytest.approx(tuple(plain), abs=0.05)


@needs_others
@pytest.mark.parametrize(
    ("command", "column", "named"),
    [
        ((0.5, 0.0, 0.0), 0, 0.50),
        ((1.0, 0.0, 0.0), 0, 1.02),
        ((0.0, 0.0, 1.0), 2, 1.01),
    ],
)
def test_the_figures_named_elsewhere_are_of_a_plainer_robot(
    command: tuple[float, float, float], column: int, named: float
) -> None:
    """Feet that do not resist rolling, joints without dry friction."""
    spec = mujoco.MjSpec.from_file(str(GO2))
    for geom in spec.geoms:
        if geom.condim > 3:
            geom.condim, geom.solimp = 3, [0.9, 0.95, 0.001, 0.5, 2.0]
    for joint in spec.joints:
        joint.frictionloss = 0.0
    found = _walked(spec, command)[column]
    assert found == pytest.approx(named, abs=0.06)
