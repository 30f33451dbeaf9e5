"""A policy that was imported, exported as ours are: it comes back, and it walks."""

from __future__ import annotations

import io
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from gaitpref.cli.main import main
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.imported.bring import bring, understand
from policy.imported.meaning.draft import BY_TYPE, complete
from policy.imported.meaning.term_names import term_name
from policy.imported.observed import observed_as
from policy.imported.readers.script_file import read_script
from policy.law.law import LawError
from policy.networks.recipe import NetworkError
from policy.robots.shipped import WALK
from policy.training.checkpoint import Policy, load_policy
from policy.training.export_policy import law_of
from policy.training.setup import setting_of
from tests.helpers.others import GO2, HIMLOCO, needs_others
from tests.helpers.plain_walk import Frames, walked
from tests.helpers.short_program import values_of

onnxruntime = pytest.importorskip(
    "onnxruntime", reason="the extra export is not installed"
)
pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")


class _Normalised(nn.Module):
    """A network that divides, as those with a normaliser do."""

    def __init__(self) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(2)
        self.std = nn.Parameter(1 + torch.rand(1, 48, generator=generator))
        self.layer = nn.Linear(48, 12)

    def forward(self, x: Tensor) -> Tensor:
        return self.layer(x / self.std)


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


def test_an_imported_policy_that_is_exported_comes_back(tmp_path: Path) -> None:
    """Its network was a list of operations, which the trace writes otherwise."""
    source = tmp_path / "theirs.pt"
    torch.jit.save(torch.jit.script(_Normalised()), source)
    policy = bring(understand(source, preset="legged-gym-a1"), None, tmp_path / "in")
    out = _exported(tmp_path / "in" / "policy.pt", tmp_path / "out")
    _comes_back(policy, out)


@needs_others
def test_himloco_goes_out_and_comes_back_and_walks_by_its_json(tmp_path: Path) -> None:
    """Six frames; on plain motors it walks as it did when it was imported."""
    policy = bring(understand(HIMLOCO), GO2, tmp_path / "in")
    out = _exported(tmp_path / "in" / "policy.pt", tmp_path / "out")
    _comes_back(policy, out)
    told = json.loads((out / "policy.json").read_text())
    spec = mujoco.MjSpec.from_file(str(out / "robot.xml"))
    moved = walked(spec, told, _act(out), (0.5, 0.0, 0.0), 500)
    assert len(moved) == 500
    assert policy.info.origin is not None
    taken = policy.info.origin.acceptance[1].forward_m_s
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
    """Where the network is TorchScript, which says nothing of itself."""
    out = _exported(WALK, tmp_path / "out")
    (out / "policy.onnx").unlink()
    known = understand(out / "policy.pt")
    assert known.draft.source == str(out / "policy.json")
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
