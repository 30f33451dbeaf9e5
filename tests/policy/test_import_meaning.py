"""What lies beside a policy of others is read as it was meant, or refused by name."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, get_args

import mujoco
import numpy as np
import pytest
import torch
import yaml
from torch import Tensor, nn

from gaitpref.cli.main import main
from gaitpref.cli.options.policy_options import Preset
from policy.imported.alternatives import against, others, tried
from policy.imported.bring import embodied, understand
from policy.imported.meaning.draft import BY_TYPE, LEFT_FIRST, RIGHT_FIRST
from policy.imported.meaning.trainer_laws import PRESETS
from policy.imported.plain_robot import plainer
from policy.imported.readers.onnx_file import read_onnx
from policy.imported.readers.script_file import read_script
from policy.law.encoder import Encoder
from policy.law.law import LawError
from policy.law.origin import Measured, verdict
from policy.robots.robot import load_robot, load_robot_xml
from tests.helpers.foreign_layouts import deploy_yaml, law_in

POSE = {".*L_hip_joint": 0.1, ".*R_hip_joint": -0.1, ".*thigh_joint": 0.8}
POSE[".*calf_joint"] = -1.5
GAINS = {"joint_names_expr": [".*"], "stiffness": 25.0, "damping": 0.5}


def _run(folder: Path, **changes: Any) -> Path:
    """A run directory of Isaac Lab: a checkpoint and its env.yaml."""
    generator = torch.Generator().manual_seed(0)
    states = {
        "actor.0.weight": 0.01 * torch.randn(12, 48, generator=generator),
        "actor.0.bias": torch.zeros(12),
        "std": torch.ones(12),
    }
    folder.mkdir(exist_ok=True)
    torch.save({"model_state_dict": states, "iter": 1}, folder / "model_1.pt")
    terms = ("base_lin_vel", "base_ang_vel", "projected_gravity", "generated_commands")
    terms += ("joint_pos_rel", "joint_vel_rel", "last_action")
    tree: dict[str, Any] = {
        "sim": {"dt": 0.005},
        "decimation": 4,
        "scene": {
            "robot": {
                "init_state": {"joint_pos": POSE},
                "actuators": {"legs": GAINS},
            }
        },
        "actions": {"joint_pos": {"scale": 0.25}},
        "observations": {"policy": {n: {"func": f"mdp:{n}"} for n in terms}},
    }
    (folder / "params").mkdir(exist_ok=True)
    (folder / "params" / "env.yaml").write_text(yaml.safe_dump(tree | changes))
    return folder


@pytest.mark.parametrize("law", [False, True])
def test_numbers_by_name_follow_another_order_of_the_joints(
    law: bool, tmp_path: Path
) -> None:
    """Whether it is tried, or said in a TOML."""
    run = _run(tmp_path / "run")
    (tmp_path / "law.toml").write_text(f"joints = {list(LEFT_FIRST)}")
    known = understand(run, law=tmp_path / "law.toml" if law else None)
    draft = known.draft if law else known.in_order(LEFT_FIRST)
    assert draft.joints == LEFT_FIRST
    assert draft.default_joint_pos_rad == (0.1, 0.8, -1.5, -0.1, 0.8, -1.5) * 2
    assert draft.action_offset_rad == draft.default_joint_pos_rad
    if not law:
        assert known.draft.joints == BY_TYPE
        # With a hip's angle in a knee, it falls before it has stood.
        assert "standing" not in next(tried(known, None))


OBSERVED = ("base_lin_vel", "base_ang_vel", "projected_gravity", "command")
OBSERVED += ("joint_pos", "joint_vel", "last_action")
DEPLOYED = (*OBSERVED[:3], "velocity_commands", "joint_pos_rel", "joint_vel_rel")
DEPLOYED += ("last_action",)


def test_a_whole_law_or_an_exported_onnx_does_without_an_env_yaml(
    tmp_path: Path,
) -> None:
    """Of another trainer it cannot be read; --explain leaves open what it says."""
    run = _run(tmp_path / "run", scene={})
    with pytest.raises(LawError, match=r"no scene\.robot .* --law takes it"):
        understand(run)
    assert "no scene.robot" in understand(run, explain=True).draft.source
    lines = ["default_joint_pos_rad = 0.1", "action_scale_rad = 0.25"]
    lines += ["kp_nm_per_rad = 20", "kd_nm_s_per_rad = 0.5"]
    lines += [f'[[terms]]\nname = "{name}"' for name in OBSERVED]
    (tmp_path / "law.toml").write_text("\n".join(lines))
    embodied(understand(run, law=tmp_path / "law.toml"), None)
    _exported(run / "run.onnx")
    draft = understand(run).draft
    assert draft.joints == RIGHT_FIRST
    assert draft.kp_nm_per_rad == (15.9,) * 12


def _exported(path: Path) -> None:
    """An ONNX with the metadata of mjlab."""
    onnx = pytest.importorskip("onnx", reason="the extra onnx is not installed")
    helper, sizes = onnx.helper, {"obs": [None, 48], "actions": [None, 12]}
    values = [helper.make_tensor_value_info(n, 1, s) for n, s in sizes.items()]
    weight = helper.make_tensor("w", 1, [48, 12], [0.0] * 48 * 12)
    node = helper.make_node("MatMul", ["obs", "w"], ["actions"])
    graph = helper.make_graph([node], "run", values[:1], values[1:], [weight])
    model = helper.make_model(graph)
    told = {"joint_names": ",".join(RIGHT_FIRST)}
    told["observation_names"] = ",".join(OBSERVED)
    numbers = {"default_joint_pos": "0.1", "action_scale": "0.3"}
    numbers |= {"joint_stiffness": "15.9", "joint_damping": "1.0"}
    told |= {name: ",".join([value] * 12) for name, value in numbers.items()}
    helper.set_model_props(model, told)
    onnx.save_model(model, path)


def test_names_that_fit_no_joint_are_told(tmp_path: Path) -> None:
    """ANYmal's spelling left every angle at 0."""
    robot = {
        "init_state": {"joint_pos": {".*HAA": 0.0, ".*F_HFE": 0.4}},
        "actuators": {
            "legs": {"joint_names_expr": [".*"], "stiffness": 80.0, "damping": 2.0}
        },
    }
    run = _run(tmp_path / "run", scene={"robot": robot})
    with pytest.raises(LawError, match=r"HFE' fits none .* --law takes it"):
        understand(run)


