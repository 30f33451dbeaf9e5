"""Files given as a policy: of other programs, of other shapes, and not finite."""

from __future__ import annotations

import io
import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper
from safetensors.torch import save as save_tensors
from torch import nn

from data.errors import FileError
from data.files.plain import to_plain
from gaitpref.cli.main import main
from policy.env.env_cfg import EnvCfg
from policy.extensions.kl_penalty import KlPenaltyCfg
from policy.robots.robot import load_robot
from policy.training.checkpoint import PolicyError, load_policy, read_plain
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

PPO = PpoCfg(num_envs=4, hidden_sizes=(8,))


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a training of one iteration."""
    out = tmp_path_factory.mktemp("trained")
    env = EnvCfg(episode_s=0.4)
    cfg = TrainCfg(steps=PPO.steps_per_iteration, env=env, ppo=PPO)
    train(out, load_robot(physics_dt_s=env.physics_dt_s), cfg)
    return out


def _saved(value: object) -> bytes:
    file = io.BytesIO()
    torch.save(value, file)
    return file.getvalue()


def _script() -> bytes:
    file = io.BytesIO()
    torch.jit.save(torch.jit.script(nn.Linear(48, 12)), file)
    return file.getvalue()


def _onnx() -> bytes:
    sides = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1]) for name in "xy"
    ]
    node = helper.make_node("Relu", ["x"], ["y"])
    model = helper.make_model(helper.make_graph([node], "g", sides[:1], sides[1:]))
    onnx.checker.check_model(model)
    return model.SerializeToString()


def _hdf5() -> bytes:
    file = io.BytesIO()
    with h5py.File(file, "w") as out:
        out["weights"] = np.zeros(3)
    return file.getvalue()


def _npz() -> bytes:
    file = io.BytesIO()
    np.savez(file, weights=np.zeros(3))
    return file.getvalue()


WEIGHTS = {"mlp.0.weight": torch.zeros(12, 48), "mlp.0.bias": torch.zeros(12)}
OTHERS: dict[str, tuple[Callable[[], bytes], str]] = {
    "TorchScript": (_script, "TorchScript"),
    "ONNX": (_onnx, "an ONNX model"),
    "HDF5": (_hdf5, "an HDF5 file"),
    "npz": (_npz, "an archive of NumPy arrays"),
    "npy": (lambda: b"\x93NUMPY\x01\x00", "a NumPy array"),
    "safetensors": (lambda: save_tensors(WEIGHTS), "a safetensors file"),
    "RSL-RL 1 to 3": (
        lambda: _saved({"model_state_dict": WEIGHTS, "iter": 5, "infos": None}),
        "a checkpoint of an older RSL-RL",
    ),
    "RSL-RL 5": (
        lambda: _saved({"actor_state_dict": WEIGHTS, "iter": 5, "infos": None}),
        "a checkpoint of RSL-RL without gaitpref's description",
    ),
    "tensor": (lambda: _saved(torch.zeros(3)), "torch's file of a Tensor"),
    "weights alone": (lambda: _saved(WEIGHTS), "torch's file of something else"),
    "module": (lambda: _saved(nn.Linear(3, 3)), "is damaged"),
    "pickle": (lambda: b"\x80\x04cos\nsystem\n.", "is damaged"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_of_another_program_is_told_as_such(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """In one line, without torch's own words, whichever command was given it."""
    made, told = OTHERS[name]
    path = tmp_path / "model_1500.pt"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path.write_bytes(made())
    out = str(tmp_path / "out")
    for args in (
        ["evaluate", "--policy", str(path), "--reward", "task"],
        ["record", "--policy", str(path), "--dataset", out],
        ["export", "--policy", str(path), "--out", out],
        ["train", "--out", out, "--reward", "task", "--init", str(path)],
    ):
        assert main(args) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert said.startswith(f"gaitpref: {path} is ")
        assert told in said
        assert "weights_only" not in said
        assert "\x1b" not in said


def test_the_state_of_a_training_is_no_policy(trained: Path) -> None:
    with pytest.raises(PolicyError, match="is the state that a training goes on from"):
        load_policy(trained / "resume.pt")
    with pytest.raises(FileError, match="is a directory, where a file is wanted"):
        load_policy(trained)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("part", ["actor", "critic"])
