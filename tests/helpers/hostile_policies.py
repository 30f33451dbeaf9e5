"""Hostile policies of others, made for `gaitpref policy import`."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import onnx
import torch
import yaml

from tests.helpers.foreign_layouts import deploy_yaml

LEGS = [f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in "abc"]


def write_onnx(path: Path, *nodes: Any, **metadata: str) -> None:
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


def _apart(
    location: str = "policy.onnx.data",
    size: int = 2160,
    link: bool = False,
    **told: int,
) -> Callable[[Path], None]:
    """A policy whose weights, 2160 bytes, lie at `location`, as it says."""

    def make(path: Path) -> None:
        write_onnx(path)
        model = onnx.load_model(path)
        (tensor,) = model.graph.initializer
        tensor.ClearField("raw_data")
        tensor.data_location = onnx.TensorProto.EXTERNAL
        for key, value in {"location": location, **told}.items():
            tensor.external_data.add(key=key, value=str(value))
        path.write_bytes(model.SerializeToString())
        data = path.with_name("policy.onnx.data")
        if link:
            data.symlink_to(path.parent.parent / "elsewhere.data")
        with data.open("wb") as file:
            file.truncate(size)

    return make


def _node(op: str, inputs: list[str], outputs: list[str], **attributes: Any) -> Any:
    return onnx.helper.make_node(op, inputs, outputs, **attributes)


def _doubled(path: Path) -> None:
    """Each operation doubles what there is: 27 of them make 24 GB."""
    names = ["obs", *(f"{n}" for n in range(27))]
    doubled = [_node("Concat", [a, a], [b], axis=1) for a, b in pairwise(names)]
    write_onnx(path, *doubled, _node("MatMul", ["obs", "w"], ["actions"]))


def _spoken(**metadata: str) -> Callable[[Path], None]:
    """What mjlab says of a policy, changed."""
    told = {"joint_names": ",".join(LEGS), "observation_names": "base_ang_vel"}
    return lambda path: write_onnx(path, **{**told, **metadata})


def beside(name: str, text: str, **others: Any) -> Callable[[Path], None]:
    """A policy with a file of others beside it, or above it."""

    def make(path: Path) -> None:
        write_onnx(path)
        path.with_name(name).write_text(text)
        for above, values in others.items():
            (path.parent.parent / f"{above}.yaml").write_text(yaml.safe_dump(values))

    return make


def env_yaml(pattern: str = ".*", **changes: Any) -> str:
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
    return beside(
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


def _nested(levels: int) -> str:
    """A pattern that tries very many ways to fail."""
    pattern = ".{1,9}"
    for _ in range(levels):
        pattern = f"(?:{pattern}){{1,9}}"
    return pattern + "!"


ALONE: dict[str, tuple[Callable[[Path], None], str]] = {
    "concat": (_doubled, "numbers"),
    "commas": (_spoken(joint_names="a," * 500_000), "joints"),
    "brackets": (_spoken(action_scale="[" * 100_000), "metadata"),
    "half a normaliser": (_half_normalised, "_std"),
    "no outputs": (
        lambda path: write_onnx(path, _node("Tanh", ["obs"], [])),
        "output",
    ),
    "no constant": (
        lambda path: write_onnx(path, _node("Constant", [], [], value_float=1.0)),
        "output",
    ),
    "weights above": (_apart("../run/policy.onnx.data"), "no plain name"),
    "weights anywhere": (_apart("/etc/hostname"), "no plain name"),
    "weights that are not there": (_apart("w.data"), "copy both files"),
    "a link to weights": (_apart(link=True), "a link that leads elsewhere"),
    "weights from beyond": (_apart(offset=2161), "copy both files together again"),
    "weights to beyond": (_apart(length=2161), "which has 2,160"),
    "weights before": (_apart(offset=-8), "must be a whole number"),
    "fewer weights": (_apart(length=2000), "damaged"),
    "gigabytes of weights": (_apart(size=2**30), "is read up to"),
    "softmax of nothing": (
        lambda path: write_onnx(path, _node("Softmax", [""], ["actions"])),
        "operations do not fit",
    ),
}
"""Hostile in the file of the policy itself, and what is said of it."""
BESIDE: dict[str, tuple[Callable[[Path], None], str]] = {
    "pattern in patterns": (beside("env.yaml", env_yaml(_nested(10))), "pattern"),
    "may be there": (beside("env.yaml", env_yaml(".?" * 60 + "!")), "pattern"),
    "aliases": (
        beside("deploy.yaml", _laughing("joint_ids_map: {}")),
        "alias",
    ),
    "aliases of a number": (
        beside("deploy.yaml", deploy_yaml() + _laughing("stiffness: {}")),
        "alias",
    ),
    "alias of itself": (beside("deploy.yaml", "a: &a [*a]"), "alias"),
    "a long number": (beside("deploy.yaml", deploy_yaml(stiffness=10**400)), "large"),
    "endless history": (
        beside(
            "deploy.yaml",
            deploy_yaml(
                observations={"base_ang_vel": {"history_length": float("inf")}}
            ),
        ),
        "inf",
    ),
    "endless decimation": (
        beside("env.yaml", env_yaml(decimation=float("inf"))),
        "inf",
    ),
    "endless decimation of rl_sar": (_rl_sar(decimation=float("inf")), "decimation"),
    "one history": (_rl_sar(observations_history=6), "observations_history"),
    "joints of two kinds": (_rl_sar(joint_mapping=["a", 1]), "joint_mapping"),
    "one angle": (
        beside("IO_descriptors.yaml", _descriptors(default_joint_pos=0.5)),
        "wrong kind",
    ),
}
"""Hostile in what lies beside it."""
