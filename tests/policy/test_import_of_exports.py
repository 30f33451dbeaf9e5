"""A policy that was imported, exported as ours are: it comes back, and it walks."""

from __future__ import annotations

import io
import json
import warnings
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from gaitpref.cli.main import main
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.exported.policy_json import law_of
from policy.imported.bring import bring, understand
from policy.imported.meaning.draft import BY_TYPE, complete
from policy.imported.meaning.term_names import term_name
from policy.imported.observed import observed_as
from policy.imported.readers.onnx_file import read_onnx
from policy.imported.readers.script_file import read_script
from policy.imported.whose_robot import robot_of
from policy.law.law import LawError
from policy.networks.recipe import NetworkError, Node, Stored
from policy.robots.shipped import WALK
from policy.training.checkpoint import Policy, load_policy, payload_bytes
from policy.training.setup import setting_of
from tests.helpers.others import CPP_DEPLOY, GO2, HIMLOCO, needs_others
from tests.helpers.plain_walk import Frames, walked
from tests.helpers.short_program import values_of

onnxruntime = pytest.importorskip(
    "onnxruntime", reason="the extra export is not installed"
)
pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")


class _Estimating(nn.Module):
    """A network that divides, as those with a normaliser do, and whose actor sees part
    of the observation, an estimate and a unit vector, as himloco's."""

    def __init__(self) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(2)
        self.std = nn.Parameter(1 + torch.rand(1, 48, generator=generator))
        self.encoder = nn.Linear(48, 11)
        self.layer = nn.Linear(36 + 3 + 8, 12)

    def forward(self, x: Tensor) -> Tensor:
        x = x / self.std
        seen = self.encoder(x)
        unit = nn.functional.normalize(seen[..., 3:], dim=-1)
        return self.layer(torch.cat((x[:, :36], seen[..., :3], unit), dim=-1))


def _saved(module: nn.Module, folder: Path) -> tuple[Path, Path]:
    """As TorchScript, and as the ONNX that torch's older exporter writes."""
    torch.jit.save(torch.jit.script(module), folder / "theirs.pt")
    with warnings.catch_warnings():
        # The exporter warns of its own end.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module.eval(),
            (torch.zeros(1, 48),),
            folder / "theirs.onnx",
            opset_version=17,
            dynamo=False,
            input_names=["obs"],
            output_names=["actions"],
        )
    return folder / "theirs.pt", folder / "theirs.onnx"


def _exported(policy: Path, out: Path) -> Path:
    assert main(["export", "--policy", str(policy), "--out", str(out)]) == 0
    return out


def _comes_back(policy: Policy, out: Path) -> None:
    """Under the same law, to 1e-5, as TorchScript and as ONNX."""
    before = policy.info.env.law
    assert before is not None
    obs = torch.randn(64, before.obs_dim, generator=torch.Generator().manual_seed(3))
    for name in ("policy.pt", "policy.onnx"):
        known = understand(out / name)
        law = complete(known.draft, policy.robot(), known.found.recipe.obs_dim)
        assert law.terms == before.terms
        assert law.joints == before.joints
        network = known.found.network(tuple(int(joint) for joint in law.to_canonical))
        with torch.no_grad():
            acted = network(obs).numpy()
        limit = before.action_limit
        wanted = policy(obs).clamp(-limit, limit).numpy()
        assert acted == pytest.approx(wanted, abs=1e-5), name


