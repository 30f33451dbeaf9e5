"""Policy files: RSL-RL's state dictionaries and all that is needed to use them."""

from __future__ import annotations

import io
import json
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.utils import resolve_class
from tensordict import TensorDict
from torch import Tensor, nn

from data.episodes.team_rows import SIGHT_DIM
from data.files.files import read_file, sha256_bytes, write_atomically
from data.files.limits import POLICY_BYTES
from data.files.plain import ADDED_LATER, from_plain, to_plain
from data.files.unpacking import require_stored
from data.files.weights import misfits, not_finite
from policy.env.course import AHEAD_DIM
from policy.env.env_cfg import EnvCfg
from policy.env.feature_row import OBS_DIM
from policy.law.origin import Origin
from policy.networks.brought_model import BroughtModel
from policy.networks.recipe import NetworkError
from policy.networks.tried import tried
from policy.networks.two_model import TwoModel
from policy.options.gaits_model import GaitsModel
from policy.robots.robot import Robot, load_robot_xml

from .others import writer_of_bytes, writer_of_payload, writer_without_description
from .policy_error import PolicyError as PolicyError
from .ppo import PpoCfg, to_rsl_rl
from .written import as_written

FORMAT_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class PolicyInfo:
    """Where a policy comes from and how to run it; stored inside its file."""

    steps: int
    """Environment steps it was trained, those of the policies before it included."""
    reward: str
    """What the policy was trained on, in words."""
    seed: int
    """Of its training."""
    env: EnvCfg
    """What it was trained in: rates, commands, scale of the actions, ground."""
    ppo: PpoCfg
    """How it was trained, the sizes of its networks among it."""
    robot_name: str
    robot_mjcf: str
    """The robot as one self-contained MJCF text."""
    format_version: int = FORMAT_VERSION
    origin: Origin | None = field(default=None, metadata=ADDED_LATER)
    """Where it was brought in from, if it was."""


