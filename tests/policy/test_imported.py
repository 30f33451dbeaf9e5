"""A policy of ours in every layout of others, brought in again: the same actions.

Actions are compared to 1e-5 for equal states of the robot, seen through what each
layout says: another order of joints, scales, frames.
"""

from __future__ import annotations

import itertools
import json
import pickle
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from torch import Tensor, nn

from data.errors import GaitprefError
from data.features import column
from gaitpref.cli.main import main
from gaitpref.console import progress
from policy.env.env import QuadrupedEnv
from policy.env.env_cfg import EnvCfg
from policy.env.own_law import OWN_TERMS
from policy.imported.bring import Understood, bring, understand
from policy.imported.given_back import export_like
from policy.imported.meaning.draft import BY_TYPE, LEFT_FIRST, RIGHT_FIRST, complete
from policy.imported.meaning.own_words import of_own
from policy.imported.readers.onnx_file import read_onnx
from policy.law.encoder import Encoder
from policy.law.law import WIDTHS, Law, LawError, Term
from policy.law.origin import verdict
from policy.networks.recipe import NetworkError
from policy.robots.robot import load_robot
from policy.training.checkpoint import Policy, PolicyError, load_policy
from policy.training.ppo import PpoCfg
from policy.training.setup import setting_of
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.foreign_layouts import (
    TERMS,
    checkpoint_of,
    in_their_order,
    law_in,
    toml_of,
    vectors_of,
)

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
DT_S = EnvCfg().physics_dt_s
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Policy:
    """A policy of two iterations: its normaliser and its noise are no defaults."""
    ppo = PpoCfg(num_envs=16, hidden_sizes=(16, 8))
    cfg = TrainCfg(steps=2 * ppo.steps_per_iteration, env=EnvCfg(), ppo=ppo)
    robot = load_robot(physics_dt_s=DT_S)
    return load_policy(train(tmp_path_factory.mktemp("ours"), robot, cfg).policy)


def _same_actions(ours: Policy, theirs: Policy, tolerance: float = 1e-5) -> None:
    """Both act alike where the robot does alike."""
    own = torch.randn(64, 48, generator=torch.Generator().manual_seed(3))
    law = theirs.info.env.law
    assert law is not None
    seen = Encoder(law, 64, device=CPU).observe(
        own, begins=torch.ones(64, dtype=torch.bool)
    )
    assert theirs(seen).numpy() == pytest.approx(ours(own).numpy(), abs=tolerance)


@pytest.mark.parametrize("layout", ["1", "2.3", "3", "4", "5"])
def test_a_checkpoint_of_every_rsl_rl_gives_the_same_actions(
    layout: str, ours: Policy, tmp_path: Path
) -> None:
    """With joints in another order, and scales where there is no normaliser; what goes
    out again in its layout is the same file with other weights."""
    scaled = layout == "1"
    torch.save(checkpoint_of(ours, layout, BY_TYPE), tmp_path / "model_1.pt")
    torch.save(checkpoint_of(ours, layout, BY_TYPE), tmp_path / "model_12.pt")
    (tmp_path / "law.toml").write_text(toml_of(ours, BY_TYPE, scaled=scaled))
    known = understand(tmp_path, law=tmp_path / "law.toml")
    assert known.file.name == "model_12.pt"
    policy = bring(known, None, tmp_path / "in")
    _same_actions(ours, policy)
    assert policy.std.numpy() == pytest.approx(ours.std.numpy(), abs=1e-6)
    with torch.no_grad():
        policy.network.w0.mul_(2.0)  # type: ignore[union-attr,operator]
    back = torch.load(export_like(policy, tmp_path, tmp_path / "out"))
    before = torch.load(tmp_path / "model_12.pt")
    part = "model_state_dict" if "model_state_dict" in back else "actor_state_dict"
    assert back.keys() == before.keys()
    assert back[part].keys() == before[part].keys()
    for name, value in back[part].items():
        doubled = 2.0 if name in ("actor.0.weight", "mlp.0.weight") else 1.0
        assert value.numpy() == pytest.approx(
            doubled * before[part][name].numpy(), abs=1e-6
        )


