"""Hostile files, given to `gaitpref policy import`: one line says what is wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

from gaitpref.cli.main import main

onnx = pytest.importorskip("onnx", reason="the extra onnx is not installed")

LEGS = [f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in "abc"]


def _onnx(path: Path, *nodes: Any, **metadata: str) -> None:
    """An ONNX from 45 numbers `obs` to 12 `actions`, by `nodes` if there are any."""
    of = onnx.helper
    weights = onnx.numpy_helper.from_array(torch.zeros(45, 12).numpy(), "w")
    number = onnx.TensorProto.FLOAT
    graph = of.make_graph(
        list(nodes) or [of.make_node("MatMul", ["obs", "w"], ["actions"])],
        "policy",
        [of.make_tensor_value_info("obs", number, [1, 45])],
        [of.make_tensor_value_info("actions", number, [1, 12])],
        [weights],
    )
    model = of.make_model(graph)
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    path.write_bytes(model.SerializeToString())


def _node(op: str, inputs: list[str], outputs: list[str], **attributes: Any) -> Any:
    return onnx.helper.make_node(op, inputs, outputs, **attributes)


def _doubled(path: Path) -> None:
    """Each operation doubles what there is: 27 of them make 24 GB."""
    names = ["obs", *(f"{n}" for n in range(27))]
    doubled = [_node("Concat", [a, a], [b], axis=1) for a, b in pairwise(names)]
    _onnx(path, *doubled, _node("MatMul", ["obs", "w"], ["actions"]))


def _spoken(**metadata: str) -> Callable[[Path], None]:
    """What mjlab says of a policy, changed."""
    told = {"joint_names": ",".join(LEGS), "observation_names": "base_ang_vel"}
    return lambda path: _onnx(path, **{**told, **metadata})


def _beside(name: str, text: str, **others: Any) -> Callable[[Path], None]:
    """A policy with a file of others beside it, or above it."""

    def make(path: Path) -> None:
        _onnx(path)
        path.with_name(name).write_text(text)
        for above, values in others.items():
            (path.parent.parent / f"{above}.yaml").write_text(yaml.safe_dump(values))

    return make


def _deploy(**changes: Any) -> str:
    return yaml.safe_dump(
        {
            "joint_ids_map": list(range(12)),
            "step_dt": 0.02,
            "stiffness": 20.0,
            "damping": 0.5,
            "default_joint_pos": 0.5,
            "actions": {"JointPositionAction": {"scale": 0.25}},
            "observations": {"base_ang_vel": {"scale": 1.0}},
            **changes,
        }
    )


def _env(pattern: str = ".*", **changes: Any) -> str:
    """An env.yaml of Isaac Lab whose joints are called by `pattern`."""
    gains = {"joint_names_expr": [".*"], "stiffness": 20.0, "damping": 0.5}
    robot = {"init_state": {"joint_pos": {pattern: 0.5}}, "actuators": {"all": gains}}
    return yaml.safe_dump(
        {
            "decimation": 4,
            "sim": {"dt": 0.005},
            "scene": {"robot": robot},
            "actions": {"joint_pos": {"scale": 0.25}},
            "observations": {"policy": {"gyro": {"func": "mdp:base_ang_vel"}}},
            **changes,
        }
    )


def _rl_sar(**changes: Any) -> Callable[[Path], None]:
    config = {
        "observations": ["ang_vel"],
        "joint_mapping": list(range(12)),
        "default_dof_pos": 0.5,
        "action_scale": 0.25,
        "rl_kp": 20.0,
        "rl_kd": 0.5,
        "torque_limits": 30.0,
        **changes,
    }
    return _beside(
        "config.yaml",
        yaml.safe_dump({"go2/mine": config}),
        base={"go2": {"dt": 0.005, "decimation": 4, "joint_names": LEGS}},
    )


def _descriptors(**changes: Any) -> str:
    robot = {"joint_names": LEGS, "default_joint_pos": [0.5] * 12, **changes}
    return yaml.safe_dump(
        {
            "actions": [{"joint_names": LEGS, "scale": 0.25}],
            "articulations": {"robot": robot},
            "observations": {"policy": [{"name": "base_ang_vel"}]},
        }
    )


def _half_normalised(path: Path) -> None:
    states = {"actor.0.weight": torch.zeros(12, 45), "actor.0.bias": torch.zeros(12)}
    torch.save(
        {
            "model_state_dict": states,
            "obs_norm_state_dict": {"_mean": torch.zeros(45)},
        },
        path,
    )


def _laughing(start: str) -> str:
    """YAML whose nine lines of aliases stand for 9^9 words."""
    lines = ["a0: &a0 [x,x,x,x,x,x,x,x,x]"]
    lines += [f"a{n + 1}: &a{n + 1} [{','.join([f'*a{n}'] * 9)}]" for n in range(8)]
    return "\n".join([*lines, start.format("*a8")])


HOSTILE: dict[str, tuple[Callable[[Path], None], str]] = {
    "concat": (_doubled, "numbers"),
    "aliases": (
        _beside("deploy.yaml", _laughing("joint_ids_map: {}")),
        "alias",
    ),
    "alias of a scale": (
        _beside("IO_descriptors.yaml", _descriptors() + _laughing("q: {}")),
        "alias",
    ),
    "alias of itself": (_beside("deploy.yaml", "a: &a [*a]"), "alias"),
    "commas": (_spoken(joint_names="a," * 500_000), "joints"),
    "a long number": (_beside("deploy.yaml", _deploy(stiffness=10**400)), "large"),
    "brackets": (_spoken(action_scale="[" * 100_000), "metadata"),
    "endless history": (
        _beside(
            "deploy.yaml",
            _deploy(observations={"base_ang_vel": {"history_length": float("inf")}}),
        ),
        "infinity",
    ),
    "endless decimation": (
        _beside("env.yaml", _env(decimation=float("inf"))),
        "infinity",
    ),
    "endless decimation of rl_sar": (_rl_sar(decimation=float("inf")), "decimation"),
    "one history": (_rl_sar(observations_history=6), "observations_history"),
    "joints of two kinds": (_rl_sar(joint_mapping=["a", 1]), "joint_mapping"),
    "one angle": (
        _beside("IO_descriptors.yaml", _descriptors(default_joint_pos=0.5)),
        "wrong kind",
    ),
    "half a normaliser": (_half_normalised, "_std"),
    "no outputs": (
        lambda path: _onnx(path, _node("Tanh", ["obs"], [])),
        "output",
    ),
    "no constant": (
        lambda path: _onnx(path, _node("Constant", [], [], value_float=1.0)),
        "output",
    ),
    "softmax of nothing": (
        lambda path: _onnx(path, _node("Softmax", [""], ["actions"])),
        "operations do not fit",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_policy_is_told_in_one_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No traceback, no gigabytes, no minutes."""
    make, told = HOSTILE[name]
    file = tmp_path / "run" / ("model_1.pt" if "normal" in name else "policy.onnx")
    file.parent.mkdir()
    make(file)
    assert main(["policy", "import", str(file), "--explain"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert told in lines[0]


def test_aliases_as_isaac_lab_writes_them_are_followed(tmp_path: Path) -> None:
    """What stands twice in a configuration is written once."""
    _beside("env.yaml", "a: &id001 !!python/tuple [1]\nb: *id001\n" + _env())(
        tmp_path / "policy.onnx"
    )
    assert main(["policy", "import", str(tmp_path / "policy.onnx"), "--explain"]) == 0


def test_without_the_package_an_onnx_is_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It says which extra brings it."""
    _onnx(tmp_path / "policy.onnx")
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert main(["policy", "import", str(tmp_path / "policy.onnx"), "--explain"]) == 2
    assert "pip install -e '.[onnx]'" in capsys.readouterr().err