@pytest.mark.parametrize("file", ["env.yaml", "IO_descriptors.yaml"])
def test_absolute_angles_are_seen_as_such(file: str, tmp_path: Path) -> None:
    """A term called joint_pos is absolute where its function is."""
    path = "isaaclab.envs.mdp.observations:joint_pos"
    run = _run(tmp_path / "run", observations={"policy": {"joint_pos": {"func": path}}})
    if file == "IO_descriptors.yaml":
        told = {
            "actions": [{"joint_names": list(LEFT_FIRST), "scale": 0.25}],
            "articulations": {"robot": {"default_joint_pos": [0.1, 0.8, -1.5] * 4}},
            "observations": {"policy": [{"name": "joint_pos"}]},
        }
        (run / file).write_text(yaml.safe_dump(told))
    draft = understand(run).draft
    assert draft.terms is not None
    assert [term.name for term in draft.terms] == ["joint_pos_abs"]
    pose = draft.default_joint_pos_rad
    assert pose is not None
    assert draft.joints is not None
    law = law_in(draft.joints, terms=draft.terms, default_joint_pos_rad=pose)
    encoder = Encoder(law, 1, device=torch.device("cpu"))
    seen = encoder.observe(torch.full((1, 48), 0.2), torch.ones(1, dtype=torch.bool))
    assert seen[0, :12].tolist() == pytest.approx([angle + 0.2 for angle in pose])