A1, GO1 = ((0.1, 0.8, -1.5), (-0.1, 1.0, -1.5)), ((-0.1, 0.9, -1.8), (0.1, 0.9, -1.8))
"""Default angles of the front left and the rear right leg."""
GYM = "base_lin_vel*2 base_ang_vel*.25 projected_gravity command*2,2,.25 joint_pos"
GYM += " joint_vel*.05 last_action"
BODY, LEG = "base_ang_vel projected_gravity", "joint_pos joint_vel last_action"
PRESETS = {
    "legged-gym-a1": ("1", LEFT_FIRST, GYM, A1, 20.0),
    "legged-gym-go2": ("1", LEFT_FIRST, GYM, A1, 20.0),
    "isaac-lab-go2-flat": (
        "3",
        BY_TYPE,
        f"base_lin_vel {BODY} command {LEG}",
        A1,
        25.0,
    ),
    "unitree-rl-lab-go2": (
        "1",
        BY_TYPE,
        "base_ang_vel*.2 projected_gravity command joint_pos joint_vel*.05 last_action",
        A1,
        25.0,
    ),
    "unitree-rl-mjlab-go2": ("4", LEFT_FIRST, f"{BODY} command {LEG}", GO1, 20.0),
    "mjlab-go1-flat": (
        "5",
        RIGHT_FIRST,
        f"base_lin_vel {BODY} {LEG} command",
        GO1,
        15.9,
    ),
}
"""Version of rsl_rl, order, terms with scales, default angles, stiffness of a hip."""


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_by_name_gives_the_same_actions(
    preset: str, ours: Policy, tmp_path: Path
) -> None:
    """Of a policy of ours in the layout of its trainer."""
    layout, order, told, pose, kp = PRESETS[preset]
    named = [each.partition("*") for each in told.split()]
    terms = tuple(
        Term(name=name, scale=tuple(map(float, scale.split(","))) if scale else (1.0,))
        for name, _, scale in named
    )
    torch.save(checkpoint_of(ours, layout, order, terms), tmp_path / "model_1.pt")
    law = _acts_alike(ours, understand(tmp_path, preset=preset))
    angles = law.canonical(law.default_joint_pos_rad)
    assert (tuple(angles[3:6]), tuple(angles[6:9])) == pose
    assert law.canonical(law.kp_nm_per_rad)[0] == kp


def test_a_run_of_mjlab_gives_the_same_actions(ours: Policy, tmp_path: Path) -> None:
    """Its joints in the order of the robot's model, which no file says."""
    (tmp_path / "params").mkdir()
    torch.save(checkpoint_of(ours, "5", RIGHT_FIRST), tmp_path / "model_1.pt")
    tree = _env_tree(ours)
    robot, observed = tree["scene"]["robot"], tree["observations"]["policy"]
    (gains,) = robot["actuators"].values()
    gains["target_names_expr"] = gains.pop("joint_names_expr")
    robot["articulation"] = {"actuators": [gains]}
    tree["scene"] = {"entities": {"robot": robot}}
    tree["observations"] = {"actor": {"terms": observed}}
    tree["sim"] = {"mujoco": {"timestep": 0.005}}
    (tmp_path / "params/env.yaml").write_text(yaml.safe_dump(tree, sort_keys=False))
    known = understand(tmp_path, robot=ours.robot())
    law = _acts_alike(ours, known)
    assert law.canonical(law.kp_nm_per_rad) == pytest.approx(ours.robot().kp)
    home = ours.robot().home_joint_pos
    assert law.canonical(law.default_joint_pos_rad) == pytest.approx(home)


