"""Human labels of Preference Transformer and Uni-RLHF, and the rows they are about.

Both publish three lists for each task, as pickles: first rows of the first and of the
second segments, and labels (0: the first is better, 1: the second, -1: equal). Rows are
transitions of D4RL's HDF5 file, without the last one of an episode that ran out of
time, as D4RL's `qlearning_dataset` makes them.

Labels: https://github.com/csmile-1006/PreferenceTransformer (`human_label/TASK`, MIT),
https://github.com/pickxiguapi/Clean-Offline-RLHF (`crowdsource_human_labels/`, MIT).
Rows: https://github.com/Farama-Foundation/D4RL lists the address of each file.

Shapes: S segments, T steps, F columns, Q answers.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from data.datasets.segments import Segments, TableAnswer
from data.errors import GaitprefError
from gaitpref.console.extras import require
from gaitpref.formats.pickles import load_integers

PUBLISHED_LABELS = (
    "labels are published in https://github.com/csmile-1006/PreferenceTransformer, "
    "human_label/TASK, and https://github.com/pickxiguapi/Clean-Offline-RLHF, "
    "crowdsource_human_labels/TASK_human_labels"
)
PUBLISHED_ROWS = (
    "the HDF5 files of D4RL are listed in "
    "https://github.com/Farama-Foundation/D4RL, d4rl/infos.py, and newer ones in the "
    "__init__.py of each suite: d4rl/gym_mujoco, d4rl/locomotion (AntMaze), "
    "d4rl/hand_manipulation_suite (Adroit), d4rl/kitchen"
)
USUAL_STEPS = 100
"""Steps of a segment where no file name says it, as in Preference Transformer."""
_LISTS = {
    "labels": re.compile(r"(?!.*(indices|dummy|fake)).*label"),
    "first rows of the first segments": re.compile(r".*indices(?!_2)"),
    "first rows of the second segments": re.compile(r".*indices_2"),
}
_STEPS = re.compile(r"(?:_len_|_q)(\d+)")
_TARGETS = {0: 1.0, 1: 0.0, -1: 0.5}


def read_labels(
    directory: Path, steps: int | None
) -> tuple[list[int], list[int], list[float], int]:
    """First rows of both segments of each answer, targets, and steps of a segment.

    Args:
        directory: Of one task.
        steps: Of a segment; None: as a file name says, or the usual ones.

    Raises:
        GaitprefError: a list is missing, damaged, or does not go with the others.
    """
    if not directory.is_dir():
        raise GaitprefError(f"there is no directory {directory}; {PUBLISHED_LABELS}")
    files = sorted(directory.glob("*"))
    found = {}
    for what, pattern in _LISTS.items():
        own = [path for path in files if pattern.match(path.name)]
        if len(own) != 1:
            raise GaitprefError(
                f"{directory} has {len(own)} lists of {what}, it needs 1; "
                f"{PUBLISHED_LABELS}"
            )
        found[what] = load_integers(own[0])
    labels, first, second = found.values()
    if len({len(labels), len(first), len(second)}) != 1:
        raise GaitprefError(
            f"{directory}: {len(labels)} labels of {len(first)} first and "
            f"{len(second)} second segments; the three lists are of one task each"
        )
    strange = sorted(set(labels) - set(_TARGETS))
    if strange:
        raise GaitprefError(f"{directory}: a label is 0, 1 or -1, got {strange[0]}")
    told = {int(m[1]) for path in files if (m := _STEPS.search(path.name))}
    if steps is None and len(told) > 1:
        raise GaitprefError(f"{directory} tells of {sorted(told)} steps: give --steps")
    length = steps or (told.pop() if told else USUAL_STEPS)
    return first, second, [_TARGETS[label] for label in labels], length


def read_transitions(path: Path) -> tuple[tuple[str, ...], np.ndarray]:
    """Names [F] and values [N, F] of what was seen and done, as labels count rows.

    Raises:
        GaitprefError: the file is missing or of another layout.
    """
    if not path.is_file():
        raise GaitprefError(f"there is no file {path}; {PUBLISHED_ROWS}")
    h5py = require("h5py", "export")
    try:
        with h5py.File(path) as file:
            seen, done = (np.asarray(file[key]) for key in ("observations", "actions"))
            timeouts = file.get("timeouts")
            ended = np.zeros(len(seen), bool) if timeouts is None else timeouts[:]
    except (OSError, KeyError, TypeError) as error:
        raise GaitprefError(
            f"{path} is no file of D4RL ({error}); {PUBLISHED_ROWS}"
        ) from error
    if seen.ndim != 2 or done.ndim != 2 or not len(seen) == len(done) == len(ended):
        raise GaitprefError(
            f"{path}: observations {seen.shape}, actions {done.shape} and timeouts "
            f"{ended.shape} must be [N, .], [N, .] and [N]"
        )
    kept = ~np.asarray(ended, dtype=bool)
    kept[-1:] = False
    names = [f"{what} {i}" for what, of in (("seen", seen), ("done", done))
             for i in range(of.shape[1])]  # fmt: skip
    return tuple(names), np.concatenate([seen, done], axis=1)[kept].astype(np.float32)


def labelled_segments(
    labels: Path, rows: Path, *, steps: int | None = None
) -> tuple[Segments, list[TableAnswer]]:
    """The segments that were judged, and what was said of them.

    Raises:
        GaitprefError: a file is missing or damaged, or a label is about rows that there
            are not.
    """
    first, second, targets, length = read_labels(labels, steps)
    names, values = read_transitions(rows)
    starts = sorted({*first, *second})
    if not starts or starts[0] < 0 or starts[-1] + length > len(values):
        about = f"{starts[0]} to {starts[-1] + length}" if starts else "none"
        raise GaitprefError(
            f"{labels} is about rows {about}, {rows} has {len(values)}: it is of "
            "another task"
        )
    place = {start: index for index, start in enumerate(starts)}
    stretches = np.stack([values[start : start + length] for start in starts])
    segments = Segments(tuple(map(str, starts)), names, stretches)
    answers = [
        TableAnswer(left=place[a], right=place[b], target=target, rater="crowd")
        for a, b, target in zip(first, second, targets, strict=True)
        if a != b
    ]
    return segments, answers
