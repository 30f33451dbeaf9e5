"""The env.yaml of a training: mjlab's, and Isaac Lab's with an order of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from data.features import JOINTS, LEGS
from policy.imported.bring import Understood, understand
from policy.imported.meaning.draft import RIGHT_FIRST, complete
from policy.imported.meaning.env_yaml import read_env
from policy.imported.whose_robot import robot_of
from policy.law.law import LawError
from policy.robots.robot import load_robot

MJLAB = """\
decimation: 4
scene:
  num_envs: 4096
  entities:
    robot:
      init_state:
        pos: !!python/tuple [0.0, 0.0, 0.278]
        joint_pos: {.*thigh_joint: 0.9, .*calf_joint: -1.8, .*R_hip_joint: 0.1,
          .*L_hip_joint: -0.1}
        joint_vel: {.*: 0.0}
      spec_fn: !!python/name:mjlab.asset_zoo.robots.go1_constants.get_spec ''
      articulation:
        actuators: !!python/tuple
        - target_names_expr: !!python/tuple [.*_hip_joint, .*_thigh_joint]
          transmission_type: !!python/object/apply:mjlab.actuator.TransmissionType
          - joint
          frictionloss: 0.1
          delay_max_lag: 2
          effort_limit: 23.7
          stiffness: 15.9
          damping: 1.0
        - target_names_expr: !!python/tuple [.*_calf_joint]
          frictionloss: 0.1
          effort_limit: 35.55
          stiffness: 35.8
          damping: 2.3
observations:
  actor:
    terms:
      base_ang_vel:
        func: !!python/name:mjlab.envs.mdp.observations.builtin_sensor ''
        params: {sensor_name: robot/imu_ang_vel}
        clip: null
        scale: null
        history_length: 0
      joint_pos:
        func: &id001 !!python/name:mjlab.envs.mdp.observations.joint_pos_rel ''
        history_length: 0
      actions: {func: !!python/name:mjlab.envs.mdp.observations.last_action ''}
      command:
        func: !!python/name:mjlab.envs.mdp.observations.generated_commands ''
        scale: !!python/tuple [2.0, 2.0, 0.25]
    concatenate_terms: true
    history_length: 2
  critic:
    terms: {joint_pos: {func: *id001}}
actions:
  joint_pos:
    clip: {.*_hip_joint: !!python/tuple [-0.5, 0.5]}
    actuator_names: !!python/tuple [.*]
    scale: {.*_hip_joint: 0.3, '[FR].*_thigh_joint': 0.37, .*_calf_joint: 0.25}
    offset: 0.0
    preserve_order: false
    use_default_offset: true