def test_an_imported_policy_that_is_exported_comes_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its network was a list of operations, which the trace writes otherwise; as it was
    saved before whole numbers were settled, it goes out too. What torch cannot write is
    one line, and no directory."""
    script, file = _saved(_Estimating(), tmp_path)
    known = understand(file, preset="legged-gym-a1")
    assert not any(each.dtype == "int64" for each in known.found.recipe.constants)
    before = replace(known, found=read_onnx(file.read_bytes()))
    assert any(each.dtype == "int64" for each in before.found.recipe.constants)
    policy = bring(before, None, tmp_path / "in")
    obs = torch.randn(8, 48, generator=torch.Generator().manual_seed(3))
    for each in (known, understand(script, preset="legged-gym-a1"), before):
        network = each.found.network()
        assert policy.network(obs).detach().numpy() == pytest.approx(
            network(obs)[:, policy.network.order].detach().numpy(), abs=1e-5
        )
    out = _exported(tmp_path / "in" / "policy.pt", tmp_path / "out")
    _comes_back(policy, out)
    bad = _growing(policy, tmp_path / "bad.pt")
    capsys.readouterr()
    arguments = ["export", "--policy", str(bad), "--out", str(tmp_path / "none")]
    assert main(arguments) == 2
    told = capsys.readouterr().err.strip()
    assert "torch cannot write this policy as" in told
    assert "--like SOURCE" in told
    assert "\n" not in told
    assert not (tmp_path / "none").exists()


def _growing(policy: Policy, file: Path) -> Path:
    """`policy` with a row that is made as many as there are observations."""
    recipe = policy.info.ppo.recipe
    assert recipe is not None
    nodes = (
        Node(op="Shape", inputs=(recipe.output,), output="n"),
        Node(op="Expand", inputs=("row", "n"), output="grown"),
        Node(op="Add", inputs=(recipe.output, "grown"), output="more"),
    )
    row = Stored(name="row", shape=(1, 12))
    constants = (*recipe.constants, row)
    recipe = replace(
        recipe, nodes=(*recipe.nodes, *nodes), output="more", constants=constants
    )
    info = replace(policy.info, ppo=replace(policy.info.ppo, recipe=recipe))
    states = policy._actor.state_dict()
    states[f"mlp.c{len(constants) - 1}"] = torch.zeros(1, 12)
    file.write_bytes(payload_bytes({"actor_state_dict": states}, info))
    return file


@needs_others
@pytest.mark.parametrize("source", [HIMLOCO, CPP_DEPLOY], ids=["himloco", "cpp_deploy"])
def test_those_of_others_go_out_and_come_back_and_walk_by_their_json(
    source: Path, tmp_path: Path
) -> None:
    """Six frames, and five of an ONNX that slices; on plain motors they walk as they
    did when they were imported, within 0.1 m/s of what was measured of them."""
    policy = bring(understand(source), GO2, tmp_path / "in")
    assert policy.info.origin is not None
    stood, went = policy.info.origin.acceptance[:2]
    assert stood.follows
    assert went.follows
    taken = went.forward_m_s
    assert taken == pytest.approx(0.45, abs=0.1)
    out = _exported(tmp_path / "in" / "policy.pt", tmp_path / "out")
    _comes_back(policy, out)
    told = json.loads((out / "policy.json").read_text())
    spec = mujoco.MjSpec.from_file(str(out / "robot.xml"))
    moved = walked(spec, told, _act(out), (0.5, 0.0, 0.0), 500)
    assert len(moved) == 500
    assert moved[100:, 0].mean() == pytest.approx(taken, abs=0.05)


def _act(out: Path):
    session = onnxruntime.InferenceSession(
        str(out / "policy.onnx"), providers=["CPUExecutionProvider"]
    )
    return lambda obs: session.run(None, {"obs": obs})[0][0]


SEEN = f"""
joints = {json.dumps([f"{name}_joint" for name in BY_TYPE])}
newest_first = true
obs_limit = 1.5
kp_nm_per_rad = 20.0
terms = [
  {{ name = "gyro", scale = 0.25, frames = 3 }},
  {{ name = "dof_vel", scale = 0.05, clip = [-2.0, 0.2], frames = 2 }},
  {{ name = "projected_gravity", scale = 2.0, clip = [-0.9, 0.5], frames = 3 }},
  {{ name = "commands", scale = [2.0, 2.0, 0.25] }},
  {{ name = "joint_pos", frames = 3 }},
  {{ name = "last_action" }},
]
"""
"""What a new policy is to see, in another order of joints than ours."""


def test_a_history_is_rebuilt_from_the_json_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A few lines that read policy.json see what the environment of the training saw,
    frames, scales and clips of its own terms, and ask for the same actions."""
    (tmp_path / "seen.toml").write_text(SEEN)
    arguments = ["train", "--out", str(tmp_path / "run"), "--reward", "task"]
    arguments += ["--steps", "96", "--envs", "4"]
    arguments += ["--observe", str(tmp_path / "seen.toml")]
    assert main(arguments) == 0
    left = " ".join(capsys.readouterr().err.split())
    assert "acts as ours do, so this is not taken over: kp_nm_per_rad" in left
    out = _exported(tmp_path / "run" / "policy.pt", tmp_path / "out")
    told = json.loads((out / "policy.json").read_text())
    policy = load_policy(tmp_path / "run" / "policy.pt")
    _comes_back(policy, out)
    robot, command, act = policy.robot(), (0.5, 0.0, 0.1), _act(out)
    law = policy.info.env.law
    assert law is not None
    assert law.joints == BY_TYPE
    assert law.newest_first
    # As a loop with it as --base does.
    assert setting_of(tmp_path / "run" / "policy.pt", None).env.law == law
    for file in (out / "policy.json", tmp_path / "run" / "policy.pt"):
        assert observed_as(file, robot, EnvCfg()) == (law, [])
    order, back = law.from_canonical, law.to_canonical
    env = QuadrupedEnv(robot, policy.info.env, 1, seed=4)
    env.fix_commands(torch.tensor([command]))
    mj_data, frames, last = mujoco.MjData(robot.mj_model), Frames(told), np.zeros(12)
    addresses = robot.qpos_adr[order], robot.qvel_adr[order]
    seen, parts = np.zeros((1, 0)), {}
    for _ in range(10):
        mj_data.qpos[:], mj_data.qvel[:] = (rows[0] for rows in env.sim.raw_state())
        parts = values_of(told, mj_data, *addresses, last, command)
        seen = frames.row(parts)
        obs = env.get_observations()["policy"]
        assert seen == pytest.approx(obs.numpy(), abs=1e-4)
        last = act(seen)
        assert last == pytest.approx(policy(obs)[0, order].numpy(), abs=1e-4)
        env.step(torch.from_numpy(last[back])[None])
    assert not np.allclose(seen[0, :3], seen[0, 3:6])
    # Of velocities of more than 0.2 rad/s, 0.05 times that is left.
    assert parts["joint_vel"].max() > 0.2
    assert seen[0, 9:33].max() == pytest.approx(0.01)
    assert seen[0, 35] == -1.5
    assert seen[0, 42:45] == pytest.approx([1.0, 0.0, 0.025])
    (tmp_path / "seen.toml").write_text(SEEN.replace("scale = 2.0", "scale = 1.5"))
    assert main([*arguments, "--resume", "--history", "2"]) == 2
    assert "a file says the frames" in " ".join(capsys.readouterr().err.split())
    assert main([*arguments, "--resume"]) == 2
    refused = " ".join(capsys.readouterr().err.split())
    assert "other settings (env.law.terms.2.scale.0 2.0 -> 1.5)" in refused


