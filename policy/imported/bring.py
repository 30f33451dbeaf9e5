"""A policy that others trained, made one of ours."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from data.errors import GaitprefError
from data.files.files import read_file, sha256_bytes, write_atomically
from data.files.limits import POLICY_BYTES
from data.files.telling import Tell, silent
from policy.env.env_cfg import EnvCfg
from policy.env.velocity_commands import env_for
from policy.law.driven import driven_by
from policy.law.law import Law, LawError
from policy.law.origin import Origin, verdict
from policy.robots.robot import Robot, load_robot
from policy.training.checkpoint import Policy, PolicyInfo, load_policy, payload_bytes
from policy.training.ppo import PpoCfg
from policy.training.training_dir import POLICY_NAME

from .meaning.beside import activation_beside, meaning_of, policy_file
from .meaning.draft import NEEDED, Draft, complete, spelled_by, with_guesses
from .meaning.law_toml import read_law_toml
from .meaning.trainer_laws import PRESETS, preset_law
from .readers.found import Found
from .readers.network_file import read_network
from .trial import measure

_NOISE_RAD = 0.05
"""Exploration noise of a policy whose file says none, at the joints."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Understood:
    """A policy's file, its network and its law as far as it is known."""

    file: Path
    found: Found
    draft: Draft
    """With rules in the place of what nobody said."""
    in_order: Callable[[tuple[str, ...]], Draft]
    """The draft with joints in another order, which what was said by name follows."""


def understand(
    path: Path,
    *,
    law: Path | None = None,
    preset: str | None = None,
    explain: bool = False,
    robot: Robot | None = None,
) -> Understood:
    """The network of a file or run directory, and what its numbers mean.

    Args:
        path: The file, or the directory of its training.
        law: A TOML that says more than what lies beside the file, or otherwise.
        preset: Take the law of this trainer instead of what lies beside the file.
        explain: Leave open what cannot be read beside the file, and say why. A law
            with all that is needed does so too.
        robot: Whose names and order of joints an env.yaml is read by.

    Raises:
        GaitprefError: the file or what lies beside it cannot be used.
    """
    if preset is not None and preset not in PRESETS:
        raise LawError(
            f"there is no preset {preset!r}; there are: {', '.join(PRESETS)}"
        )
    file = policy_file(path)
    said = None if law is None else read_law_toml(law)
    activation = (said and said.activation) or activation_beside(file)
    if activation is None and preset is not None:
        activation = "elu"
    found = read_network(file, activation)
    whole = said is not None and all(getattr(said, n) is not None for n in NEEDED)
    spelled = None if robot is None else spelled_by(robot)
    beside = partial(_beside, file, found, explain or whole, spelled)
    trained = partial(preset_law, preset) if preset else beside
    in_order = partial(_draft, found, said, trained)
    draft = in_order(None if said is None else said.joints)
    return Understood(file=file, found=found, draft=draft, in_order=in_order)


def _draft(
    found: Found,
    said: Draft | None,
    trained: Callable[[tuple[str, ...] | None], Draft],
    joints: tuple[str, ...] | None,
) -> Draft:
    """All that is known, with rules in the place of what nobody said."""
    draft = trained(joints)
    if said is not None:
        draft = said.over(draft)
    if found.guessed:
        draft = replace(draft, guessed={**draft.guessed, **found.guessed})
    return with_guesses(draft, found.recipe.obs_dim)


def _beside(
    file: Path,
    found: Found,
    dispensable: bool,
    spelled: Mapping[str, str] | None,
    joints: tuple[str, ...] | None,
) -> Draft:
    """What the file says or what lies beside it; nothing, if that is `dispensable`."""
    try:
        metadata = found.metadata or _exported(file, found.recipe.obs_dim)
        draft = meaning_of(file, metadata, joints, spelled)
    except LawError as error:
        if not dispensable:
            raise
        return Draft(source=f"nothing that can be read ({error})")
    return draft or Draft(source=f"nothing beside {file.name}")


def _exported(file: Path, obs_dim: int) -> Mapping[str, str]:
    """What the one ONNX beside a checkpoint, exported of such a network, says of it."""
    folders = (file.parent, file.parent / "exported")
    models = [model for folder in folders for model in folder.glob("*.onnx")]
    if file in models or len(models) != 1:
        return {}
    try:
        found = read_network(models[0])
    except (GaitprefError, ImportError):
        return {}
    return (found.metadata or {}) if found.recipe.obs_dim == obs_dim else {}


def embodied(known: Understood, robot_xml: Path | None) -> tuple[Law, Robot, EnvCfg]:
    """The law on a robot, the robot driven by it, and its environment.

    Raises:
        GaitprefError: law and robot do not fit.
    """
    dt_s = known.draft.physics_dt_s or EnvCfg().physics_dt_s
    model = load_robot(robot_xml, physics_dt_s=dt_s)
    law = complete(known.draft, model, known.found.recipe.obs_dim)
    robot = driven_by(model, law)
    return law, robot, env_for(robot, EnvCfg()).under(law)


def bring(
    known: Understood, robot_xml: Path | None, out: Path, tell: Tell = silent
) -> Policy:
    """Try the policy on the robot, and write it into `out` as a policy of ours; `tell`
    gets the control steps of the trial.

    Raises:
        GaitprefError: it does not fit the robot.
    """
    law, robot, cfg = embodied(known, robot_xml)
    order = tuple(int(joint) for joint in law.to_canonical)
    network = known.found.network(order)
    rows = measure(lambda obs, noise=None: network(obs), robot, cfg, tell=tell)
    content = read_file(known.file, POLICY_BYTES)
    std = known.found.std
    if std is None:
        std = _NOISE_RAD / torch.tensor(law.action_scale_rad).abs().clamp(min=1e-3)
    info = PolicyInfo(
        # Who has walked is not asked about as if chance had made it.
        steps=1,
        reward=f"that of {known.file.name}",
        seed=0,
        env=cfg,
        ppo=PpoCfg(recipe=network.recipe, privileged_critic=True),
        robot_name=robot.name,
        robot_mjcf=robot.mjcf,
        origin=Origin(
            file=known.file.name,
            sha256=sha256_bytes(content),
            kind=known.found.kind,
            meaning=known.draft.source,
            guessed=dict(known.draft.guessed),
            acceptance=rows,
            verdict=verdict(rows),
        ),
    )
    state = {f"mlp.{key}": value for key, value in network.state_dict().items()}
    state["distribution.std_param"] = std[list(order)].float().clone()
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(
        out / POLICY_NAME, payload_bytes({"actor_state_dict": state}, info)
    )
    return load_policy(out / POLICY_NAME)