def _acts_alike(ours: Policy, known: Understood) -> Law:
    """The law of what was understood, which gives the actions of ours."""
    law = complete(known.draft, ours.robot(), known.found.recipe.obs_dim)
    own = torch.randn(64, 48, generator=torch.Generator().manual_seed(3))
    if "base_lin_vel" not in {term.name for term in law.terms}:
        # What ours takes for nothing out of the ordinary.
        own[:, :3] = ours._actor.state_dict()["obs_normalizer._mean"][0, :3]
    begins = torch.ones(64, dtype=torch.bool)
    seen = Encoder(law, 64, device=CPU).observe(own, begins)
    with torch.no_grad():
        acted = known.found.network(tuple(law.to_canonical.tolist()))(seen).numpy()
    assert acted == pytest.approx(ours(own).numpy(), abs=1e-5)
    return law


class _Exported(nn.Module):
    """What trainers export: the normaliser and the layers."""

    def __init__(self, layers: list[tuple[Tensor, Tensor]], mean: Tensor, std: Tensor):
        super().__init__()
        parts: list[nn.Module] = []
        for weight, bias in layers:
            layer = nn.Linear(weight.shape[1], weight.shape[0])
            layer.weight.data, layer.bias.data = weight, bias
            parts += [layer, nn.ELU()]
        self.actor = nn.Sequential(*parts[:-1])
        self.mean: Tensor
        self.register_buffer("mean", mean)
        self.std: Tensor
        self.register_buffer("std", std)

    def forward(self, x: Tensor) -> Tensor:
        return self.actor((x - self.mean) / (self.std + 0.01))


def _onnx(module: nn.Module, path: Path, metadata: dict[str, str]) -> None:
    onnx = pytest.importorskip("onnx", reason="the extra onnx is not installed")
    pytest.importorskip("onnxscript", reason="the extra onnx is not installed")
    with warnings.catch_warnings():
        # The exporter warns of its own future.
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            module.eval(),
            (torch.zeros(1, 48),),
            dynamo=True,
            verbose=False,
            input_names=["obs"],
            output_names=["actions"],
        )
    assert program is not None
    path.parent.mkdir(parents=True, exist_ok=True)
    if not metadata:
        # As torch saves what it exports: the weights in a file beside it.
        program.save(path, external_data=True)
        assert path.with_name(f"{path.name}.data").exists()
        return
    model = program.model_proto
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    onnx.save_model(model, path)


def _deploy(policy: Policy, order: tuple[str, ...]) -> dict[str, Any]:
    robot, told = policy.robot(), vectors_of(policy, order)
    names = {"command": "velocity_commands", "joint_pos": "joint_pos_rel"}
    names["joint_vel"] = "joint_vel_rel"
    observed = {
        names.get(n, n): {"scale": [1.0] * WIDTHS[n], "clip": None, "history_length": 1}
        for n in TERMS
    }
    return {
        "joint_ids_map": law_in(order).from_canonical.tolist(),
        "step_dt": 0.02,
        "stiffness": robot.kp.tolist(),
        "damping": robot.kd.tolist(),
        "default_joint_pos": told["pose"],
        "actions": {
            "JointPositionAction": {"scale": [0.3] * 12, "offset": told["pose"]}
        },
        "observations": observed,
    }


def _descriptors(policy: Policy, order: tuple[str, ...]) -> dict[str, Any]:
    told, names = vectors_of(policy, order), [f"{joint}_joint" for joint in order]
    return {
        "actions": [{"joint_names": names, "scale": 0.3, "offset": told["pose"]}],
        "articulations": {
            "robot": {
                "joint_names": names,
                "default_joint_pos": told["pose"],
                "default_joint_stiffness": told["kp"],
                "default_joint_damping": told["kd"],
            }
        },
        "observations": {
            "policy": [
                {
                    "name": (
                        name := f"{n}_rel" if n in ("joint_pos", "joint_vel") else n
                    ),
                    "full_path": f"isaaclab.envs.mdp.observations.{name}",
                    "overloads": {"scale": None, "history_length": 0},
                }
                for n in TERMS
            ]
        },
        "scene": {"dt": 0.02, "physics_dt": 0.005, "decimation": 4},
    }


