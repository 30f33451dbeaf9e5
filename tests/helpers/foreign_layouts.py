"""A policy of ours in the layouts of others: it sees `TERMS`, joints in any order."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import torch
import yaml
from torch import Tensor

from policy.law.encoder import OWN_STARTS
from policy.law.law import OF_JOINTS, Law, Term
from policy.training.checkpoint import Policy

TERMS = ("base_lin_vel", "base_ang_vel", "projected_gravity", "command")
TERMS += ("joint_pos", "joint_vel", "last_action")
SCALES = {"base_ang_vel": 0.25, "joint_vel": 0.05}
SCALED = tuple(Term(name=name, scale=(SCALES.get(name, 1.0),)) for name in TERMS)


def columns_in(order: tuple[str, ...], terms: tuple[Term, ...] = SCALED) -> np.ndarray:
    """[D] where the numbers of a foreign observation are in our own."""
    law = law_in(order)
    return np.concatenate(
        [
            OWN_STARTS[term.name]
            + (law.from_canonical if term.name in OF_JOINTS else np.arange(term.width))
            for term in terms
        ]
    )


def law_in(order: tuple[str, ...], **other: Any) -> Law:
    zeros = (0.0,) * 12
    values: dict[str, Any] = {
        "terms": tuple(Term(name=name) for name in TERMS),
        "joints": order,
        "default_joint_pos_rad": zeros,
        "action_scale_rad": (0.3,) * 12,
        "action_offset_rad": zeros,
        "kp_nm_per_rad": (1.0,) * 12,
        "kd_nm_s_per_rad": zeros,
    }
    return Law(**values | other)


def in_their_order(
    policy: Policy,
    order: tuple[str, ...],
    *,
    scaled: bool,
    terms: tuple[Term, ...] = SCALED,
) -> tuple[list[tuple[Tensor, Tensor]], Tensor, Tensor]:
    """Layers, mean and deviation that see `terms` in `order`.

    Where observations are `scaled`, the normaliser is in the first layer."""
    state = {k: v.clone() for k, v in policy._actor.state_dict().items()}
    columns = torch.from_numpy(columns_in(order, terms))
    rows = torch.from_numpy(law_in(order).from_canonical)
    layers = [(state[f"mlp.{n}.weight"], state[f"mlp.{n}.bias"]) for n in (0, 2, 4)]
    mean = state["obs_normalizer._mean"][:, columns]
    std = state["obs_normalizer._std"][:, columns]
    first = layers[0][0][:, columns]
    if scaled:
        scale = torch.tensor([each for term in terms for each in term.scales])
        folded = first / (std + 0.01)
        layers[0] = (folded / scale, layers[0][1] - folded @ mean[0])
    else:
        layers[0] = (first, layers[0][1])
    layers[2] = (layers[2][0][rows], layers[2][1][rows])
    return layers, mean, std


def checkpoint_of(
    policy: Policy,
    layout: str,
    order: tuple[str, ...],
    terms: tuple[Term, ...] = SCALED,
) -> dict[str, Any]:
    """The file that a version of rsl_rl writes."""
    layers, mean, std = in_their_order(policy, order, scaled=layout == "1", terms=terms)
    prefix = "actor" if layout in ("1", "2.3", "3") else "mlp"
    states: dict[str, Any] = {}
    for number, (weight, bias) in zip((0, 2, 4), layers, strict=True):
        states |= {f"{prefix}.{number}.weight": weight, f"{prefix}.{number}.bias": bias}
    norm = {"_mean": mean, "_std": std, "_var": std**2, "count": torch.tensor(5)}
    noise = policy.std[torch.from_numpy(law_in(order).from_canonical)]
    names = {"1": "std", "2.3": "log_std", "3": "std", "4": "log_std"}
    name = names.get(layout, "distribution.std_param")
    states[name] = noise.log() if name == "log_std" else noise
    rest = {"iter": 7, "infos": None, "optimizer_state_dict": {}}
    if layout == "3":
        states |= {f"actor_obs_normalizer.{k}": v for k, v in norm.items()}
    if layout in ("4", "5"):
        states |= {f"obs_normalizer.{k}": v for k, v in norm.items()}
        return {"actor_state_dict": states, "critic_state_dict": {}, **rest}
    if layout == "2.3":
        rest["obs_norm_state_dict"] = norm
    return {"model_state_dict": states, **rest}


def vectors_of(policy: Policy, order: tuple[str, ...]) -> dict[str, list[float]]:
    """What a law says of the joints, in `order`."""
    robot, idx = policy.robot(), law_in(order).from_canonical
    return {
        "pose": robot.home_joint_pos[idx].tolist(),
        "kp": robot.kp[idx].tolist(),
        "kd": robot.kd[idx].tolist(),
    }


def toml_of(policy: Policy, order: tuple[str, ...], *, scaled: bool) -> str:
    told = vectors_of(policy, order)
    lines = [
        f"joints = {json.dumps([f'{name}_joint' for name in order])}",
        f"default_joint_pos_rad = {told['pose']}",
        f"kp_nm_per_rad = {told['kp']}",
        f"kd_nm_s_per_rad = {told['kd']}",
        "action_scale_rad = 0.3",
        "action_limit = 3",
    ]
    for name in TERMS:
        scale = SCALES.get(name, 1.0) if scaled else 1.0
        lines += ["[[terms]]", f'name = "{name}"', f"scale = {scale}"]
    return "\n".join(lines)


def deploy_yaml(**changes: Any) -> str:
    """A deploy.yaml of Unitree's."""
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