class Policy:
    """A trained actor; observations in, actions out."""

    def __init__(
        self, actor: MLPModel | GaitsModel | TwoModel, info: PolicyInfo, sha256: str
    ) -> None:
        self.info = info
        self.sha256 = sha256
        self._actor = actor.eval()

    @torch.inference_mode()
    def __call__(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        """Actions [N, 12] for `obs` [N, 48], or what its law says.

        Args:
            obs: What `QuadrupedEnv.get_observations` gives.
            noise: Standard normal draws [N, 12], scaled by the policy's own standard
                deviation; None acts without exploration.
        """
        mean = self._actor(TensorDict({"policy": obs}, batch_size=[len(obs)]))
        if noise is None:
            return mean
        if isinstance(self._actor, TwoModel):
            return mean + noise * self._actor.std_of(obs)
        return mean + noise * self.std

    @property
    def network(self) -> nn.Module:
        """Observations [N, D] to actions [N, 12], without noise; where it chooses among
        gaits, with what is remembered (`GaitsNetwork`)."""
        return self._actor.as_jit()

    @property
    def std(self) -> Tensor:
        """Exploration noise [12], or [2, 12] of two policies, units of the action."""
        return self._actor.distribution.std_param.detach()  # type: ignore[union-attr]

    @property
    def holds_home(self) -> bool:
        """Whether it does nothing whatever it sees, as `holding_home` makes one."""
        states = self._actor.state_dict()
        return not any(states[name].any() for name in _last_layer(states))

    @property
    def gait(self) -> Tensor | None:
        """[N] which of its gaits acted last; None for a policy of one."""
        if isinstance(self._actor, GaitsModel):
            return self._actor.running.gait.clone()
        return None

    def wander(self, which: Tensor, rng: torch.Generator) -> None:
        """Change gaits at random in the rows `which` [N] from now on, where it has
        more than one."""
        if isinstance(self._actor, GaitsModel):
            self._actor.wandering, self._actor.rng = which, rng

    def robot(self) -> Robot:
        """The robot it was trained on."""
        return load_robot_xml(
            self.info.robot_mjcf,
            name=self.info.robot_name,
            physics_dt_s=self.info.env.physics_dt_s,
        )


def payload_bytes(states: dict[str, Any], info: PolicyInfo) -> bytes:
    """The contents of a policy file with these state dictionaries; equal states give
    equal bytes."""
    told = to_plain(info)
    told["ppo"] = as_written(told["ppo"])
    infos = {"gaitpref": json.dumps(told)}
    return saved_bytes({**states, "iter": 0, "infos": infos})


def holding_home(path: Path) -> bytes:
    """The contents of the policy file `path`, its actor holding the home pose.

    What nobody has trained had better do nothing than what chance put into it. The last
    layer is zeroed, which training can begin from.

    Raises:
        PolicyError: the file is missing, damaged, or not ours.
    """
    payload = read_plain(path)
    actor = payload["actor_state_dict"]
    for name in _last_layer(actor):
        actor[name].zero_()
    # Off-policy, what is trained on stands beside what acts.
    for name, value in payload.get("offpolicy_state_dict", {}).items():
        if name.startswith("actor.mean."):
            value.zero_()
    return saved_bytes(payload)


def _last_layer(actor: dict[str, Any]) -> list[str]:
    """Names of its weight and bias in the state of an actor."""
    # Constants of a recipe, as a normaliser's, are no weights.
    weights = [n for n in actor if n.startswith("mlp.") and not n.startswith("mlp.c")]
    return weights[-2:]


def save_policy(path: Path, states: dict[str, Any], info: PolicyInfo) -> None:
    """Write a policy file with these state dictionaries, all or nothing."""
    write_atomically(path, payload_bytes(states, info))


def read_plain(path: Path) -> dict[str, Any]:
    """The dictionary in a file of ours, without running code from it.

    Raises:
        PolicyError: the file is missing, damaged, or not ours, or one of its weights is
            no finite number.
        FileError: the path leads to something else.
    """
    return _plain(path, _bytes_of(path))


def load_policy(path: Path) -> Policy:
    """Read a policy file.

    Raises:
        PolicyError: the file is missing, damaged, or not ours, or one of its weights is
            no finite number.
    """
    content = _bytes_of(path)
    payload = _plain(path, content)
    info = policy_info(path, payload)
    if (info.ppo.gaits is None) != (info.env.course is None):
        raise PolicyError(
            f"{path} has a course without gaits to choose among, or gaits without a "
            "course: make it anew with `gaitpref options`"
        )
    team = info.env.team
    if (info.ppo.policies is not None) and not (team and team.told_apart):
        raise PolicyError(
            f"{path} has a network for each of two robots, which nothing tells apart: "
            "make it anew with `gaitpref team train --policies 2`"
        )
    cfg = to_rsl_rl(info.ppo)
    actor_class, actor_cfg = resolve_class(cfg["actor"])
    dim = OBS_DIM if info.env.law is None else info.env.law.obs_dim
    if info.ppo.gaits is not None:
        dim += AHEAD_DIM
    if team is not None:
        dim += SIGHT_DIM + team.told_apart
    obs = TensorDict({"policy": torch.zeros(1, dim)}, batch_size=[1])
    actor = actor_class(obs, cfg["obs_groups"], "actor", 12, **actor_cfg)
    weights = payload["actor_state_dict"]
    if differences := misfits(weights, actor.state_dict()):
        raise PolicyError(
            f"{path} does not hold the network it names: {differences}; give a policy "
            "of this version of gaitpref"
        )
    actor.load_state_dict(weights)
    if isinstance(actor, BroughtModel):
        try:
            tried(actor.mlp, torch.zeros(1, dim))
        except NetworkError as error:
            raise PolicyError(f"{path}: {error}") from None
    return Policy(actor, info, sha256_bytes(content))


def _bytes_of(path: Path) -> bytes:
    try:
        return read_file(path, POLICY_BYTES)
    except FileNotFoundError:
        raise PolicyError(
            f"there is no policy file {path}; `gaitpref train --out DIR --reward task` "
            f"makes DIR/policy.pt"
        ) from None


def _plain(path: Path, content: bytes) -> dict[str, Any]:
    if writer := writer_of_bytes(content):
        raise _of_another(path, writer)
    try:
        require_stored(content)
        payload = torch.load(io.BytesIO(content), weights_only=True)
    except Exception as error:
        raise PolicyError(
            f"{path} is not a policy file of gaitpref, or is damaged "
            f"({type(error).__name__}); give a policy.pt or a file of a checkpoints/ "
            "folder"
        ) from None
    if writer := writer_of_payload(payload):
        raise _of_another(path, writer)
    states = {name: payload[name] for name in payload if name.endswith("_state_dict")}
    if bad := not_finite(states):
        raise PolicyError(
            f"{path} holds weights that are no finite numbers: {bad}; its training "
            "diverged, so give an earlier file of its checkpoints/ folder"
        )
    return payload


def _of_another(path: Path, writer: str) -> PolicyError:
    return PolicyError(
        f"{path} is {writer}, not a policy file of gaitpref: give the policy.pt that "
        "`gaitpref train` wrote"
    )


def policy_info(path: Path, payload: dict[str, Any]) -> PolicyInfo:
    """What the file says of itself.

    Raises:
        PolicyError: it says nothing usable, or was written by a newer version.
    """
    infos = payload.get("infos")
    if not isinstance(infos, dict) or "gaitpref" not in infos:
        raise _of_another(path, writer_without_description(payload))
    try:
        values = json.loads(infos["gaitpref"])
        if values["format_version"] > FORMAT_VERSION:
            raise PolicyError(
                f"{path} has policy format {values['format_version']}, this gaitpref "
                f"reads up to {FORMAT_VERSION}: update gaitpref"
            )
        return from_plain(PolicyInfo, values)
    except (KeyError, TypeError, ValueError) as error:
        raise PolicyError(
            f"{path} has a description that this gaitpref cannot read ({error}); give "
            "a policy of this version, or train it anew"
        ) from None


def saved_bytes(payload: dict[str, Any]) -> bytes:
    """The contents of a file of `payload`: the same wherever it was made, and readable
    where there is no GPU."""
    buffer = io.BytesIO()
    torch.save(_on_cpu(payload), buffer)
    return buffer.getvalue()


def _on_cpu(state: Any) -> Any:
    match state:
        case Tensor():
            return state.cpu()
        case dict():
            # A copy keeps what torch notes on a dictionary of weights.
            moved = copy(state)
            moved.update((key, _on_cpu(value)) for key, value in state.items())
            return moved
        case list():
            return [_on_cpu(value) for value in state]
        case tuple():
            return tuple(_on_cpu(value) for value in state)
    return state