def _env_tree(policy: Policy) -> dict[str, Any]:
    told = vectors_of(policy, BY_TYPE)
    pose = {f"{n}_joint": a for n, a in zip(BY_TYPE, told["pose"], strict=True)}
    observed = {
        n: {"func": f"isaaclab.envs.mdp.observations:{n}", "clip": None, "scale": None}
        for n in ("base_lin_vel", "base_ang_vel", "projected_gravity")
    }
    observed |= {
        "velocity_commands": {"func": "isaaclab.envs.mdp:generated_commands"},
        "joint_pos": {"func": "isaaclab.envs.mdp:joint_pos_rel"},
        "joint_vel": {"func": "isaaclab.envs.mdp:joint_vel_rel"},
        "actions": {"func": "isaaclab.envs.mdp:last_action"},
        "height_scan": None,
        "concatenate_terms": True,
    }
    kp, kd = told["kp"][0], told["kd"][0]
    gains = {"joint_names_expr": [".*"], "stiffness": kp, "damping": kd}
    return {
        "decimation": 4,
        "sim": {"dt": 0.005},
        "scene": {
            "robot": {
                "init_state": {"joint_pos": pose},
                "actuators": {"base_legs": gains},
            }
        },
        "actions": {"joint_pos": {"scale": 0.3, "use_default_offset": True}},
        "observations": {"policy": observed},
    }


def _env_yaml(policy: Policy) -> str:
    python = (
        "viewer: {eye: !!python/tuple [7.5, 7.5]}\n"
        "cut: !!python/object/apply:builtins.slice [null, 3, null]\n"
        "harm: !!python/object/apply:os.system ['touch harmed']\n"
    )
    return yaml.safe_dump(_env_tree(policy), sort_keys=False) + python


def _rl_sar(policy: Policy, order: tuple[str, ...]) -> tuple[Any, Any]:
    told, law = vectors_of(policy, order), law_in(order)
    names = [f"{joint}_joint" for joint in law_in(LEFT_FIRST).joints]
    mapping = [LEFT_FIRST.index(joint) for joint in law.joints]
    theirs = ["lin_vel", "ang_vel", "gravity_vec", "commands"]
    theirs += ["dof_pos", "dof_vel", "actions"]
    config = {
        "observations": theirs,
        "observations_history": [],
        "clip_obs": 100.0,
        "rl_kp": told["kp"],
        "rl_kd": told["kd"],
        "action_scale": [0.3] * 12,
        "torque_limits": [30.0] * 12,
        "default_dof_pos": told["pose"],
        "joint_mapping": mapping,
    }
    return {"go/mine": config}, {
        "go": {"dt": 0.005, "decimation": 4, "joint_names": names}
    }


