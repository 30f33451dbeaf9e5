"""Exports as HDF5: Minari (T + 1 observations an episode) and D4RL (flat arrays)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from data.episodes import schema
from data.episodes.episode import Episode
from data.files.files import require_room
from gaitpref.console.extras import require

from .export_environment import action_bound, env_spec
from .export_source import Exported, Source, new_directory

_MINARI_VERSION = "0.5.4"
"""Whose layout it is; a reader compares it with the versions it knows."""
_OVERHEAD_BYTES = 2**16
"""What HDF5 needs to describe an episode."""
_STATES = ("qpos", "qvel")


def export_minari(source: Source, out: Path) -> Exported:
    """Write a Minari data set: `minari.MinariDataset(out / "data")` opens it.

    Raises:
        GaitprefError: `out` is there, an episode cannot be used, or h5py is missing.
    """
    h5py = require("h5py", "export")
    with new_directory(source, out) as partial:
        data = partial / "data"
        data.mkdir()
        require_room(data / "main_data.hdf5", _most_bytes(source))
        largest = 0.0
        with h5py.File(data / "main_data.hdf5", "w", track_order=True) as file:
            for number, (entry, episode) in enumerate(
                zip(source.entries, source.episodes(), strict=True)
            ):
                group = file.create_group(f"episode_{number}")
                group.attrs["id"] = number
                group.attrs["seed"] = entry.meta.seed
                group.attrs["total_steps"] = entry.num_steps
                group.attrs["rollout_sha256"] = entry.sha256
                group.attrs["policy_sha256"] = entry.meta.policy_sha256
                group["observations"] = episode.obs
                group["actions"] = episode.action
                group["rewards"] = episode.reward
                group["terminations"] = _ends(episode, "terminated")
                group["truncations"] = _ends(episode, "truncated")
                for name in _STATES:
                    group[f"infos/{name}"] = getattr(episode, name)
                largest = max(largest, float(np.abs(episode.action).max()))
        metadata = _minari_metadata(source, data / "main_data.hdf5", largest)
        (data / "metadata.json").write_text(json.dumps(metadata, indent=1))
    return _exported(source, out)


def _minari_metadata(
    source: Source, file: Path, largest_action: float
) -> dict[str, Any]:
    metadata = {
        "total_episodes": len(source.entries),
        "total_steps": source.steps,
        "data_format": "hdf5",
        "observation_space": _box(48, np.inf),
        "action_space": _box(12, action_bound(largest_action)),
        "dataset_id": "gaitpref/walk-v0",
        "minari_version": _MINARI_VERSION,
        "description": "Episodes of a quadruped; rewards are the hand-written task's.",
        "algorithm_name": "PPO",
        "dataset_size": round(file.stat().st_size / 1e6, 1),
    }
    spec = env_spec(source)
    return metadata if spec is None else metadata | {"env_spec": spec}


def _box(width: int, bound: float) -> str:
    """A space of numbers up to plus and minus `bound`, as Gymnasium's are spelled."""
    bounds = {"low": [-bound] * width, "high": [bound] * width}
    return json.dumps({"type": "Box", "dtype": "float32", "shape": [width]} | bounds)


def export_d4rl(source: Source, out: Path) -> Exported:
    """Write one HDF5 file in which all episodes lie one behind the other.

    `timeouts` marks the last step of an episode that did not fall, as D4RL does.

    Raises:
        GaitprefError: `out` is there, an episode cannot be used, or h5py is missing.
    """
    with new_directory(source, out) as partial:
        write_flat(source, partial / "dataset.hdf5")
    return _exported(source, out)


def write_flat(source: Source, path: Path) -> None:
    """The flat file of D4RL, which Uni-RLHF's indices point into."""
    h5py = require("h5py", "export")
    parts: dict[str, list[np.ndarray]] = {}
    for episode in source.episodes():
        arrays = {
            "observations": episode.obs[:-1],
            "next_observations": episode.obs[1:],
            "actions": episode.action,
            "rewards": episode.reward,
            "terminals": _ends(episode, "terminated"),
            "timeouts": _ends(episode, "truncated"),
            "infos/features": episode.features,
        }
        arrays |= {f"infos/{name}": getattr(episode, name)[:-1] for name in _STATES}
        for name, array in arrays.items():
            parts.setdefault(name, []).append(array)
    require_room(path, _most_bytes(source))
    with h5py.File(path, "w") as file:
        for name, arrays_of in parts.items():
            file[name] = np.concatenate(arrays_of)
        file.attrs["control_hz"] = source.control_hz
        file.attrs["episodes"] = [entry.sha256 for entry in source.entries]


def _most_bytes(source: Source) -> int:
    """What a file with all that episodes hold has at most."""
    steps = source.steps * schema.STEP_RECORD.itemsize * 5 // 4
    return steps + _OVERHEAD_BYTES * (len(source.entries) + 16)


def _ends(episode: Episode, reason: str) -> np.ndarray:
    """[T] bool: true at the last step if that is how the episode ended."""
    flags = np.zeros(episode.num_steps, dtype=bool)
    flags[-1] = episode.end_reason == reason
    return flags


def _exported(source: Source, out: Path) -> Exported:
    return Exported(str(out), len(source.entries), source.steps, 0, source.left_out, 0)
