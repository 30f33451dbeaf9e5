"""What to call the policies of a data set: by where they are, or what they are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

from data.datasets.dataset import Dataset
from data.episodes.episode_records import EpisodeMeta
from data.errors import FileError
from data.files.files import sha256_file
from data.files.limits import POLICY_BYTES
from policy.robots.shipped import WALK

_MOST_FILES = 500
"""Policy files that are looked at."""
_IN_RUN = ("rounds/*/policy", "rounds/*/candidate")
"""Where the directories of a run's trainings are."""


def policy_names(dataset: Dataset) -> dict[str, str]:
    """A name for each policy of a data set, by its SHA-256.

    One whose file still lies in the run, or beside the data set, is called after its
    directory; the others are told by what they were trained on.
    """
    metas = {entry.meta.policy_sha256: entry.meta for entry in dataset.entries()}
    places: dict[str, str] = {}
    for file, name in islice(_files(dataset.root.resolve()), _MOST_FILES):
        if len(places) == len(metas):
            break
        sha256 = _sha256(file)
        if sha256 in metas:
            places.setdefault(sha256, name)
    order = sorted(metas, key=lambda s: (places.get(s, ""), metas[s].policy_step))
    return {sha256: _name(metas[sha256], places.get(sha256, "")) for sha256 in order}


def steps_told(steps: int) -> str:
    """A number of environment steps, short."""
    return f"{steps:,} steps" if steps < 10_000 else f"{steps / 1e6:.2f} M steps"


def _name(meta: EpisodeMeta, place: str) -> str:
    against = meta.extra.get("trained_against", "")
    if against == "nothing":
        return "random rhythms, no policy"
    if not place and not against:
        return "not known"
    told = place or f"trained on {against}"
    return f"{told} at {steps_told(meta.policy_step)}"


def _files(root: Path) -> Iterator[tuple[Path, str]]:
    """Policy files that may have been recorded, and what each is called."""
    run = root.parent
    if (run / "config.yaml").exists():
        for pattern in _IN_RUN:
            for training in sorted(run.glob(pattern)):
                number = training.parent.name.lstrip("0") or "0"
                yield from _of_training(training, f"{run.name} round {number}")
    yield WALK, "the walk that ships"
    for training in sorted(path.parent for path in run.glob("*/policy.pt")):
        yield from _of_training(training, training.name)
    for training in sorted(run.glob("*/rounds/*/policy")):
        number = training.parent.name.lstrip("0") or "0"
        other = training.parents[2].name
        yield from _of_training(training, f"{other} round {number}")


def _of_training(training: Path, name: str) -> Iterable[tuple[Path, str]]:
    own = (training / "policy.pt", *sorted(training.glob("checkpoints/*.pt")))
    return [(path, name) for path in own]


def _sha256(file: Path) -> str:
    """Of a file of a policy's size; empty for anything else."""
    try:
        if not file.is_file() or file.stat().st_size > POLICY_BYTES:
            return ""
        return sha256_file(file)
    except (FileError, OSError):
        return ""