def test_a_gait_is_seen_as_the_file_says_it(tmp_path: Path) -> None:
    """With the terms that need it."""
    (tmp_path / "seen.toml").write_text(
        'before = "zeros"\n[[terms]]\nname = "gait_clock"\nframes = 2\n'
        "[gait]\nfrequency_hz = 2.0\n"
    )
    robot = load_policy(WALK).robot()
    law, left = observed_as(tmp_path / "seen.toml", robot, EnvCfg())
    assert law.gait is not None
    assert (law.gait.frequency_hz, law.before, law.obs_dim) == (2.0, "zeros", 8)
    assert left == []


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("imuu", None, "give all, imu, or a file that is there"),
        ("seen.yaml", "", "is said by a TOML"),
        ("seen.toml", "obs_limit = 5.0", "says no terms"),
        ("seen.toml", 'terms = [{ name = "height_scan" }]', "a scan of heights"),
        ("seen.toml", 'terms = [{ name = "gyro", scal = 2 }]', "has no 'scal'"),
        ("seen.json", "{}", "names no law"),
        ("policy.pt", WALK, "sees all there is: leave --observe out"),
    ],
)
def test_what_cannot_be_seen_is_told(
    name: str, text: str | Path | None, told: str, tmp_path: Path
) -> None:
    """Before anything is trained."""
    if isinstance(text, Path):
        (tmp_path / name).write_bytes(text.read_bytes())
    elif text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(LawError, match=told):
        observed_as(tmp_path / name, load_policy(WALK).robot(), EnvCfg())