def test_a_weight_that_is_no_number_is_refused_by_its_layer(
    trained: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    part: str,
    value: float,
) -> None:
    """Before it reaches a simulator, a data set or a robot."""
    payload = read_plain(trained / "policy.pt")
    payload[f"{part}_state_dict"]["mlp.0.weight"][1, 2:5] = value
    path = tmp_path / "policy.pt"
    path.write_bytes(_saved(payload))
    out = tmp_path / "out"
    for args in (
        ["evaluate", "--policy", str(path), "--reward", "task"],
        ["record", "--policy", str(path), "--dataset", str(out)],
        ["export", "--policy", str(path), "--out", str(out)],
        ["play", "--policy", str(path), "--port", "0"],
    ):
        assert main(args) == 2
        said = capsys.readouterr().err
        assert f"{part}_state_dict.mlp.0.weight (3 of 384 numbers)" in said
        assert said.count("\n") == 1
    assert not out.exists()


def test_extensions_that_are_off_leave_a_file_as_it_was_before_they_could_be_none(
    trained: Path, tmp_path: Path
) -> None:
    """To the letter, as a file is named by its hash; and such files are read."""
    payload = read_plain(trained / "policy.pt")
    told = json.loads(payload["infos"]["gaitpref"])
    written = list(told["ppo"].items())[-4:]
    assert written == [
        ("privileged_critic", False),
        ("reference_kl_weight", 0.0),
        ("kl_penalty", {"kind": "none", "beta": 1.0, "target": 0.01}),
        (
            "bonus",
            {
                "kind": "none",
                "weight": 1.0,
                "decay_iterations": None,
                "neighbors": 5,
                "memory": 2048,
            },
        ),
    ]
    assert load_policy(trained / "policy.pt").info.ppo == PPO
    told["ppo"] |= {"kl_penalty": {"kind": "fixed", "beta": 2.0, "target": 0.01}}
    payload["infos"]["gaitpref"] = json.dumps(told)
    (tmp_path / "penalised.pt").write_bytes(_saved(payload))
    ppo = load_policy(tmp_path / "penalised.pt").info.ppo
    assert ppo == replace(PPO, kl_penalty=KlPenaltyCfg(kind="fixed", beta=2.0))
    # A configuration says what is in force.
    assert to_plain(PPO, whole=True)["bonus"] is None


def test_shapes_that_do_not_fit_are_told_whole(trained: Path, tmp_path: Path) -> None:
    payload = read_plain(trained / "policy.pt")
    actor = payload["actor_state_dict"]
    actor["mlp.0.weight"] = torch.zeros(8, 60)
    actor["extra"] = actor.pop("mlp.2.bias")
    path = tmp_path / "policy.pt"
    path.write_bytes(_saved(payload))
    with pytest.raises(
        PolicyError,
        match=r"mlp\.0\.weight is 8 x 60 in the file and 8 x 48 in the network; "
        r"mlp\.2\.bias is missing; extra is unknown",
    ):
        load_policy(path)


def test_a_description_of_other_types_is_refused(trained: Path, tmp_path: Path) -> None:
    payload = read_plain(trained / "policy.pt")
    info = json.loads(payload["infos"]["gaitpref"])
    for change in ({"seed": "many"}, {"env": 3}, {"steps": True}):
        payload["infos"]["gaitpref"] = json.dumps({**info, **change})
        path = tmp_path / "policy.pt"
        path.write_bytes(_saved(payload))
        with pytest.raises(PolicyError, match=f"cannot read .*{next(iter(change))}"):
            load_policy(path)


@pytest.mark.parametrize("learning_rate", [1e10, 1e20])
def test_a_training_that_diverges_says_so_and_keeps_what_was_saved(
    tmp_path: Path, learning_rate: float
) -> None:
    """Ruined networks are not saved over those before, wherever torch meets them."""
    env = EnvCfg(episode_s=0.4)
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    cfg = TrainCfg(steps=PPO.steps_per_iteration, env=env, ppo=PPO)
    train(tmp_path, robot, cfg)
    before = {path.name: path.read_bytes() for path in tmp_path.glob("*.pt")}
    wild = replace(cfg, ppo=replace(PPO, learning_rate=learning_rate))
    with pytest.raises(PolicyError, match=r"diverged at step \d+ .* is kept"):
        train(tmp_path, robot, wild)
    assert {path.name: path.read_bytes() for path in tmp_path.glob("*.pt")} == before