def test_angles_within_their_limits_are_refused(tmp_path: Path) -> None:
    """No term has them, whatever the policy calls them."""
    told = {"joint_pos": {"func": "isaaclab.envs.mdp:joint_pos_limit_normalized"}}
    with pytest.raises(LawError, match="sees 'joint_pos_limit_normalized'"):
        understand(_run(tmp_path / "run", observations={"policy": told}))


def test_every_preset_can_be_typed() -> None:
    """And no other."""
    assert set(get_args(Preset)) == {*PRESETS}


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ([], "nothing says which robot"),
        (["--preset", "legged-gym-a1"], "legged-gym-a1 names the robot a1"),
        (
            ["spawn"],
            "params/env.yaml names the robot go2, and the robot that ships is a Go1",
        ),
    ],
)
def test_a_policy_is_tried_on_no_robot_that_nothing_names(
    said: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Least of all on the one that ships; the line says how to give another."""
    robot = {"init_state": {"joint_pos": POSE}, "actuators": {"legs": GAINS}}
    if said == ["spawn"]:
        robot["spawn"], said = {"usd_path": "omni://Robots/Unitree/Go2/go2.usd"}, []
    run = _run(tmp_path / "run", scene={"robot": robot})
    command = ["policy", "import", str(run), "--out", str(tmp_path / "out"), *said]
    assert main(command) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert "--robot SCENE.xml, or --robot go1" in line
    assert not (tmp_path / "out").exists()


class _Layer(nn.Module):
    def __init__(self, then: str) -> None:
        super().__init__()
        self.then = then
        self.w, self.b = nn.Parameter(torch.randn(12, 48)), nn.Parameter(torch.ones(12))

    def forward(self, x: Tensor) -> Tensor:
        if self.then == "matmul":
            return torch.matmul(x, self.w.t()) + self.b
        y = torch.addmm(self.b, x, self.w.t(), beta=0.5, alpha=2.0)
        if self.then == "gelu":
            return torch.nn.functional.gelu(y, approximate="tanh")
        return torch.nn.functional.softplus(y, beta=3.0, threshold=0.5)


@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
@pytest.mark.parametrize("then", ["matmul", "gelu", "softplus"])
def test_what_torchscript_gives_beyond_tensors_counts(then: str) -> None:
    """The width, the weights that train and the actions are those of the module."""
    module, file = _Layer(then), io.BytesIO()
    torch.jit.save(torch.jit.trace(module, torch.zeros(1, 48)), file)
    found = read_script(file.getvalue())
    assert found.recipe.obs_dim == 48
    assert {each.name for each in found.recipe.weights} >= {"w", "b"}
    obs = torch.randn(5, 48)
    with torch.no_grad():
        wanted = module(obs).numpy()
        assert found.network()(obs).numpy() == pytest.approx(wanted, abs=1e-4)


def test_gelu_and_layer_norm_in_pieces_are_followed() -> None:
    """As exporters write them where an ONNX's version has no operation for them."""
    onnx = pytest.importorskip("onnx", reason="the extra onnx is not installed")
    helper = onnx.helper
    steps = "ReduceMean obs=m; Sub obs m=d; Pow d two=q; ReduceMean q=v; Add v eps=e"
    steps += "; Sqrt e=s; Div d s=n; MatMul n w=y; Div y root=r; Erf r=f; Add f one=g"
    steps += "; Mul y g=h; Mul h half=actions"
    nodes = []
    for step in steps.split("; "):
        given, _, output = step.partition("=")
        op, *inputs = given.split()
        more = {"axes": [-1]} if op == "ReduceMean" else {}
        nodes.append(helper.make_node(op, inputs, [output], **more))
    weight, obs = torch.randn(48, 12), torch.randn(5, 48)
    numbers = {"two": 2.0, "eps": 1e-5, "root": 2**0.5, "one": 1.0, "half": 0.5}
    stored = [helper.make_tensor(n, 1, [], [v]) for n, v in numbers.items()]
    stored.append(helper.make_tensor("w", 1, [48, 12], weight.flatten().tolist()))
    sizes = {"obs": [None, 48], "actions": [None, 12]}
    values = [helper.make_tensor_value_info(n, 1, s) for n, s in sizes.items()]
    graph = helper.make_graph(nodes, "pieces", values[:1], values[1:], stored)
    network = read_onnx(helper.make_model(graph).SerializeToString()).network()
    norm, gelu = nn.functional.layer_norm, nn.functional.gelu
    wanted = gelu(norm(obs, (48,)) @ weight).numpy()
    with torch.no_grad():
        assert network(obs).numpy() == pytest.approx(wanted, abs=1e-4)


def test_every_other_value_of_a_guess_is_tried(tmp_path: Path) -> None:
    """Of a checkpoint with a TOML that leaves open what rules give, and of a preset."""
    run = _run(tmp_path / "run", scene={})
    lines = ["default_joint_pos_rad = 0.1", "action_scale_rad = 0.25"]
    lines += ["kp_nm_per_rad = 20", "kd_nm_s_per_rad = 0.5"]
    lines += [f'[[terms]]\nname = "{name}"' for name in OBSERVED]
    (tmp_path / "law.toml").write_text("\n".join(lines))
    sizes = {"actor.0": (16, 48), "actor.2": (12, 16)}
    states = {f"{name}.weight": torch.zeros(size) for name, size in sizes.items()}
    states |= {f"{name}.bias": torch.zeros(size[0]) for name, size in sizes.items()}
    torch.save({"model_state_dict": states}, run / "model_2.pt")
    known = understand(run, law=tmp_path / "law.toml")
    told = dict(others(known))
    assert list(told) == [
        "joints FR FL RR RL, leg by leg",
        "joints all hips, thighs, calves",
        "an action every 10 ms",
        "an action every 40 ms",
        "physics of 2.5 ms",
        "activation relu",
        "activation tanh",
    ]
    assert told["an action every 10 ms"].draft.substeps == 2
    ops = [node.op for node in told["activation tanh"].found.recipe.nodes]
    assert ops == ["Gemm", "Tanh", "Gemm"]
    (tmp_path / "order.toml").write_text(f"joints = {list(RIGHT_FIRST)}")
    known = understand(run, preset="legged-gym-go2", law=tmp_path / "order.toml")
    assert known.draft.default_joint_pos_rad is not None
    assert known.draft.default_joint_pos_rad[:4] == (-0.1, 0.8, -1.5, 0.1)
    told = dict(others(known))
    assert [name.split(" (")[0] for name in told] == [
        "pose of a Go1",
        "pose with hips at 0",
        "hips at half their scale",
    ]
    assert told["hips at half their scale"].draft.action_scale_rad == (
        (0.125, 0.25, 0.25) * 4
    )


def test_guessed_limits_of_torque_are_tried_smaller_and_larger(tmp_path: Path) -> None:
    """Those of the model are meant where a file says none: half of them, and more."""
    run = _run(tmp_path / "run", scene={})
    (run / "params" / "deploy.yaml").write_text(
        deploy_yaml(
            joint_ids_map=[3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8],
            default_joint_pos=[0.1, 0.8, -1.5] * 4,
            observations={name: {} for name in DEPLOYED},
        )
    )
    known = understand(run)
    assert "torque_limit_nm" in known.draft.guessed
    law, robot, _ = embodied(known, None)
    limits = robot.torque_limit[law.from_canonical]
    told = dict(others(known, limits))
    half = told["torques up to half the model's"]
    more = told["torques up to 1.5 times the model's"]
    _, weak, _ = embodied(half, None)
    assert weak.torque_limit == pytest.approx(robot.torque_limit / 2)
    assert more.draft.torque_limit_nm == pytest.approx(tuple(1.5 * limits))
    assert any(line.startswith("torques up to half") for line in tried(known, None))
    assert not any("torques" in name for name in dict(others(known, limits * np.inf)))


def test_figures_say_where_they_tell_guesses_apart() -> None:
    """A guess that walks as well stays one, unless turning tells them apart."""

    def walk(
        forward_m_s: float, turns: float = 1.0, fell_at_s: float | None = None
    ) -> tuple[Measured, Measured]:
        one = _done(0.5, 0.0, forward_m_s, 0.0)
        return one, _done(0.0, 1.0, 0.0, turns, fell_at_s)

    assert "do not tell them apart" in against(walk(0.52), walk(0.48))
    assert against(walk(0.3), walk(0.48)) == ""
    assert "closer" in against(walk(0.49), walk(0.3))
    assert "closer" in against(walk(0.5, turns=0.9), walk(0.5, turns=0.4))
    assert against(walk(0.5, turns=0.4), walk(0.5, turns=0.9)) == ""
    falls = walk(0.5, fell_at_s=3.0)
    assert against(falls, walk(0.5)) == ""
    assert against(walk(0.5), falls) == ", and what was taken falls"
    assert "closer" in against(falls, walk(0.3, fell_at_s=2.0))


def _done(
    forward: float,
    yaw: float,
    forward_m_s: float,
    yaw_rad_s: float,
    fell_at_s: float | None = None,
) -> Measured:
    """What came of a command."""
    return Measured(
        command=(forward, 0.0, yaw),
        seconds=2.0,
        forward_m_s=forward_m_s,
        left_m_s=0.0,
        yaw_rad_s=yaw_rad_s,
        fell_at_s=fell_at_s,
    )


def test_the_verdict_speaks_of_all_that_was_asked() -> None:
    """Who walks and does not turn is told so; who does not walk is not accepted."""
    stands, walks = _done(0.0, 0.0, 0.0, 0.0), _done(0.5, 0.0, 0.42, 0.0)
    fast, turns = _done(1.0, 0.0, 0.9, 0.0), _done(0.0, 0.5, 0.0, 0.4)
    assert verdict((stands, walks, fast, turns)) == "accepted"
    still, slow = _done(0.0, 0.5, 0.0, 0.007), _done(1.0, 0.0, 0.8, 0.1)
    told = verdict((stands, walks, slow, still))
    assert told == "accepted but for: 1.0 m/s (0.80), turning 0.5 rad/s (0.01)"
    drifts, falls = _done(0.0, 0.0, 0.0, 0.3), _done(0.5, 0.0, 0.1, 0.0, 1.2)
    told = verdict((drifts, falls, fast, turns))
    assert told == (
        "not accepted, for: standing (turning 0.30 rad/s), 0.5 m/s (fell at 1.2 s)"
    )


def test_a_robot_is_tried_as_trainers_have_it() -> None:
    """Each thing that only its model has is left out by itself."""
    shipped = load_robot(physics_dt_s=0.005)
    spec = mujoco.MjSpec.from_string(shipped.mjcf)
    spec.geoms[-1].condim = 6
    spec.compile()
    robot = load_robot_xml(spec.to_xml(), name="go1", physics_dt_s=0.005)
    assert robot.mj_model.geom_condim.max() == 6
    (feet, sliding), (joints, smooth) = plainer(robot)
    assert "condim" in feet
    assert sliding.mj_model.geom_condim.max() == 3
    dofs = robot.qvel_adr
    before = robot.mj_model.dof_frictionloss[dofs]
    assert (sliding.mj_model.dof_frictionloss[dofs] == before).all()
    assert "not 1)" in joints
    assert not smooth.mj_model.dof_frictionloss[dofs].any()
    assert (smooth.home_qpos == robot.home_qpos).all()