class _Rounding(nn.Module):
    def forward(self, x: Tensor) -> Tensor:
        return torch.div(x, 2.0, rounding_mode="floor") @ torch.ones(48, 12)


def test_a_network_that_rounds_where_it_divides_is_refused() -> None:
    """What a plain division would make of it are other actions."""
    file = io.BytesIO()
    torch.jit.save(torch.jit.trace(_Rounding(), torch.zeros(1, 48)), file)
    with pytest.raises(NetworkError, match="rounds where it divides"):
        read_script(file.getvalue())


def test_a_policy_json_beside_a_network_says_what_its_numbers_mean(
    tmp_path: Path,
) -> None:
    """Where the network is TorchScript, which says nothing of itself; and whose robot
    it is, which lies there too."""
    out = _exported(WALK, tmp_path / "out")
    (out / "policy.onnx").unlink()
    known = understand(out / "policy.pt")
    assert known.draft.source == str(out / "policy.json")
    assert robot_of(known, None).xml == out / "robot.xml"
    (out / "robot.xml").unlink()
    assert robot_of(known, None).xml is None
    other = replace(known, draft=replace(known.draft, robot="unitree_go2"))
    with pytest.raises(
        LawError, match=r"names the robot unitree_go2, .* ships is a Go1: give"
    ):
        robot_of(other, None)
    policy = load_policy(WALK)
    law = complete(known.draft, policy.robot(), known.found.recipe.obs_dim)
    assert law == law_of(policy.info, policy.robot())
    (out / "policy.json").unlink()
    assert understand(out / "policy.pt").draft.terms is None


class _Seeing(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.eye = nn.Conv1d(1, 1, 5, padding=2)
        self.layer = nn.Linear(48, 12)

    def forward(self, x: Tensor) -> Tensor:
        return self.layer(self.eye(x.unsqueeze(1)).squeeze(1))


@pytest.mark.parametrize(
    "kind",
    ["TorchScript", "ONNX", "cnns.camera.0.weight", "actor_cnns.camera.0.weight"],
)
def test_a_network_that_looks_at_pictures_is_refused(kind: str, tmp_path: Path) -> None:
    """By name, whatever file it is in."""
    file = tmp_path / ("policy.onnx" if kind == "ONNX" else "model_1.pt")
    match kind:
        case "TorchScript":
            torch.jit.save(torch.jit.script(_Seeing()), file)
        case "ONNX":
            onnx = pytest.importorskip("onnx", reason="the extra onnx is not installed")
            helper, sizes = onnx.helper, {"obs": [1, 48], "actions": [1, 12]}
            values = [helper.make_tensor_value_info(n, 1, s) for n, s in sizes.items()]
            node = helper.make_node("Conv", ["obs", "w"], ["actions"])
            weight = helper.make_tensor("w", 1, [1, 1, 5], [0.0] * 5)
            graph = helper.make_graph([node], "p", values[:1], values[1:], [weight])
            onnx.save_model(helper.make_model(graph), file)
        case name:
            # As a checkpoint of rsl_rl calls it.
            states = {name: torch.zeros(1, 1, 3, 3), "std": torch.ones(12)}
            torch.save({"model_state_dict": states}, file)
    with pytest.raises(NetworkError, match="looks at pictures"):
        understand(file, preset="legged-gym-a1")


@pytest.mark.parametrize(
    "name", ["rgb_image", "depth_camera", "front_camera", "image_features"]
)
def test_a_term_of_a_camera_is_refused(name: str) -> None:
    """Before any network is looked at."""
    with pytest.raises(LawError, match=f"sees a camera .*{name}"):
        term_name(name)