sim: {mujoco: {timestep: 0.004}}
harm: !!python/object/apply:os.system ['touch harmed']
"""
AGENT = "clip_actions: 10.0\nactor: {activation: tanh, class_name: MLPModel}\n"
GO1 = load_robot(physics_dt_s=0.005)


def _run(folder: Path, env: str, width: int = 60) -> Path:
    (folder / "params").mkdir(parents=True)
    states = {"mlp.0.weight": torch.zeros(12, width), "mlp.0.bias": torch.zeros(12)}
    torch.save({"actor_state_dict": states, "iter": 1}, folder / "model_1.pt")
    (folder / "params/env.yaml").write_text(env)
    (folder / "params/agent.yaml").write_text(AGENT)
    return folder


def _law(run: Path) -> Understood:
    return understand(run, robot=GO1)


def test_mjlabs_env_yaml_is_read(tmp_path: Path) -> None:
    """Joints are in the order of the robot's model; what a law has no place for is
    told, and nothing in the file is run."""
    known = _law(_run(tmp_path / "run", MJLAB))
    law = complete(known.draft, GO1, known.found.recipe.obs_dim)
    assert law.joints == RIGHT_FIRST
    assert [(t.name, t.frames) for t in law.terms] == [
        ("base_ang_vel", 2),
        ("joint_pos", 2),
        ("last_action", 2),
        ("command", 2),
    ]
    assert law.terms[3].scale == (2.0, 2.0, 0.25)
    assert law.default_joint_pos_rad[:6] == (0.1, 0.9, -1.8, -0.1, 0.9, -1.8)
    assert law.action_scale_rad == (0.3, 0.37, 0.25) * 4
    assert law.kp_nm_per_rad == (15.9, 15.9, 35.8) * 4
    assert law.kd_nm_s_per_rad == (1.0, 1.0, 2.3) * 4
    assert law.joint_friction_nm == 0.1
    assert law.torque_limit_nm == (23.7, 23.7, 35.55) * 4
    assert law.target_clip_rad is not None
    assert law.target_clip_rad[0] == (-0.5, 0.5)
    assert law.action_limit == 10.0
    assert (law.physics_dt_s, law.substeps) == (0.004, 4)
    assert known.draft.activation == "tanh"
    assert robot_of(known, None).xml is None
    other = _law(_run(tmp_path / "go2", MJLAB.replace("go1_", "go2_")))
    with pytest.raises(
        LawError, match=r"env.yaml names the robot go2, .* ships is a Go1"
    ):
        robot_of(other, None)
    assert "names the robot go2" in robot_of(other, Path("go1")).because
    assert known.draft.guessed.keys() == {"joints", "delay"}
    assert "2 time steps late" in known.draft.guessed["delay"]
    assert not Path("harmed").exists()


G23 = ("HipX", "HipY", "Knee")


def test_expressions_fit_the_models_own_names(tmp_path: Path) -> None:
    """Where joints are called after parts that only their maker knows."""
    env = MJLAB.replace("hip", "HipX").replace("thigh", "HipY").replace("calf", "Knee")
    path = _run(tmp_path / "run", env) / "params/env.yaml"
    with pytest.raises(LawError, match=r"HipY_joint' fits none .* --law takes it"):
        read_env(path)
    theirs = [f"{leg}_{part}_joint" for leg in LEGS for part in G23]
    spelled = dict(zip(JOINTS, theirs, strict=True))
    draft = read_env(path, spelled=spelled)
    assert draft.joints == JOINTS
    assert draft.default_joint_pos_rad == (0.1, 0.9, -1.8, -0.1, 0.9, -1.8) * 2


def test_an_order_that_is_kept_is_no_guess(tmp_path: Path) -> None:
    """As robot_lab lists its joints, for actions and observations."""
    names = [
        f"{leg}_{p}_joint" for leg in ("RL", "FR") for p in ("hip", "thigh", "calf")
    ]
    names += [n.replace("RL", "FL").replace("FR", "RR") for n in names]
    kept = f"{{joint_names: [{', '.join(names)}], preserve_order: true}}"
    env = MJLAB.replace(
        "actuator_names: !!python/tuple [.*]", f"joint_names: {kept[14:-23]}"
    )
    env = env.replace("preserve_order: false", "preserve_order: true")
    path = _run(tmp_path / "run", env) / "params/env.yaml"
    with pytest.raises(LawError, match="do not all list"):
        read_env(path)
    term = "joint_pos_rel ''\n"
    env = env.replace(term, f"{term}        params: {{asset_cfg: {kept}}}\n", 1)
    path.write_text(env)
    draft = read_env(path)
    assert draft.joints == tuple(name.removesuffix("_joint") for name in names)
    assert draft.default_joint_pos_rad is not None
    assert draft.default_joint_pos_rad[:4] == (-0.1, 0.9, -1.8, 0.1)
    assert "joints" not in draft.guessed


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("stiffness: 35.8", "x: 1", "does not say kp_nm_per_rad"),
        ("joint_pos: {.*thigh", "not: {.*thigh", "does not say default_joint_pos_rad"),
        ("      actions: {", "      phase: {", "sees 'phase'"),
        (
            "actions:\n  joint_pos",
            "actions:\n  a: {}\n  b",
            "actions are a, b .* --law takes it",
        ),
        ("  actor:", "  pixels:", "for the actor, but of pixels, critic"),
    ],
)
def test_what_an_env_yaml_does_not_say_is_named(
    old: str, new: str, told: str, tmp_path: Path
) -> None:
    """With what to give instead."""
    assert old in MJLAB
    run = _run(tmp_path / "run", MJLAB.replace(old, new, 1))
    with pytest.raises(LawError, match=told) as error:
        complete(_law(run).draft, GO1, 60)
    assert "\n" not in str(error.value)
