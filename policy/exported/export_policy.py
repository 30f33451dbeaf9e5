"""A policy as files that need no Python of ours: ONNX, TorchScript, JSON, MJCF.

Shapes: N observations at once.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from data.files.files import write_atomically
from policy.env.course import AHEAD_DIM
from policy.training.checkpoint import Policy
from policy.training.policy_error import PolicyError

from .deployed import Deployed, DeployedGaits
from .policy_json import MEMORY, describe, law_of

ONNX_NAME, SCRIPT_NAME = "policy.onnx", "policy.pt"
JSON_NAME, MJCF_NAME = "policy.json", "robot.xml"


def export(policy: Policy, out: Path) -> list[Path]:
    """Write `policy` into the directory `out`; gives the files written.

    The network maps `obs` [N, D] to `action` [N, 12] and `joint_target` [N, 12], with
    joints in the order of policy.json. One that chooses among gaits also takes what it
    remembers, `gait` and `steps` [N], and gives it for the next step.
    """
    robot = policy.robot()
    law = law_of(policy.info, robot)
    gaits = policy.info.ppo.gaits
    kind = Deployed if gaits is None else DeployedGaits
    # Also says of what no file can hold that it cannot, before anything is written.
    deployed = kind(policy, law).eval()
    described = json.dumps(describe(policy.info, robot, policy.sha256), indent=1)
    dim = law.obs_dim if gaits is None else law.obs_dim + AHEAD_DIM
    remembered = () if gaits is None else tuple(MEMORY)
    contents = {
        ONNX_NAME: _by_torch(
            "ONNX", lambda: _onnx(deployed, dim, remembered, described)
        ),
        SCRIPT_NAME: _by_torch(
            "TorchScript", lambda: _torchscript(deployed, dim, remembered)
        ),
        JSON_NAME: described.encode() + b"\n",
        MJCF_NAME: robot.mjcf.encode(),
    }
    out.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        write_atomically(out / name, content)
    return [out / name for name in contents]


def _by_torch(kind: str, write: Callable[[], bytes]) -> bytes:
    """What `write` gives.

    Raises:
        PolicyError: torch cannot, whatever it says of its own inside.
    """
    try:
        # It prints what it was at when it fails.
        with contextlib.redirect_stderr(io.StringIO()):
            return write()
    except Exception as error:
        cause = error.__cause__ or error
        told = " ".join(re.sub(r"\x1b\[\d*m", "", str(cause)).split())[:160]
        raise PolicyError(
            f"torch cannot write this policy as {kind} ({type(cause).__name__}: {told})"
            ": an imported policy goes out as it came in with --like SOURCE; of one "
            "trained here, try the versions of constraints.txt"
        ) from None


def _examples(rows: int, obs_dim: int, remembered: tuple[str, ...]) -> list[Tensor]:
    """Inputs of a network: observations, and what is remembered."""
    obs = torch.linspace(-1, 1, rows * obs_dim).view(rows, obs_dim)
    return [obs, *(torch.zeros(rows, dtype=torch.long) for _ in remembered)]


def _onnx(
    deployed: nn.Module, obs_dim: int, remembered: tuple[str, ...], described: str
) -> bytes:
    # It would tell of every package it could export for and does not find.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    batch = torch.export.Dim("batch", min=1)
    with warnings.catch_warnings():
        # The exporter warns of its own future.
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            deployed,
            # Two rows: a batch of one would be taken for a constant.
            tuple(_examples(2, obs_dim, remembered)),
            dynamo=True,
            verbose=False,
            input_names=["obs", *remembered],
            output_names=[
                *("action", "joint_target"),
                *(f"next_{name}" for name in remembered),
            ],
            dynamic_shapes={name: {0: batch} for name in ("obs", *remembered)},
        )
    assert program is not None
    # One file that is copied alone still says what its numbers mean.
    program.model.metadata_props[JSON_NAME] = described
    # Serialised whole, the weights are inside and no second file is needed.
    return program.model_proto.SerializeToString()


def _torchscript(
    deployed: nn.Module, obs_dim: int, remembered: tuple[str, ...]
) -> bytes:
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # TorchScript is deprecated, and what robots run.
        warnings.simplefilter("ignore")
        # Traced, since a network of others is no code that could be scripted.
        with torch.no_grad():
            example = tuple(_examples(2, obs_dim, remembered))
            traced: Any = torch.jit.trace(deployed, example)
        torch.jit.save(traced, stream)
    # A trace keeps what hung on the example for what always is.
    for rows in (1, 3):
        inputs = _examples(rows, obs_dim, remembered)
        with torch.no_grad():
            pairs = zip(traced(*inputs), deployed(*inputs), strict=True)
        if not all(torch.allclose(a, b, atol=1e-5) for a, b in pairs):
            raise ValueError("its operations hang on how many observations there are")
    return stream.getvalue()
