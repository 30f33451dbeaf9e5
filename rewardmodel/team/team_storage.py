"""The reward of a team on disk: `team.safetensors` and `team.json` in a directory."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from data.errors import GaitprefError
from data.features import features_sha256
from data.files.files import read_file, sha256_bytes, whole_directory
from data.files.limits import FACTS_BYTES, REWARD_BYTES
from data.files.plain import from_plain, to_plain
from data.files.weights import not_finite
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.descriptors.table import DESCRIPTOR_NAMES
from rewardmodel.errors import RewardError
from rewardmodel.models.fit_report import FitReport

from .pair_habits import PAIR_NAMES
from .team_reward import TeamReward, Walkers

TEAM_TENSORS, TEAM_FACTS = "team.safetensors", "team.json"
TEAM_FILES = (TEAM_TENSORS, TEAM_FACTS)
"""All that lies in the directory of a reward of a team."""
FORMAT_VERSION = 1
_NAMES = [*DESCRIPTOR_NAMES, *PAIR_NAMES]


def save_team(model: TeamReward, directory: Path) -> None:
    """Write `model` to `directory`, in place of a reward of a team that is there.

    Raises:
        FileError: the directory holds something else.
        OSError: the disk is full or not writable.
    """
    tensors = save_tensors(
        {
            "weights": model.weights.contiguous(),
            "own.mean": model.own.mean,
            "own.std": model.own.std,
            "pair.mean": model.pair.mean,
            "pair.std": model.pair.std,
        }
    )
    report = to_plain(model.report)
    del report["seconds"]
    facts: dict[str, Any] = {
        "format_version": FORMAT_VERSION,
        "kind": "team",
        "descriptors": _NAMES,
        "features_sha256": features_sha256(),
        "scale": model.scale,
        "report": report,
        "answers_sha256": model.answers_sha256,
        "episodes": sorted(model.episodes),
        "walkers": None if model.walkers is None else to_plain(model.walkers),
        "tensors_sha256": sha256_bytes(tensors),
    }
    with whole_directory(directory, TEAM_FILES) as partial:
        (partial / TEAM_TENSORS).write_bytes(tensors)
        (partial / TEAM_FACTS).write_text(json.dumps(facts, indent=1) + "\n")


def load_team(directory: Path) -> TeamReward:
    """Read what `save_team` wrote.

    Raises:
        FileError: a path leads to something else than a file.
        RewardError: a file is missing or damaged, or was fitted to other descriptors.
    """
    facts_bytes = _read(directory / TEAM_FACTS, FACTS_BYTES)
    tensors_bytes = _read(directory / TEAM_TENSORS, REWARD_BYTES)
    try:
        facts = json.loads(facts_bytes)
        _require_ours(facts)
        if sha256_bytes(tensors_bytes) != facts["tensors_sha256"]:
            raise ValueError(f"{TEAM_TENSORS} is not the file {TEAM_FACTS} describes")
        tensors = load_tensors(tensors_bytes)
        scale = float(facts["scale"])
        if not (math.isfinite(scale) and scale > 0):
            raise ValueError(f"a scale of {scale}")
        weights = tensors["weights"]
        if weights.ndim != 2 or weights.shape[1] != len(_NAMES) or not len(weights):
            raise ValueError(f"weights of shape {list(weights.shape)}")
        if bad := not_finite({"weights": weights}):
            raise ValueError(f"weights that are no finite numbers: {bad}")
        return TeamReward(
            own=_normaliser(tensors, "own", len(DESCRIPTOR_NAMES)),
            pair=_normaliser(tensors, "pair", len(PAIR_NAMES)),
            weights=weights.float(),
            scale=scale,
            report=from_plain(FitReport, facts["report"] | {"seconds": 0.0}),
            answers_sha256=str(facts["answers_sha256"]),
            episodes=frozenset(map(str, facts["episodes"])),
            walkers=_walkers(facts.get("walkers")),
        )
    except GaitprefError:
        raise
    except (ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as error:
        found = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        raise RewardError(
            f"{directory} holds a damaged reward of a team ({found}); fit it again "
            "with `gaitpref team fit`"
        ) from error


def _walkers(told: Any) -> Walkers | None:
    """Those that a file tells of; none in files written before they were."""
    return None if told is None else from_plain(Walkers, told)


def _normaliser(tensors: dict[str, Tensor], name: str, count: int) -> Normaliser:
    mean, std = tensors[f"{name}.mean"], tensors[f"{name}.std"]
    # What never varies has an infinite deviation, which scales it to nothing.
    if mean.shape != (count,) or std.shape != (count,) or not bool((std > 0).all()):
        raise ValueError(f"{name} standardises {list(mean.shape)} numbers")
    if not bool(torch.isfinite(mean).all()):
        raise ValueError(f"{name} has a mean that is no finite number")
    normaliser = Normaliser(count)
    normaliser.mean.copy_(mean)
    normaliser.std.copy_(std)
    return normaliser


def _require_ours(facts: dict[str, Any]) -> None:
    version = facts["format_version"]
    if facts["kind"] != "team" or version != FORMAT_VERSION:
        raise ValueError(f"it is {facts['kind']!r} of version {str(version)[:20]}")
    if facts["descriptors"] != _NAMES or facts["features_sha256"] != features_sha256():
        raise ValueError("it was fitted to other habits than this version computes")


def _read(path: Path, limit: int) -> bytes:
    try:
        return read_file(path, limit)
    except (FileNotFoundError, NotADirectoryError):
        raise RewardError(
            f"{path} is missing, so {path.parent} is no reward of a team; make one "
            "with `gaitpref team fit`"
        ) from None
