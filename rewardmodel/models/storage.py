"""A reward model on disk: a directory with `reward.safetensors` and `reward.json`.

No pickle is written or read, and a model fitted to other features or descriptors than
this version computes is refused.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors

from data.features import FEATURES, features_sha256
from data.files.files import read_file, sha256_bytes, whole_directory
from data.files.limits import FACTS_BYTES, REWARD_BYTES
from data.files.plain import from_plain, to_plain
from data.files.weights import misfits, not_finite
from rewardmodel.cfg import FitCfg
from rewardmodel.descriptors.normaliser import Normaliser
from rewardmodel.descriptors.table import names_seen
from rewardmodel.errors import RewardError

from .fit_report import FitReport
from .kinds import KINDS, kind_called, make_scorer
from .model import Provenance, RewardModel

TENSORS_NAME = "reward.safetensors"
FACTS_NAME = "reward.json"
REWARD_NAMES = (TENSORS_NAME, FACTS_NAME)
"""All that lies in the directory of a reward."""
FORMAT_VERSION = 7
_STD_NAME = "normaliser.std"

_FEATURE_NAMES = tuple(feature.name for feature in FEATURES)


def save_reward(model: RewardModel, directory: Path) -> None:
    """Write `model` to `directory`, in place of a reward that is there.

    Equal models give equal bytes: the time the fit took is left out.

    Raises:
        FileError: the directory holds something else than a reward.
        OSError: the disk is full or not writable.
    """
    tensors = save_tensors({k: v.cpu() for k, v in model.state_dict().items()})
    facts = json.dumps(_facts(model, tensors), indent=1) + "\n"
    with whole_directory(directory, REWARD_NAMES) as partial:
        (partial / TENSORS_NAME).write_bytes(tensors)
        (partial / FACTS_NAME).write_text(facts)


def load_reward(directory: Path) -> RewardModel:
    """Read what `save_reward` wrote.

    Raises:
        FileError: a path leads to something else than a file.
        RewardError: a file is missing or damaged, or the model was fitted to other
            features or descriptors; the message names them.
    """
    facts_bytes = _read(directory / FACTS_NAME, FACTS_BYTES)
    tensors_bytes = _read(directory / TENSORS_NAME, REWARD_BYTES)
    try:
        facts = json.loads(facts_bytes)
        _check_readable(facts, directory)
        if sha256_bytes(tensors_bytes) != facts["tensors_sha256"]:
            raise ValueError(f"{TENSORS_NAME} is not the file {FACTS_NAME} describes")
        report = from_plain(FitReport, facts["report"] | {"seconds": 0.0})
        provenance = Provenance(
            from_plain(FitCfg, facts["cfg"]),
            report,
            str(facts["answers_sha256"]),
            frozenset(map(str, facts["episodes"])),
        )
        count = len(names_seen(kind_called(provenance.cfg.kind).sight))
        model = RewardModel(Normaliser(count), make_scorer(provenance.cfg), provenance)
        tensors = load_tensors(tensors_bytes)
        if differences := misfits(tensors, model.state_dict()):
            raise ValueError(differences)
        # What never varies has an infinite deviation, which scales it to nothing.
        scales = {_STD_NAME: 1.0 / tensors[_STD_NAME]}
        if bad := not_finite(tensors | scales):
            raise ValueError(f"weights that are no finite numbers: {bad}")
        model.load_state_dict(tensors)
        model.scorer.require_sound()
    except (ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as error:
        found = " ".join(f"{error}".split())[:400]
        told = (
            found if type(error) is ValueError else f"{type(error).__name__}: {found}"
        )
        raise RewardError(
            f"{directory} holds a damaged reward model ({told}); fit it again"
        ) from error
    return model


def _facts(model: RewardModel, tensors: bytes) -> dict[str, Any]:
    provenance = model.provenance
    report = to_plain(provenance.report)
    del report["seconds"]
    return {
        "format_version": FORMAT_VERSION,
        "kind": provenance.cfg.kind,
        "features": list(_FEATURE_NAMES),
        "features_sha256": features_sha256(),
        "descriptors": list(model.names),
        "sizes": {k: list(v.shape) for k, v in model.state_dict().items()},
        "cfg": to_plain(provenance.cfg),
        "report": report,
        "answers_sha256": provenance.answers_sha256,
        "episodes": sorted(provenance.episodes),
        "tensors_sha256": sha256_bytes(tensors),
    }


def _read(path: Path, limit: int) -> bytes:
    try:
        return read_file(path, limit)
    except (FileNotFoundError, NotADirectoryError):
        raise RewardError(
            f"{path} is missing, so {path.parent} is no reward model; make one with "
            "`gaitpref fit`"
        ) from None


def _check_readable(facts: dict[str, Any], directory: Path) -> None:
    if facts["format_version"] != FORMAT_VERSION:
        raise RewardError(
            f"{directory} has format version {facts['format_version']}, this version "
            f"reads {FORMAT_VERSION}; fit the reward again"
        )
    if facts["kind"] not in KINDS:
        raise RewardError(
            f"{directory} holds a reward of kind {facts['kind']!r}, this version reads "
            f"{', '.join(KINDS)}; fit the reward again"
        )
    _check_names("feature", facts["features"], _FEATURE_NAMES, directory)
    seen = names_seen(kind_called(str(facts["kind"])).sight)
    _check_names("descriptor", facts["descriptors"], seen, directory)
    if facts["features_sha256"] != features_sha256():
        raise RewardError(
            f"{directory} was fitted to features of the same names but other widths or "
            "units; fit the reward again"
        )


def _check_names(
    what: str, found: Sequence[str], expected: Sequence[str], directory: Path
) -> None:
    if list(found) == list(expected):
        return
    missing = ", ".join(name for name in expected if name not in found) or "none"
    unknown = ", ".join(name for name in found if name not in expected) or "none"
    raise RewardError(
        f"{directory} was fitted to other {what}s than this version computes "
        f"(it lacks: {missing}; it has besides: {unknown}); fit the reward again"
    )
