"""The actor as the policy file that everything else reads, and back.

What acts without noise is a list of known operations (`policy.networks.recipe`), so
that recording, playing, exporting and PPO need to know nothing of this learner.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.utils import resolve_class
from tensordict import TensorDict
from torch import Tensor, nn

from data.files.weights import misfits
from policy.networks.recipe import INPUT, Node, Recipe, RecipeNetwork, Stored
from policy.training.policy_error import PolicyError
from policy.training.ppo import PpoCfg, to_rsl_rl

from .sac import Sac
from .tanh_actor import TanhActor

OWN_STATE = "offpolicy_state_dict"
"""In a policy file, what beside the actor's mean training goes on from."""

_WALKING_STD = 0.15
"""Noise, in units of the action, of an actor that can walk."""
LOOKING_ON = 500
"""Updates of new critics before the actor they judge is changed."""


def recipe_of(obs_dim: int, sizes: tuple[int, ...]) -> Recipe:
    """`bound * tanh(...)` of normalised observations."""
    nodes = [
        Node(op="Sub", inputs=(INPUT, "mean"), output="centred"),
        Node(op="Div", inputs=("centred", "spread"), output="x"),
    ]
    weights: list[Stored] = []
    x, widths = "x", (obs_dim, *sizes, 12)
    for layer, (a, b) in enumerate(pairwise(widths)):
        names = f"weight{layer}", f"bias{layer}"
        weights.append(Stored(name=names[0], shape=(b, a)))
        weights.append(Stored(name=names[1], shape=(b,)))
        made = f"layer{layer}"
        nodes.append(
            Node(op="Gemm", inputs=(x, *names), output=made, attributes={"transB": 1})
        )
        x = made
        if layer < len(sizes):
            nodes.append(Node(op="Elu", inputs=(made,), output=f"{made}_elu"))
            x = f"{made}_elu"
    nodes.append(Node(op="Tanh", inputs=(x,), output="share"))
    nodes.append(Node(op="Mul", inputs=("share", "bound"), output="action"))
    return Recipe(
        obs_dim=obs_dim,
        nodes=tuple(nodes),
        output="action",
        weights=tuple(weights),
        constants=(
            Stored(name="mean", shape=(obs_dim,)),
            Stored(name="spread", shape=(obs_dim,)),
            Stored(name="bound", shape=(12,)),
        ),
        action_order=tuple(range(12)),
    )


def tensors_of(actor: TanhActor) -> dict[str, Tensor]:
    """The numbers of `recipe_of` by name."""
    found = {
        "mean": actor.obs_mean,
        "spread": actor.obs_spread,
        "bound": actor.bound,
    }
    for layer, linear in enumerate((*actor.hidden, actor.mean)):
        assert isinstance(linear, nn.Linear)
        found[f"weight{layer}"] = linear.weight.detach()
        found[f"bias{layer}"] = linear.bias.detach()
    return found


def described(ppo: PpoCfg, obs_dim: int) -> PpoCfg:
    """`ppo` as the policy file of an actor says it: its network is a recipe."""
    return replace(ppo, recipe=recipe_of(obs_dim, ppo.hidden_sizes))


def policy_states(learner: Sac, ppo: PpoCfg, std: Tensor) -> dict[str, Any]:
    """State dictionaries of a policy file.

    Args:
        learner: What has been learned.
        ppo: What `described` gave.
        std: [12] noise of the actions, in their unit.
    """
    cfg = to_rsl_rl(ppo)
    actor_class, actor_cfg = resolve_class(cfg["actor"])
    assert ppo.recipe is not None
    nothing = torch.zeros(1, ppo.recipe.obs_dim)
    obs = TensorDict({"policy": nothing}, batch_size=[1])
    with torch.random.fork_rng(devices=[]):
        model: MLPModel = actor_class(obs, cfg["obs_groups"], "actor", 12, **actor_cfg)
    assert isinstance(model.mlp, RecipeNetwork)
    model.mlp.fill(tensors_of(learner.actor))
    assert model.distribution is not None
    model.distribution.std_param.data.copy_(std)  # type: ignore[union-attr]
    critic = {f"critic.{k}": v for k, v in learner.critic.state_dict().items()}
    actor = {f"actor.{k}": v for k, v in learner.actor.state_dict().items()}
    own = {**actor, **critic, "log_alpha": learner.log_alpha.detach()}
    return {"actor_state_dict": model.state_dict(), OWN_STATE: own}


def require_networks(init: Path, payload: Mapping[str, Any]) -> None:
    """Refuse a policy file that `begin_from` could not take, whatever its sizes.

    Raises:
        PolicyError: its networks are neither of this learner nor of PPO.
    """
    of_ppo = "mlp.0.weight" in payload.get("actor_state_dict", {})
    if OWN_STATE not in payload and not of_ppo:
        raise PolicyError(
            f"{init} cannot be trained further off-policy: its network came from "
            "elsewhere, or chooses among others; leave --algorithm fastsac out"
        )


def begin_from(learner: Sac, init: Path, payload: Mapping[str, Any]) -> None:
    """Take over the networks of a policy file: all of one of this learner, the mean
    action of one of PPO.

    Raises:
        PolicyError: its networks are others.
    """
    require_networks(init, payload)
    if OWN_STATE in payload:
        own = payload[OWN_STATE]
        for name in ("actor", "critic"):
            network = getattr(learner, name)
            given = {
                key.removeprefix(f"{name}."): value
                for key, value in own.items()
                if key.startswith(f"{name}.")
            }
            _require_fit(init, name, given, network.state_dict())
            network.load_state_dict(given)
        learner.target.load_state_dict(learner.critic.state_dict())
        with torch.no_grad():
            learner.log_alpha.copy_(own["log_alpha"])
        return
    _begin_from_ppo(learner.actor, init, payload.get("actor_state_dict", {}))
    learner.actor.begin_with_std(_WALKING_STD)
    learner.looking_on = LOOKING_ON


def _begin_from_ppo(actor: TanhActor, init: Path, given: Mapping[str, Any]) -> None:
    """The network of PPO, whose mean is not bounded: near 0 tanh hardly bends it."""
    own = actor.state_dict()
    taken = {
        name.replace("obs_normalizer.", "normalizer."): value
        for name, value in given.items()
        if name.startswith("obs_normalizer.")
    }
    layers = [*(f"hidden.{i}" for i in range(len(actor.hidden))), "mean"]
    for layer, ours in enumerate(layers):
        for part in ("weight", "bias"):
            theirs = given.get(f"mlp.{2 * layer}.{part}")
            if theirs is not None:
                taken[f"{ours}.{part}"] = theirs
    wanted = {k: v for k, v in own.items() if not k.startswith(("log_std", "bound"))}
    _require_fit(init, "actor", taken, wanted)
    actor.load_state_dict({**own, **taken})
    with torch.no_grad():
        actor.mean.weight.div_(actor.bound[:, None])
        actor.mean.bias.div_(actor.bound)


def _require_fit(
    init: Path, name: str, given: Mapping[str, Any], own: Mapping[str, Tensor]
) -> None:
    if differences := misfits(given, own):
        raise PolicyError(
            f"{init} cannot be trained further off-policy, its {name} does not fit: "
            f"{differences}; give a policy that gaitpref trained, with networks of "
            "the same sizes"
        )