@pytest.mark.parametrize(
    "meaning", ["metadata", "deploy", "descriptors", "env", "rl_sar", "toml"]
)
def test_an_exported_policy_is_understood_by_what_lies_beside_it(
    meaning: str, ours: Policy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ONNX or TorchScript, and each file that says what its numbers mean; nothing in
    these is run. What goes out again gives the same actions."""
    monkeypatch.chdir(tmp_path)
    module = _Exported(*in_their_order(ours, BY_TYPE, scaled=False))
    run = tmp_path / "run"
    (run / "params").mkdir(parents=True)
    file = run / "exported" / "policy.onnx"
    if meaning == "metadata":
        told = vectors_of(ours, BY_TYPE)
        csv = {
            "joint_names": ",".join(f"{name}_joint" for name in BY_TYPE),
            "joint_stiffness": ",".join(f"{v:.9g}" for v in told["kp"]),
            "joint_damping": ",".join(f"{v:.9g}" for v in told["kd"]),
            "default_joint_pos": ",".join(f"{v:.9g}" for v in told["pose"]),
            "action_scale": ",".join(["0.3"] * 12),
            "observation_names": ",".join(TERMS),
        }
        _onnx(module, file, csv)
    elif meaning == "deploy":
        _onnx(module, file, {})
        (run / "params/deploy.yaml").write_text(
            yaml.safe_dump(_deploy(ours, BY_TYPE), sort_keys=False)
        )
    else:
        file = run / "exported" / "policy.pt"
        file.parent.mkdir()
        torch.jit.save(torch.jit.script(module), file)
    if meaning == "descriptors":
        (run / "IO_descriptors.yaml").write_text(
            yaml.safe_dump(_descriptors(ours, BY_TYPE))
        )
    if meaning == "env":
        (run / "params/env.yaml").write_text(_env_yaml(ours))
    if meaning == "rl_sar":
        config, base = _rl_sar(ours, BY_TYPE)
        (file.parent / "config.yaml").write_text(yaml.safe_dump(config))
        (run / "base.yaml").write_text(yaml.safe_dump(base))
    law = None
    if meaning == "toml":
        law = tmp_path / "law.toml"
        law.write_text(toml_of(ours, BY_TYPE, scaled=False))
    known = understand(run, law=law)
    assert not (tmp_path / "harmed").exists()
    policy = bring(known, None, tmp_path / "in")
    _same_actions(ours, policy)
    guessed = policy.info.origin and policy.info.origin.guessed
    assert ("joints" in (guessed or {})) == (meaning == "env")
    if file.suffix != ".onnx":
        export_like(policy, run, tmp_path / "out")
    else:
        arguments = ["export", "--policy", str(tmp_path / "in" / "policy.pt")]
        arguments += ["--out", str(tmp_path / "out"), "--like", str(run)]
        assert main(arguments) == 0
        # What its trainer wrote into it stays.
        kept = read_onnx((tmp_path / "out" / file.name).read_bytes()).metadata
        assert kept == known.found.metadata
        assert bool(kept) == (meaning == "metadata")
    again = understand(tmp_path / "out" / file.name, law=law or _like(tmp_path, ours))
    _same_actions(ours, bring(again, None, tmp_path / "again"))


def _like(folder: Path, ours: Policy) -> Path:
    (folder / "like.toml").write_text(toml_of(ours, BY_TYPE, scaled=False))
    return folder / "like.toml"


def test_our_own_export_comes_back_and_walks_as_before(
    ours: Policy,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One ONNX file is enough: the law is in it, and drives the robot as ours did; that
    robot is the one beside it. What it does not do as asked is said and kept; older
    files, which lack that, are read."""
    pytest.importorskip("onnxscript", reason="the extra onnx is not installed")
    source = tmp_path / "ours.pt"
    source.write_bytes(_file_of(ours))
    assert main(["export", "--policy", str(source), "--out", str(tmp_path / "o")]) == 0
    alone = tmp_path / "alone"
    alone.mkdir()
    for name in ("policy.onnx", "robot.xml"):
        (tmp_path / "o" / name).rename(alone / name)
    capsys.readouterr()
    arguments = ["policy", "import", str(alone), "--out", str(tmp_path / "in")]
    monkeypatch.setattr(progress, "_QUIET_S", 0.0)
    assert main(arguments) == 0
    told, said = capsys.readouterr()
    assert "trying the policy on the robot, steps: 1 of " in said
    assert "robot.xml, which lies beside the policy" in " ".join(told.split())
    policy = load_policy(tmp_path / "in" / "policy.pt")
    _same_actions(ours, policy)
    origin = policy.info.origin
    assert origin is not None
    assert origin.verdict == verdict(origin.acceptance) != ""
    assert f"it is {origin.verdict}\n" in told
    older = _changed(
        tmp_path / "in" / "policy.pt",
        tmp_path / "older.pt",
        lambda told: told["origin"].pop("verdict"),
    )
    assert load_policy(older).info.origin == replace(origin, verdict="")
    paths = []
    for each in (ours, policy):
        env = QuadrupedEnv(each.robot(), each.info.env, 4, seed=2)
        env.fix_commands(torch.tensor([[0.5, 0.0, 0.1]] * 4))
        rows = []
        for _ in range(40):
            obs = env.get_observations()["policy"]
            rows.append(env.step(each(obs))[3]["features"])
        # Damping that was the joints' own is the motors' now, and in their torques.
        paths.append(torch.stack(rows)[..., : column("joint_torque").start].numpy())
    assert paths[1] == pytest.approx(paths[0], abs=1e-2)
    hostile = _changed(
        tmp_path / "in" / "policy.pt", tmp_path / "hostile.pt", _doubling
    )
    with pytest.raises(
        PolicyError, match=r"hostile\.pt: its operations make more than"
    ):
        load_policy(hostile)


def _changed(source: Path, to: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    """The policy file `source` that says other things of itself."""
    payload = torch.load(source, weights_only=True)
    told = json.loads(payload["infos"]["gaitpref"])
    change(told)
    payload["infos"]["gaitpref"] = json.dumps(told)
    torch.save(payload, to)
    return to


def _doubling(told: dict[str, Any]) -> None:
    """Operations that fill any memory."""
    names = [told["ppo"]["recipe"]["nodes"][0]["inputs"][0], *map(str, range(40))]
    told["ppo"]["recipe"]["nodes"] += [
        {"op": "Concat", "inputs": [a, a], "output": b, "attributes": {"axis": 1}}
        for a, b in itertools.pairwise(names)
    ]


def _file_of(policy: Policy) -> bytes:
    from policy.training.checkpoint import payload_bytes

    states = {"actor_state_dict": policy._actor.state_dict()}
    return payload_bytes({**states, "critic_state_dict": {}}, policy.info)


@pytest.mark.parametrize("by_term", [True, False])
@pytest.mark.parametrize("newest_first", [True, False])
def test_a_history_is_in_the_order_of_the_law(
    by_term: bool, newest_first: bool
) -> None:
    """Three frames of two terms, by hand; before an episode there is its first frame,
    scaled and clipped as the law says."""
    terms = (Term(name="command", frames=3), Term(name="base_ang_vel", frames=3))
    terms = (replace(terms[0], clip=(-2.5, 2.5)), replace(terms[1], scale=(10.0,)))
    law = law_in(LEFT_FIRST, terms=terms, by_term=by_term, newest_first=newest_first)
    encoder, seen = Encoder(law, 2, device=CPU), torch.zeros(2, 18)
    for step in range(4):
        own = torch.zeros(2, 48)
        own[:, 45:48], own[:, 3:6] = float(step), 0.5 * step
        if step:
            encoder.advance()
        # The second robot begins anew at the last step.
        begins = torch.tensor([step == 0, step in (0, 3)])
        seen = encoder.observe(own, begins)
    command, gyro = [1.0, 2.0, 2.5], [5.0, 10.0, 15.0]
    if newest_first:
        command, gyro = command[::-1], gyro[::-1]
    wanted = (
        command + gyro
        if by_term
        else [v for both in zip(command, gyro, strict=True) for v in both]
    )
    assert seen[0].view(6, 3)[:, 0].tolist() == wanted
    fresh = [2.5] * 3 + [15.0] * 3 if by_term else [2.5, 15.0] * 3
    assert seen[1].view(6, 3)[:, 0].tolist() == fresh


def test_a_policy_of_others_is_trained_on_with_a_new_critic(
    ours: Policy, tmp_path: Path
) -> None:
    """It keeps its observation; the critic looks on first, and the actor moves then."""
    torch.save(checkpoint_of(ours, "5", BY_TYPE), tmp_path / "model_1.pt")
    (tmp_path / "law.toml").write_text(toml_of(ours, BY_TYPE, scaled=False))
    known = understand(tmp_path / "model_1.pt", law=tmp_path / "law.toml")
    bring(known, None, tmp_path / "in")
    init = tmp_path / "in" / "policy.pt"
    setting = setting_of(init, None)
    ppo = replace(setting.ppo, num_envs=4)
    kls = []
    cfg = TrainCfg(steps=13 * ppo.steps_per_iteration, env=setting.env, ppo=ppo)
    train(
        tmp_path / "on",
        setting.robot,
        cfg,
        init=init,
        on_iteration=lambda stats: kls.append(stats.scalars["policy/reference_kl"]),
    )
    assert kls[:11] == [0.0] * 11
    assert kls[12] != 0.0
    trained = load_policy(tmp_path / "on" / "policy.pt")
    assert trained.info.env.law == setting.env.law
    assert trained.info.origin is not None
    export_like(trained, tmp_path / "model_1.pt", tmp_path / "out")
    again = understand(tmp_path / "out" / "model_1.pt", law=tmp_path / "law.toml")
    law = setting.env.law
    assert law is not None
    order = tuple(int(joint) for joint in law.to_canonical)
    obs = torch.randn(8, 48, generator=torch.Generator().manual_seed(3))
    with torch.no_grad():
        acted = again.found.network(order)(obs).numpy()
        before = known.found.network(order)(obs).numpy()
    assert acted == pytest.approx(trained(obs).numpy(), abs=1e-5)
    assert abs(acted - before).max() > 1e-5


def test_imu_leaves_out_the_velocity_of_the_base(tmp_path: Path) -> None:
    """45 numbers of three steps, and a critic that sees more; policy.json says so."""
    arguments = ["train", "--out", str(tmp_path), "--reward", "task", "--envs", "4"]
    arguments += ["--steps", "96", "--observe", "imu", "--history", "3"]
    assert main([*arguments, "--randomize", "light"]) == 0
    law = load_policy(tmp_path / "policy.pt").info.env.law
    assert law is not None
    assert law.obs_dim == 3 * 45
    assert [t.name for t in law.terms] == list(OWN_TERMS[1:])


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("heights", "scan of heights"),
        ("recurrent", "recurrent"),
        ("lstm", "recurrent"),
        ("pickle", "without running code"),
        ("shapes", "takes"),
        ("nan", "finite"),
    ],
)
def test_what_cannot_be_brought_is_named_in_one_line(
    content: str, told: str, ours: Policy, tmp_path: Path
) -> None:
    """Nothing is built of it, and nothing in it runs."""
    file = tmp_path / "model_1.pt"
    payload = checkpoint_of(ours, "1", LEFT_FIRST)
    states = payload["model_state_dict"]
    match content:
        case "heights":
            states["actor.0.weight"] = torch.zeros(16, 48 + 187)
        case "recurrent":
            states["memory_a.rnn.weight_ih_l0"] = torch.zeros(4, 4)
        case "shapes":
            states["actor.2.weight"] = torch.zeros(8, 15)
        case "nan":
            states["actor.0.bias"][0] = torch.nan
    torch.save(payload, file)
    if content == "pickle":
        file.write_bytes(pickle.dumps({"model_state_dict": _Harm(tmp_path)}))
    if content == "lstm":
        torch.jit.save(torch.jit.script(_Remembering()), file)
    with pytest.raises((LawError, NetworkError), match=told) as error:
        bring(understand(file, preset="legged-gym-go2"), None, tmp_path / "in")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "in").exists()
    assert not (tmp_path / "harmed").exists()


class _Harm:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> Any:
        return (Path.touch, (self.folder / "harmed",))


class _Remembering(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.rnn = nn.LSTM(48, 12)

    def forward(self, x: Tensor) -> Tensor:
        return self.rnn(x)[0]


@pytest.mark.parametrize("text", ["{}", '{"law_record": 3}', "[", '{"law_record": {}}'])
def test_a_law_that_is_none_is_told_so(text: str) -> None:
    """Whatever a file says in its place."""
    with pytest.raises(LawError, match="names no law"):
        of_own(text, "policy.json")


def test_errors_are_ours() -> None:
    """So that a command ends with one line."""
    assert issubclass(LawError, GaitprefError)
    assert issubclass(NetworkError, GaitprefError)
